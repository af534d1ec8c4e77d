"""Payloads, torques and scenes in suites, peers and on the command line, each against another way to the same figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import optik
from benchmarks.blocks.base import load_kind
from benchmarks.blocks.block import Target
from benchmarks.blocks.clearance import PROOF
from benchmarks.blocks.entries import SCENES, scene_named
from benchmarks.blocks.timing.motions import draw_motion
from benchmarks.blocks.timing.settings import LawBlock
from benchmarks.blocks.timing.timers import line_rows
from benchmarks.report import write_report
from benchmarks.run import run_suite
from benchmarks.suite import suite_of
from optik.errors import InvalidInput
from optik.scene.contact import find_clearances
from planners import MotionLimits
from tests.benchmarks.conftest import solved
from tests.seeds import shift_seed

BLOCK: dict[str, Any] = {
    "id": "loaded",
    "rounds": 1,
    "samples": 51,
    "lines": [{"robot": "panda", "kind": "joints", "count": 1, "payload": 3.0}],
    "limits": [{"label": "own", "velocity": "robot", "acceleration": "robot", "jerk": "robot", "torque": "robot"}],
    "laws": [{"law": "optimal"}, {"law": "optimal", "label": "blind", "without": ["torque"]}],
    "peers": [{"peer": "copp_torque"}, {"peer": "toppra_torque"}],
}
"""One joint move of the panda with all of its payload, which the optimum without torque limits cannot run."""

OVER_TORQUE = 20
"""Seed whose first move needs more torque than the motors have."""


def block_of(**changes: Any) -> LawBlock:
    return LawBlock.read({key: value for key, value in (BLOCK | changes).items() if value is not None})


def rows_of(block: LawBlock, seed: int) -> dict[str, dict[str, Any]]:
    part = block.lines[0]
    line = draw_motion(part.robot, part.kind, 0, seed=seed, payload=part.payload, limits=block.limits)
    return {row["method"]: row for row in line_rows(block, line)}


def test_who_counts_torque_keeps_it_and_who_does_not_is_seen_and_slowed() -> None:
    rows = rows_of(block_of(), OVER_TORQUE)
    blind, optimal = rows["blind"], rows["optimal"]
    assert blind["torque"] > 1.02 and "torque" in blind["breaks"] and blind["holds"]  # it never promised torque
    assert blind["least_duration"] > blind["duration"]
    assert optimal["torque"] <= 1.0 and optimal["breaks"] == "" and optimal["holds"]
    assert blind["duration"] < optimal["duration"] < blind["least_duration"]
    assert rows["copp torque"]["torque"] < 1.01 and rows["toppra torque"]["torque"] < 1.01
    assert optimal["duration"] < 1.02 * rows["copp torque"]["least_duration"]


def test_motions_are_drawn_until_the_arm_can_stand_everywhere_on_them() -> None:
    tight = block_of(limits=[{"torque": [87.0, 40.0, 87.0, 87.0, 12.0, 12.0, 12.0]}]).limits
    draws = []
    for index in range(6):
        line = draw_motion("panda", "joints", index, seed=shift_seed(1), payload=3.0, limits=tight)
        q = line.path.configurations(line.robot, np.linspace(0.0, line.path.end, 400))  # type: ignore[attr-defined]
        assert np.abs(line.robot.gravity_torques(q)[:, 1]).max() < 0.96 * 40.0
        draws.append(line.draws)
    assert max(draws) > 1
    free = draw_motion("panda", "joints", 0, seed=1)
    assert (free.arm, free.draws, line.arm) == ("panda", 1, "panda 3 kg")


def test_limits_of_the_robot_itself_are_those_of_its_file() -> None:
    panda = optik.load("panda")
    assert block_of().limits[0].of(panda) == MotionLimits.of(panda).select(
        ("velocity", "acceleration", "jerk", "torque")
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"limits": [{"torque_rate": "robot"}], "lines": [{"robot": "ur5e", "kind": "joints", "count": 1}]},
            "torque_rate",
        ),
        (
            {"limits": [{"velocity": 1, "torque": 9}], "lines": [{"robot": "kr6", "kind": "joints", "count": 1}]},
            "masses",
        ),
        ({"limits": [{"tool_speed": "robot"}]}, "tool_speed"),
        ({"lines": [BLOCK["lines"][0] | {"payload": [3, 1]}]}, "payload"),
        ({"laws": [{"law": "optimal", "without": ["torq"]}]}, "without"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        load_kind("timing").prepare(block_of(peers=None, **changes), 0)


def test_a_ratio_of_two_laws_is_of_the_motions_that_both_have() -> None:
    rows = pl.DataFrame(
        {
            "method": ["a", "a", "a", "b", "b"], "problem": [0, 1, 2, 0, 1], "kind": "joints", "robot": "panda",
            "solved": True, "ms_law": [1.0, 2.0, 90.0, 10.0, 10.0], "slowed_duration": [1.0, 3.0, 9.0, 2.0, 2.0],
        }
    )  # fmt: skip
    for measure, value in (("median_ms_ratio", 0.15), ("median_duration_ratio", 1.0), ("worst_duration_ratio", 1.5)):
        assert load_kind("timing").judge(rows, Target(measure=measure, method="a", to="b", at_most=1.0))[
            0
        ] == pytest.approx(value)


# ---------------------------------------------------------------- contact


def test_sampling_that_is_too_coarse_misses_contacts_and_the_proof_none(tmp_path: Path) -> None:
    pytest.importorskip("coal")
    settings = {"id": "x", "robot": "panda", "scene": "plates", "count": 20, "joint_steps": [3.0, 0.02], "rates": []}
    rows = solved("clearance", settings, tmp_path, shift_seed(1))
    by = {label: rows.filter(pl.col("method") == label) for label in (PROOF, "coal, 3 rad", "coal, 0.02 rad")}
    assert all(part.height == 20 for part in by.values())
    assert by[PROOF]["contact"].sum() >= 4
    assert not by[PROOF].select(pl.any_horizontal("missed", "false_contact")).to_series().any()
    assert set(by[PROOF]["says"]) == {"free", "contact"}
    assert by["coal, 3 rad"]["missed"].sum() >= 3
    assert by["coal, 0.02 rad"]["missed"].sum() <= 1


# ---------------------------------------------------------------- the command line

MOVE = (
    "plan", "joints", "--robot", "panda", "--start-deg", "0,-20,0,-100,0,90,0", "--to-deg", "60,30,20,-60,10,120,30",
)  # fmt: skip


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--payload", "x"], "--payload"),
        (["--payload", "3:1"], "3 to 1 kg"),
        (["--payload", "1:2:3"], "0:3"),
        (["--torque", "1,2"], "7 numbers"),
        (["--torque-rate", "fast"], "--torque-rate"),
        (["--margin", "0.1"], "--scene FILE"),
        (["--scene", "nofile.toml"], "nofile.toml"),
    ],
)
def test_wrong_loads_and_scenes_are_one_line_and_exit_status_two(options: list[str], words: str, typed: Any) -> None:
    status, out, said = typed(*MOVE, *options)
    assert (status, out, said.strip().count("\n")) == (2, "", 0), said
    assert words in said


def test_an_arm_without_masses_or_shapes_says_so(typed: Any) -> None:
    move = ("plan", "line", "--robot", "kr6", "--start-deg", "0,-20,90,0,0,0", "--acceleration", "9", "--jerk", "99")
    for option, value in (("--payload", "3"), ("--torque", "3"), ("--torque", "robot"), ("--scene", "self")):
        status, _, said = typed(*move, option, value)
        assert status == 2 and option in said and said.strip().count("\n") == 0, said


def test_a_payload_a_torque_limit_and_a_scene_are_in_the_plan(typed: Any) -> None:
    import json

    given = (
        "--payload",
        "0:3",
        "--torque",
        "60,60,60,60,12,12,12",
        "--torque-rate",
        "none",
        "--scene",
        SCENES["table"],
    )
    status, out, said = typed(*MOVE, *given, "--json")
    assert status == 0, said
    plan = json.loads(out)
    proof, limits = plan["certificate"], plan["limits"]
    assert limits["torque"][:5] == [60.0, 60.0, 60.0, 60.0, 12.0] and limits.get("torque_rate") is None
    assert 0.9 < max(proof["torque"]["ratio"]) <= 1.0
    assert proof["clearance"]["scene"]["value"] > 0.0


def test_a_line_in_a_scene_has_its_clearance_in_rows_and_report(tmp_path: Path) -> None:
    line = {"robot": "panda", "kind": "line", "start_deg": [0, -45, 0, -135, 0, 90, 45], "move_m": [0.0, 0.0, -0.1]}
    block = {
        "id": "line", "detail": True, "lines": [line], "limits": [{"velocity": 1.0, "acceleration": 5.0, "jerk": 50.0}],
        "laws": [{"law": "smooth"}, {"law": "optimal"}], "scene": "table", "margin": 0.01, "samples": 31,
    }  # fmt: skip
    run = run_suite(suite_of("s", {"timing": [block]}), tmp_path / "run")
    arm, scene = optik.load("panda"), scene_named("table", 0.01)
    over_time = run.read("rows/timing/line.clearance.parquet")
    for law, proved in run.rows("timing", "line").select("method", "clearance").iter_rows():
        joints = run.read("rows/timing/line.joints.parquet").filter(law=law)["q"].to_numpy().reshape(-1, 7)
        least = find_clearances(arm, scene, joints)[0][:, 0].min()
        assert 0.0 < proved <= least == pytest.approx(over_time.filter(law=law)["scene"].min(), abs=1e-3)
    page = write_report(run).read_text(encoding="utf-8")
    assert "Clearance over time" in page and "Pairs not examined" in page
