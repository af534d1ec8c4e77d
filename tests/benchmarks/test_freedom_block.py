"""Blocks of motions whose paths have freedoms: rows, targets, settings and the report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from benchmarks.blocks import freedom
from benchmarks.blocks.base import load_kind
from benchmarks.blocks.block import Target
from benchmarks.blocks.freedom import ALONG_INITIAL, CHOSEN, DRAKE, FreedomBlock, draw, solve_by_peer
from benchmarks.peers import drake_moves
from benchmarks.peers.ik.drake import METHOD as PEER
from benchmarks.records import RunFolder
from benchmarks.report.base import Run
from benchmarks.report.freedom import REPORT
from benchmarks.run.session import run_suite
from benchmarks.suite import load_suite
from optik import Robot
from optik.errors import InvalidInput, NoSolution
from planners import JointLine, MotionLimits, Trajectory, plan

LIMITS = {"label": "own", "velocity": 2.0, "acceleration": 10.0, "jerk": 100.0}
SETS = [
    {"robot": "paper6r", "torch_deg": 45, "kind": "regular", "freedom": "turn", "count": 2},
    {"robot": "panda", "kind": "joints", "payload": 3.0, "count": 1},
    {"robot": "ur5e", "kind": "cycle", "home_deg": [11, -80, 97, -109, -90, 6], "count": 1},
]
MOTIONS = 4
ROUNDING = 1e-12


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run of a suite with one set of each type."""
    folder = tmp_path_factory.mktemp("freedom")
    tables = ", ".join("{ " + ", ".join(f"{k} = {v!r}" for k, v in part.items()) + " }" for part in (*SETS,))
    limits = "{ " + ", ".join(f"{k} = {v!r}" for k, v in LIMITS.items()) + " }"
    (folder / "s.toml").write_text(f'[[freedom]]\nid = "f"\nsets = [{tables}]\nlimits = [{limits}]\n')
    run_suite(load_suite(str(folder / "s.toml")), folder / "run")
    return Run(RunFolder(folder / "run"))


def test_every_motion_has_a_certified_row_that_is_not_longer_than_before(run: Run) -> None:
    b = run.of("freedom")[0]
    rows = b.rows
    assert set(load_kind("freedom").compared) <= set(rows.columns) and rows["problem"].to_list() == list(range(MOTIONS))
    assert rows["certified"].all() and rows["solved"].all() and (rows["ratio"] <= 1.0 + 1e-9).all()
    assert np.allclose(rows["gain"], 1.0 - rows["duration"] / rows["fixed_duration"], atol=1e-12)
    assert rows["stop_duration"].is_not_null().to_list() == [False] * 3 + [True]
    assert (rows["stop_duration"] > rows["fixed_duration"]).drop_nulls().all()
    assert rows["ratio"][3] == rows["duration"][3] / rows["stop_duration"][3]
    assert (rows.filter(pl.col("gain") > 0.0)["steps"] > 0).all() and rows["gain"][0] > 0.01
    assert rows["distance"].is_nan().to_list() == [False] * 2 + [True] * 2


def test_targets_are_judged_on_the_motions_of_a_group_that_have_a_plan(run: Run) -> None:
    kind, rows = load_kind("freedom"), run.of("freedom")[0].rows
    failed = rows.with_columns(
        ratio=pl.when(pl.col("problem") == 0).then("ratio"),
        solved=pl.col("problem") == 0,
        certified=pl.col("problem") == 0,
    )
    median = kind.judge(failed, Target(measure="median_ratio", group="paper6r, torch 45°", at_most=1))
    assert median == (rows["ratio"][0], "1 motions")
    solved = kind.judge(failed, Target(measure="solved", group="regular, turn", at_least=100))
    assert solved == (50.0, "2 motions")


def test_the_report_has_the_table_the_coordinates_and_both_motions(run: Run) -> None:
    (table,) = REPORT.tables(run)
    assert [(row["label"], row["robot"], row["motions"]) for row in table.rows] == [
        ("regular, turn", "paper6r, torch 45°", 2), ("joints", "panda 3 kg", 1), ("cycle", "ur5e", 1),
    ]  # fmt: skip
    rows = run.of("freedom")[0].rows
    assert table.rows[0]["median_ratio"] == pytest.approx(float(np.median(rows["ratio"][:2])))
    first, arm = (section.build(run) for section in REPORT.sections)
    assert first is not None and arm is not None
    assert [board.id for board in first["boards"]] == ["freedom-board", "coordinates-board"]
    assert {trace.name for trace in first["boards"][1].figures[0].data} >= {"turn", "range reached", "joint1"}
    motions = run.of("freedom")[0].table("motion-2")
    ends = {name: motions.filter(motion=name)["t"].max() for name in (CHOSEN, ALONG_INITIAL)}
    assert ends == pytest.approx({CHOSEN: rows["duration"][3], ALONG_INITIAL: rows["stop_duration"][3]})
    assert REPORT.findings(run)[0].startswith(
        "Path and time together: f within own, median duration after / before path and time were chosen: reg"
    )


