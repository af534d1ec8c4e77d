"""The published run: complete, without paths of a machine, and the README's figures are its figures."""

from __future__ import annotations

import csv
import json
import re

import pytest

from tests.oracles import REPOSITORY

RESULTS = REPOSITORY / "benchmarks/results"
README = (REPOSITORY / "README.md").read_text(encoding="utf-8")


def table(file: str) -> dict[str, dict[str, str]]:
    with (RESULTS / file).open(encoding="utf-8", newline="") as lines:
        return {row.get("label") or row["law"]: row for row in csv.DictReader(lines)}


def printed(text: str, value: float) -> bool:
    """Whether a text is a value, rounded to the digits of the text."""
    digits = text.replace(",", "")
    if "." in digits or value < 100.0:
        return float(digits) == round(value, len(digits.partition(".")[2]))
    return float(digits) == float(f"{value:.3g}")


def test_the_readme_s_comparison_is_that_of_the_published_run() -> None:
    rows = re.findall(r"^\| (\*\*`lm`, ours\*\*|[\w() -]+) \|((?: [\d.,]+ \|){6})$", README, flags=re.M)
    assert len(rows) == 8
    for name, cells in rows:
        label = "lm" if name.startswith("**") else name
        found = cells.replace(" ", "").strip("|").split("|")
        for k, block in enumerate(("warm", "cold", "hard-cold")):
            row = table(f"ik-speed/tables/calls-{block}.csv")[label]
            assert printed(found[2 * k], float(row["solved [%]"])), (label, block)
            assert printed(found[2 * k + 1], float(row["median [µs]"])), (label, block)
            if found[2 * k] == "100":
                assert row["failed"] == "0"
    wrong = int(table("ik-speed/tables/calls-hard-cold.csv")["EAIK"]["false_claims"])
    assert f"on {wrong:,} of the 100,000 hard problems it reports success" in README


def test_the_readme_s_words_on_time_laws_are_those_of_the_published_run() -> None:
    regular, singular = (table(f"timing/tables/timing-lines-{group}.csv") for group in ("regular", "near-singular"))
    words = " ".join(README.split())
    ours = regular["optimal"]
    assert float(ours["kept [%]"]) == float(singular["optimal"]["kept [%]"]) == 100.0
    assert f"on {int(ours['count']) + int(singular['optimal']['count'])} straight-line motions" in words
    assert f"| **`optimal`, ours** | {float(ours['slowed_down']):.4f} | {float(ours['ms [ms]']):.1f} |" in words
    for label, name in (
        ("CasADi, fatrop", "CasADi with fatrop, motion stretched to meet the limits"),
        ("copp, two passes", "copp"),
    ):
        row = regular[label]
        assert f"| {name} | {float(row['slowed_down']):.3f} | {float(row['ms [ms]']):.0f} |" in words
    assert all(regular[label]["slowed_down"] == "inf" for label in regular if label.lower().startswith("topp"))


def rounds_to(text: str, value: float) -> bool:
    """Whether a text is a value rounded to the text's last digit; zeros before the point may be rounded ones."""
    unit = 10.0 ** -len(text.partition(".")[2]) if "." in text else 10.0 ** (len(text) - len(text.rstrip("0")))
    return abs(float(text) - value) <= 0.5 * unit * (1.0 + 1e-9)


def unescaped(text: str) -> str:
    return re.sub(r"\\([_*|])", r"\1", text.strip())


def test_the_winners_of_the_published_page_are_those_of_the_run() -> None:
    page = (RESULTS / "README.md").read_text(encoding="utf-8")
    shown = [
        [unescaped(cell) for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        for line in page.splitlines()
        if line[:1] == "|"
    ]
    shown = [row for row in shown if row[0] != "Question" and not row[0].startswith("---")]
    kept = []
    for suite in ("ik-speed", "timing"):
        with (RESULTS / suite / "tables/winners.csv").open(encoding="utf-8", newline="") as lines:
            kept += list(csv.DictReader(lines))
        run = json.loads((RESULTS / suite / "run.json").read_text(encoding="utf-8"))
        assert f"commit `{run['provenance']['commit'][:7]}`" in page
    assert len(shown) == len(kept) > 16
    for (question, best, value, unit, tied, second, second_value, note), row in zip(shown, kept, strict=True):
        wanted = [row[key] for key in ("question", "best", "unit", "tied", "second", "note")]
        assert [question, best, unit, tied, second.replace("–", ""), note] == wanted
        given = ((value, "value"), (second_value, "second_value"))
        for text, key in given if row["second"] else given[:1]:
            numbers = re.fullmatch(r"([\d.]+) \(([\d.]+) to ([\d.]+)\)", text)
            assert numbers, text
            for digits, of in zip(numbers.groups(), (key, f"{key} low", f"{key} high"), strict=True):
                assert rounds_to(digits, float(row[of])), (question, of)


@pytest.mark.parametrize("suite", ["ik-speed", "timing"])
def test_a_published_run_is_complete_and_says_where_it_is_from(suite: str) -> None:
    text = (RESULTS / suite / "run.json").read_text(encoding="utf-8")
    run = json.loads(text)
    assert run["complete"]
    assert run["failed"] == []
    assert run["suite"] == suite
    assert {"commit", "cpu", "versions"} <= set(run["provenance"])
    assert not run["provenance"]["dirty"]
    assert not re.search(r"\"/|\"[A-Z]:\\\\", text)  # no path of the machine it ran on
    assert (RESULTS / suite / "tables/winners.csv").is_file()


def test_the_links_of_the_published_results_exist() -> None:
    for link in re.findall(r"\]\(([^)#:]+)\)", (RESULTS / "README.md").read_text(encoding="utf-8")):
        assert (RESULTS / link).exists(), link
