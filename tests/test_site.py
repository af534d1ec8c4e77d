"""The check of the built site finds each fault of an output, in pages written as the notebooks are."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.generate import GALLERY, MEASURED_LABEL
from tests.oracles import REPOSITORY
from tests.site import Page, judge_outputs

CELL = """<html><body><p>Something <code>else</code>.</p><p>{before}</p>
<div class="cell {tag} docutils container"><div class="cell_input"><pre>x is False</pre></div>
<div class="cell_output docutils container"><script>False</script><div class="output text_plain"><pre>{text}</pre></div>
</div></div>
<p>No output: False, NOT valid.</p></body></html>"""
EXAMPLE = """<html><body><img src="a.webp"><p>{before}</p>
<div class="highlight-text notranslate"><div class="highlight"><pre><span></span>{text}</pre></div></div></body></html>"""
TAG = "tag_expected-failure"


def judge(folder: Path, text: str, before: str = "The plan:", tag: str = "", page: str = CELL) -> list[str]:
    file = folder / "page.html"
    file.write_text(page.format(text=text, before=before, tag=tag), encoding="utf-8")
    return judge_outputs(Page(file))


FAULTS = {
    "a failed plan": ("False", "a failure"),
    "a failed plan of several": ("(True, False)", "a failure"),
    "a certificate": ("certificate NOT valid: the jerk of joint1 is 2.89 times its limit", "a failure"),
    "a card": ("arm, Line of 0.2 m\n✗ outside_limits at s = 0 m", "a failure"),
    "a plan that stops": ("contact: panda, JointLine of 1.6 rad\n  reason: joint7 and box1 touch", "a failure"),
    "a traceback": ("Traceback (most recent call last):", "a failure"),
    "a pose out of reach": ("IKStatus.UNREACHABLE", "a failure"),
    "a spinner": ("⠋ writing the report", "moves"),
    "a bar": ("lm ━━━━━ 3/6", "moves"),
    "compiling": ("optik: compiling on first use, about a minute", "moves"),
    "colours": ("\x1b[33mwarning", "an escape sequence"),
    "colours without their escape": ("[1;33mwarning", "an escape sequence"),
    "a line that is written again": ("[2K1 of 6 parts", "an escape sequence"),
    "a cursor": ("[?25l", "an escape sequence"),
    "rounding": ("[1.0077e-32, 0.7]", "rounding"),
    "rounding of a double": ("error 3e-16 m", "rounding"),
    "a time": ("lm  100.0 % solved, 35.5 µs each", "a time"),
    "a rate": ("1.53 million per second", "a time"),
}


@pytest.mark.parametrize("page", [CELL, EXAMPLE], ids=["cell", "example"])
@pytest.mark.parametrize(("text", "fault"), FAULTS.values(), ids=FAULTS)
def test_each_fault_of_an_output_is_found(tmp_path: Path, text: str, fault: str, page: str) -> None:
    (found,) = judge(tmp_path, text, page=page)
    assert fault in found


def test_failures_are_tagged_and_announced(tmp_path: Path) -> None:
    assert judge(tmp_path, "certificate NOT valid", "This motion exceeds its limits:", TAG) == []
    (found,) = judge(tmp_path, "certificate NOT valid", "The certificate is printed:", TAG)
    assert "do not announce" in found
    (found,) = judge(tmp_path, "certificate NOT valid", "This motion exceeds its limits:")
    assert "not tagged" in found


def test_what_works_has_no_fault(tmp_path: Path) -> None:
    words = "True, certificate valid; path error 8.9e-07 mm, 1.25 m/s, 125 points, turn 3° to 30°, [-0.5, 1.2]"
    assert judge(tmp_path, words) == judge(tmp_path, words, page=EXAMPLE) == []
    assert judge(tmp_path, "lm  35.5 µs each", f"The times were {MEASURED_LABEL}:") == []


def test_each_example_has_a_card_of_five_words_and_each_picture_is_small() -> None:
    cards = [card for row in GALLERY.values() for card in row]
    assert max(len(title.split()) for title, *_ in cards) <= 5
    examples = {f"gallery/{file.stem}" for file in (REPOSITORY / "examples").glob("*.py")}
    assert examples <= {page for *_, page in cards}
    files = {file.stem: file.stat().st_size for file in (REPOSITORY / "docs" / "pictures").glob("*.webp")}
    assert {picture for _, picture, _ in cards if picture} | {"motion"} == {*files}
    assert files.pop("motion") <= 600_000
    assert max(files.values()) <= 40_000
