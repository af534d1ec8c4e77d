"""`optik view`: pages as people ask for them, rightly and wrongly."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Any

import pytest

from tests.oracles import REPOSITORY
from tests.planners.motions import planned


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("motions") / "motion.json"
    planned().save(file)
    return file


# ---------------------------------------------------------------- pages


@pytest.mark.parametrize("suffix", [".json", ".npz", ".csv"])
def test_a_page_of_a_motion_in_any_format(typed: Any, tmp_path: Path, suffix: str) -> None:
    planned().save(tmp_path / f"m{suffix}")
    status, out, said = typed("view", str(tmp_path / f"m{suffix}"), "--html", str(tmp_path / "page.html"))
    assert (status, said) == (0, "")
    assert "page.html" in out
    assert 10_000 < (tmp_path / "page.html").stat().st_size < 2_000_000
    assert '</h1><p class="good">certificate valid; enforced: ' in (tmp_path / "page.html").read_text()


def test_a_page_of_a_simulated_execution(typed: Any, motion: Path, tmp_path: Path) -> None:
    status, _, said = typed("view", str(motion), "--drive", "ideal", "--html", str(tmp_path / "page.html"))
    assert (status, said) == (0, "")
    text = (tmp_path / "page.html").read_text()
    assert "on the drive ideal" in text and '<p class="good">execution done; certificate valid' in text


SHELF = """[[boxes]]
name = "board"
xyz_mm = [500.0, 0.0, 300.0]
edges_mm = [300.0, 600.0, 20.0]
"""
URDF = """<robot name="crane"><link name="base"/><link name="mast"/><link name="hook"/>
<joint name="swing" type="revolute"><parent link="base"/><child link="mast"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1" effort="9"/></joint>
<joint name="lift" type="prismatic"><parent link="mast"/><child link="hook"/><origin xyz="0.4 0 0.5"/><axis xyz="0 0 1"/>
<limit lower="-0.2" upper="0.2" velocity="1" effort="9"/></joint></robot>
"""


@pytest.mark.parametrize(
    ("words", "seen"),
    [
        (("ur5e",), "joint6"),
        (("ur5e", "--start-deg", "0,-90,90,0,0,0"), "joint6"),
        (("crane.urdf", "--start-deg", "10,50"), "swing"),
        (("shelf.toml",), "board"),
        (("shelf.toml", "--robot", "ur5e"), "board"),
    ],
)
def test_a_page_of_an_arm_or_a_scene(
    typed: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], seen: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(webbrowser, "open", lambda url: True)
    (tmp_path / "shelf.toml").write_text(SHELF)
    (tmp_path / "crane.urdf").write_text(URDF)
    status, _, said = typed("view", *words)
    assert status == 0 and "rror" not in said, said
    page = (tmp_path / words[0]).with_suffix(".html").read_text()
    assert seen in page and ("goal" not in page.split("<script")[0])


def failed(folder: Path, motion: Path) -> Path:
    file = folder / "failed.json"
    file.write_text('{"format": "optik-plan/2", "reason": "joint5 comes to its end", "s": 0.5, "advice": "turn back"}')
    return file


def printed(folder: Path, motion: Path) -> Path:
    file = folder / "printed.json"
    file.write_text('{"format": "optik-plan/2", "status": "solved"}')
    return file


def real(folder: Path, motion: Path) -> Path:
    (folder / "real.py").write_text("from planners.cell.drives.ideal import IdealDrive\n\n\nclass Real(IdealDrive):\n"
                                    "    simulated = False\n\n\nMETHOD = Real\n")  # fmt: skip
    return motion


WRONG: dict[str, tuple[Any, tuple[str, ...], int, str]] = {
    "no file": (lambda folder, motion: folder / "none.json", (), 2, "No such file"),
    "a folder": (lambda folder, motion: folder, (), 2, "the folder"),
    "a report": (lambda folder, motion: REPOSITORY / "docs" / "report.png", (), 2, ".json"),
    "a failed plan": (failed, (), 1, "joint5 comes to its end"),
    "what --json printed": (printed, (), 2, "--out"),
    "a page's suffix": (lambda folder, motion: motion, ("--html", "page.txt"), 2, "--html"),
    "an unwritable page": (lambda folder, motion: motion, ("--html", "/none/page.html"), 2, "/none/page.html"),
    "a real drive": (real, ("--drive", "./real.py"), 2, "simulated drive"),
    "no arm": (lambda folder, motion: Path("ur5x"), (), 2, "FILE: unknown robot 'ur5x'; did you mean ur5"),
    "no arm's file": (lambda folder, motion: Path("arm.urdf"), (), 2, "FILE: expected a file"),
    "a drive of an arm": (lambda folder, motion: Path("ur5e"), ("--drive", "ideal"), 2, "--drive: expected a motion"),
    "no drive": (lambda folder, motion: motion, ("--drive", "idael"), 2, "ideal"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_wrong_is_one_line(
    typed: Any, motion: Path, tmp_path: Path, wrong: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    file, options, expected, words = WRONG[wrong]
    status, _, said = typed("view", str(file(tmp_path, motion)), *options)
    assert status == expected, said
    assert words in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("wrong", ["no file", "a folder", "a failed plan", "what --json printed"])
def test_a_drive_is_given_the_same_files(typed: Any, motion: Path, tmp_path: Path, wrong: str) -> None:
    file, _, expected, words = WRONG[wrong]
    status, _, said = typed("drive", str(file(tmp_path, motion)))
    assert status == expected and words in said
    assert said.count("\n") == 1


def test_the_page_is_beside_the_file_and_opened_or_named(
    typed: Any, motion: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    for able in (True, False):
        monkeypatch.setattr(webbrowser, "open", lambda url, able=able: asked.append(url) or able)
        status, out, said = typed("view", str(motion))
        assert (status, said) == (0, "")
        assert ("open it in a browser" in out) == (not able)
    page = motion.with_suffix(".html")
    assert asked == [page.as_uri()] * 2
    assert str(page) in out.replace("\n", "")
    assert 10_000 < page.stat().st_size < 2_000_000
    typed("view", str(motion), "--html", str(tmp_path / "other.html"))
    assert len(asked) == 2, "a page that is named is only written"