def test_the_coordinates_of_an_example_are_inside_their_ranges(run: Run) -> None:
    turn, joints = (run.of("freedom")[0].table(f"coordinates-{k}") for k in (0, 2))
    assert turn["unit"].unique().to_list() == ["rad"] and turn["value"].abs().max() > 0.01
    low, high = turn["reached_least"] - ROUNDING, turn["reached_most"] + ROUNDING
    assert ((turn["value"] >= low) & (turn["value"] <= high)).all()
    assert joints["coordinate"].n_unique() == 6 and joints["value"].is_between(0.0, 1.0).all()


def test_a_peer_has_rows_beside_ours_and_a_reason_where_it_does_not_take_the_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def too_fast(arm: Robot, path: Any, limits: MotionLimits) -> tuple[Trajectory, float]:
        if limits.torque is not None:
            raise NoSolution("it takes no torque")
        ends = path.coefficients[[0, -1]]
        motion = plan(arm, JointLine(arm, *ends), ends[0], limits=MotionLimits(2.2, 11.0, 110.0)).trajectory
        return motion, 7.0

    monkeypatch.setattr(drake_moves, "solve_by_drake", too_fast)
    own = "label = 'own', velocity = 2.0, acceleration = 10.0, jerk = 100.0"
    (tmp_path / "s.toml").write_text(
        '[[freedom]]\nid = "f"\nsets = [{ robot = "panda", kind = "joints", count = 1 }]\n'
        f'limits = [{{ {own} }}, {{ {own.replace("own", "torque")}, torque = "robot" }}]\npeers = ["{DRAKE}"]\n'
    )
    run_suite(load_suite(str(tmp_path / "s.toml")), tmp_path / "run")
    run = Run(RunFolder(tmp_path / "run"))
    rows = run.of("freedom")[0].rows
    assert rows["method"].to_list() == [CHOSEN, DRAKE] * 2 and rows["problem"].to_list() == [0] * 4
    expected = [True, True, True, False]
    assert rows["certified"].to_list() == expected and rows["solved"].to_list() == expected
    assert rows["own_duration"][1] <= rows["duration"][1] <= 1.1 * rows["own_duration"][1]
    assert rows["before"][0] == rows["before"][1] and rows["ms"][1] == 7.0
    assert rows["status"][3] == "timing_infeasible" and rows["outcome"][3] == "it takes no torque"
    (table,) = REPORT.tables(run)
    assert [(row["method"], row["limits"], row["motions"]) for row in table.rows] == [
        (CHOSEN, "own", 1), (CHOSEN, "torque", 1), (DRAKE, "own", 1), (DRAKE, "torque", 1),
    ]  # fmt: skip
    judged = (Target(measure="solved", at_least=100, method=method) for method in ("", DRAKE))
    assert [load_kind("freedom").judge(rows, one)[0] for one in judged] == [100.0, 50.0]
    assert DRAKE not in REPORT.findings(run)[0]


@pytest.mark.skipif(bool(PEER.missing()), reason="Drake has no environment here")
def test_drake_moves_between_two_configurations_only_and_its_motion_is_certified() -> None:
    own = {"label": "own", "velocity": 2.0, "acceleration": 10.0, "jerk": 100.0, "torque": "robot"}
    moves = FreedomBlock.read({"id": "f", "sets": [{"robot": "panda", "kind": "joints", "count": 1}], "limits": [own]})
    problem = draw(moves.sets[0], moves.limits, 2026, 0)
    limits = moves.limits[0].of(problem[0])
    ours = freedom.solve(moves.sets[0], limits, problem)[0]
    row = solve_by_peer(DRAKE, limits, problem, ours)
    assert row["certified"] and row["own_duration"] <= row["duration"] * (1.0 + 1e-6)
    assert 1.0 <= row["duration"] / ours["duration"] <= 1.1
    line = problem[2]
    said = [
        solve_by_peer(DRAKE, limits, (*problem[:3], line), ours)["outcome"],
        solve_by_peer(DRAKE, replace(limits, torque_rate=1e3), problem, ours)["outcome"],
    ]
    assert "only moves between two configurations" in said[0] and said[1].endswith("torque, torque_rate")


def test_problems_depend_only_on_the_seed_and_their_number() -> None:
    block = FreedomBlock.read({"id": "f", "sets": SETS, "limits": [LIMITS]})
    for part in block.sets:
        one, same, other = (draw(part, block.limits, 1, k)[1:3] for k in (0, 0, 1))
        assert np.array_equal(one[0], same[0]) and one[1].to_dict() == same[1].to_dict()
        assert not np.array_equal(one[0], other[0])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"kind": "joints"}, "freedom: expected none with the kind 'joints'; got 'turn'"),
        ({"freedom": "trun"}, "freedom: expected one of .*turn.*; got 'trun'"),
        ({"kind": "cycle", "freedom": ""}, "home_deg: expected a configuration"),
        ({"kind": "spiral"}, "expected one of regular"),
    ],
)
def test_a_set_that_cannot_be_meant_is_refused(change: dict[str, Any], says: str) -> None:
    with pytest.raises(InvalidInput, match=says):
        FreedomBlock.read({"id": "f", "sets": [SETS[0] | change], "limits": [LIMITS]})
