"""Suites with limits of makers and goods: explained, counted as exceeded, and shown with their values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import optik
from benchmarks.blocks.timing.motions import draw_motion
from benchmarks.blocks.timing.settings import LawBlock
from benchmarks.blocks.timing.timers import line_rows
from benchmarks.cli.explain import explain
from benchmarks.report import write_report
from benchmarks.run import run_suite
from benchmarks.suite import suite_of
from optik.errors import InvalidInput

BOX = {"velocity": 2.0, "acceleration": 10.0, "jerk": 100.0}
SUITE: dict[str, Any] = {
    "title": "Further limits",
    "seed": 1,
    "timing": [
        {
            "id": "laws",
            "rounds": 1,
            "samples": 51,
            "lines": [{"robot": "ur5e", "kind": "joints", "count": 1}],
            "limits": [BOX | {"body_speed": 0.3, "suction": {"friction": 0.5, "force": 80.0, "mass": 1.0}}, BOX],
            "laws": [{"law": "optimal"}, {"law": "optimal", "label": "blind", "without": ["body_speed"]}],
        }
    ],
}


def test_a_further_limit_that_is_exceeded_counts() -> None:
    block = LawBlock.read(SUITE["timing"][0])
    rows = {(row["method"], row["limits"]): row for row in line_rows(block, draw_motion("ur5e", "joints", 0, seed=1))}
    label = "2.0, 10.0, 100.0, body speed 0.3, suction"
    optimal, blind = rows["optimal", label], rows["blind", label]
    assert optimal["breaks"] == "" and 0.9 < optimal["further"] <= 1.0
    assert blind["breaks"] == "body_speed" and blind["further"] == blind["worst"] > 1.1
    assert blind["duration"] < optimal["duration"] <= blind["least_duration"] * 1.02
    assert rows["optimal", "2.0, 10.0, 100.0"].get("further") is None


def test_keys_are_explained_and_reports_name_the_limits(tmp_path: Path) -> None:
    suite = suite_of("further", SUITE)
    said = {row.key: row for row in explain(suite, tmp_path)}
    assert said["timing.laws.limits[0].body_speed"].unit == "m/s"
    assert "capsules" in said["timing.laws.limits[0].body_speed"].meaning
    assert "timing.laws.limits[0].suction" in said
    run = run_suite(suite, tmp_path / "run", workers=1)
    text = write_report(run).read_text(encoding="utf-8")
    assert "body speed 0.3 m/s; suction friction 0.5, force 80.0, mass 1.0" in text
    assert "further limit" in text


@pytest.mark.parametrize("wrong", [{"body_sped": 0.3}, {"suction": {"friction": -1.0, "force": 80.0}}, {"tray": "x"}])
def test_mistakes_are_named(wrong: dict[str, Any]) -> None:
    limits = [BOX | wrong]
    with pytest.raises(InvalidInput, match=next(iter(wrong))):
        LawBlock.read(SUITE["timing"][0] | {"limits": limits})


def test_limits_of_the_robot_fall_towards_the_ends_and_a_law_without_them_is_seen() -> None:
    own = dict.fromkeys(("velocity", "acceleration", "jerk", "velocity_by_position"), "robot")
    laws = [{"law": "optimal"}, {"law": "optimal", "label": "box", "without": ["velocity_by_position"]}]
    block = LawBlock.read(SUITE["timing"][0] | {"limits": [own], "laws": laws})
    assert "own velocity by position" in block.limits[0].label
    exceeded = 0
    for index in range(4):
        rows = {row["method"]: row for row in line_rows(block, draw_motion("fr3", "joints", index, seed=1))}
        assert rows["optimal"]["breaks"] == "" and rows["optimal"]["further"] <= 1.0
        exceeded += rows["box"]["breaks"] == "velocity_by_position" and rows["box"]["further"] > 1.0
    assert exceeded
    with pytest.raises(InvalidInput, match="a robot whose file states"):
        block.limits[0].of(optik.load("ur5e"))


def test_a_limit_that_is_exceeded_at_rest_is_not_called_a_jerk(tmp_path: Path) -> None:
    tilted = BOX | {"open_container": {"angle": 0.02, "axis": "x"}}
    block = SUITE["timing"][0] | {"limits": [tilted], "laws": [{"law": "quintic"}, {"law": "optimal"}]}
    text = write_report(
        run_suite(suite_of("tilted", SUITE | {"timing": [block]}), tmp_path / "run", workers=1)
    ).read_text()
    assert "quintic: a limit is exceeded at rest in 1 motion; no time scaling meets it" in text
    assert "optimal: no motion on 1 (the open container is tilted by" in text and "jerk unbounded" not in text
