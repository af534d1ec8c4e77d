"""The executed cell as a kind of suite block: settings, the same rows for any number of workers, and what the report shows."""

from __future__ import annotations

import copy
import json
import math
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import optik
from benchmarks.blocks import cell
from benchmarks.blocks.base import Session, load_kind
from benchmarks.blocks.cell import CellBlock, Noise, Spots, SpotTrials, errors_of, plant_of, trial_facts, trial_of
from benchmarks.experiments.base import FAILS, HOLDS, PARTLY, UNTESTED
from benchmarks.experiments.claims import executed_claims, needed_budgets
from benchmarks.records import RunFolder
from benchmarks.report.base import Run, load_report
from benchmarks.report.page import write_report
from benchmarks.run import run_suite
from benchmarks.suite import Suite, suite_of
from optik.errors import InvalidInput, UnknownName
from optik.ik import make_solver
from planners.cell.outcome import ErrorSplit
from planners.paths.line import Line

START = [20, -35, 40, 25, 50, -30]
NOISE = {"laser_angle": 2e-4, "laser_range": 5e-4, "laser_position": 2e-4, "friction": 0.1, "payload": 0.05}
SMALL: dict[str, Any] = {
    "seed": 7,
    "cell": [
        {
            "id": "spots", "robot": "paper6r", "drive": "ideal", "payload": 1.0, "set": "graph_paper",
            "count": 5, "budgets": [1, 3], "noise": NOISE,
            "options": {
                "start_deg": START, "normals": ["Y"], "half_size_m": 0.1, "spacing_m": 0.1, "reference_restarts": 1
            },
            "methods": [
                {"solver": "dls"}, {"solver": "dls", "along": True, "max_problems": 1},
                {"label": "line", "solver": "lm", "whole": True, "max_problems": 2},
            ],
            "targets": [{"method": "line", "measure": "worst_split_m", "at_most": 1e-12}],
        },
    ],
}  # fmt: skip


def small() -> Suite:
    return suite_of("small", SMALL)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return run_suite(small(), tmp_path_factory.mktemp("cell") / "run")


def rows(run: RunFolder) -> pl.DataFrame:
    found = run.rows("cell", "spots")
    assert found is not None
    return found


def test_two_workers_give_the_rows_of_one(run: RunFolder, tmp_path: Path) -> None:
    with ThreadPoolExecutor(2) as two:
        both = run_suite(small(), tmp_path / "both", executor=two)
    assert rows(both).equals(rows(run))


def test_every_trial_is_executed_and_its_error_is_the_sum_of_its_parts(run: RunFolder) -> None:
    spots = rows(run)
    assert spots.columns[:3] == ["block", "method", "problem"]
    assert set(spots.columns) >= {*Spots.fields, "group", "known", "x", "y", "z", "distance"}
    assert spots.group_by("method").len().sort("method").rows() == [
        ("dls, 1 iteration", 5), ("dls, 3 iterations", 5), ("dls, at each pose, 1 iteration", 1),
        ("dls, at each pose, 3 iterations", 1), ("line", 2),
    ]  # fmt: skip
    assert spots.filter(pl.col("along"))["setting"].unique().to_list() == ["dls, at each pose"]
    assert set(spots["status"]) == {"executed"}
    for axis in "xyz":
        total = spots.select(
            s=pl.sum_horizontal(*(pl.col(f"{part}_{axis}") for part in ("laser", "ik", "path", "servo")))
        )
        np.testing.assert_allclose(total["s"], spots[f"error_{axis}"], atol=1e-12, rtol=0.0)
    assert spots["split_rest"].max() <= 1e-12  # type: ignore[operator]
    line = spots.filter(pl.col("method") == "line")
    assert line["position_error"].max() < 5e-3  # type: ignore[operator]
    by_iteration = (
        spots.filter(pl.col("setting") == "dls").group_by("budget").agg(pl.col("ik_error").median()).sort("budget")
    )
    assert by_iteration["ik_error"][1] < 0.01 * by_iteration["ik_error"][0]
    # all methods see the same reading of a spot
    assert spots.group_by("problem", "repeat").agg(pl.col("laser_x").n_unique())["laser_x"].to_list() == [1] * 5


def test_the_report_has_the_claims_the_noise_and_the_table_of_spots(run: RunFolder) -> None:
    page = write_report(run).read_text(encoding="utf-8")
    for words in ("The paper&#39;s claims, as executed", "Fig. 11, 12 and 13 as executed", "payload, uniform ±5 %"):
        assert words in page, words
    read = Run(run)
    tables = {table.id: table for table in load_report(load_kind("cell")).tables(read)}
    assert list(tables) == ["cell-spots-spots"]
    by_hand = rows(run).filter((pl.col("method") == "dls, 1 iteration") & pl.col("known"))["position_error"]
    assert tables["cell-spots-spots"].rows[0]["error"] == pytest.approx(1e3 * by_hand.median())  # type: ignore[operator]
    assert [o.held for o in read.outcomes] == [True]


# ---------------------------------------------------------------- noise


def test_a_trial_depends_on_its_number_alone_and_stays_inside_its_noise() -> None:
    block = CellBlock.read(SMALL["cell"][0])
    first, again = (trial_of(block, 7, 3, 0) for _ in range(2))
    other = trial_of(block, 7, 4, 0)
    assert first.plant == again.plant
    assert first.rng.normal() == again.rng.normal()
    assert first.plant != other.plant
    robot, rng = first.robot, np.random.default_rng(1)
    plants = [plant_of(robot, Noise(friction=0.1, payload=0.05), rng) for _ in range(200)]
    factors = np.array([p.inertia.coulomb / robot.inertia.coulomb for p in plants if p.inertia is not None])
    masses = np.array([p.payload.masses[-1] for p in plants if p.payload is not None])
    assert 0.9 <= factors.min() < 0.905 < 1.095 < factors.max() <= 1.1
    assert 0.95 <= masses.min() < 0.955 < 1.045 < masses.max() <= 1.05


def test_the_parts_of_an_error_go_into_the_rows_as_they_are() -> None:
    parts = [np.array(p) for p in ([1.0, 2, 2], [0.0, 3, 4], [0.0, 0, 0], [1.0, 0, 0])]
    row = errors_of(ErrorSplit(*parts, np.array([2.0, 5, 6.5])))
    assert [row[f"{p}_error"] for p in ("laser", "ik", "path", "servo")] == [3.0, 5.0, 0.0, 1.0]
    assert row["split_rest"] == 0.5
    assert (row["ik_y"], row["error_z"], row["position_error"]) == (3.0, 6.5, math.sqrt(4 + 25 + 42.25))


def test_work_that_is_divided_has_the_rows_of_the_whole_method_by_method(tmp_path: Path) -> None:
    (settings,), kind, folder = small().of("cell"), Spots(), RunFolder(tmp_path)
    shards = list(kind.shards(settings, Session(kind, settings, 7, folder, kind.prepare(settings, 7))))
    work: Any = shards[0].work
    todo, alone = [work], []
    while todo:
        one = todo.pop()
        halves = () if one.owner else one.halves()
        todo += halves
        alone += [] if halves else [one]
    assert sorted(one.owner for one in alone) == sorted(work.labels)
    own, whole, keys = pl.concat([one.solve() for one in alone]), work.solve(), ["problem", "method", "repeat"]
    assert own.sort(keys).equals(whole.sort(keys))
    assert {row["method"] for one in alone for row in one.kind.keys(one)} == set(whole["method"])


@pytest.mark.soak
def test_a_method_that_ends_its_process_costs_its_own_rows_alone(tmp_path: Path) -> None:
    (tmp_path / "deadly.py").write_text(
        "import os\nfrom optik.ik import IKSolver\n\nclass Deadly(IKSolver):\n"
        "    def attempt(self, *a, **k):\n        os._exit(3)\n\nMETHOD = Deadly\n"
    )
    settings = copy.deepcopy(SMALL)
    settings["cell"] = [settings["cell"][0] | {"count": 2, "budgets": [1]}]
    del settings["cell"][0]["targets"]
    settings["cell"][0]["methods"] = [{"solver": str(tmp_path / "deadly.py"), "label": "deadly"}, {"solver": "dls"}]
    suite = replace(suite_of("small", settings), allow_plugins=True)
    found = run_suite(suite, tmp_path / "run", workers=2)
    spots = rows(found).group_by("setting", "status").len().sort("setting").rows()
    assert spots == [("deadly", "crashed", 2), ("dls", "executed", 2)]
    assert {one["why"] for one in found.manifest()["failed"]} == {"deadly: its process ended: exit status 3"}


def test_a_process_that_ends_leaves_rows_that_say_so(run: RunFolder) -> None:
    block = CellBlock.read(SMALL["cell"][0])
    work = SpotTrials(
        Spots(), block, 7, (0, 1), tuple(method.label for method in block.methods), repeat=0,
        targets=np.tile(np.eye(4), (2, 1, 1)), start=np.zeros(6), given=((True, False, True), (True, False, False)),
        pictured=(),
    )  # fmt: skip
    crashed = work.crashed()
    assert crashed.columns == list(Spots.fields)
    assert crashed.select("problem", "method", "status").rows() == [
        (0, "dls, 1 iteration", "crashed"), (0, "dls, 3 iterations", "crashed"), (0, "line", "crashed"),
        (1, "dls, 1 iteration", "crashed"), (1, "dls, 3 iterations", "crashed"),
    ]  # fmt: skip
    halves = pl.concat([part.crashed() for part in work.halves()])
    assert halves.sort("problem", maintain_order=True).equals(crashed)


# ---------------------------------------------------------------- settings


def changed(**changes: Any) -> Any:
    data = copy.deepcopy(SMALL["cell"][0])
    data.update(changes)
    return {key: value for key, value in data.items() if value is not None}


@pytest.mark.parametrize(
    ("data", "error", "says"),
    [
        (changed(what="spot"), InvalidInput, r"^cell 'spots': what: expected one of spots; got 'spot'$"),
        (changed(budgts=[1]), InvalidInput, r"expected 'budgets', .*got the key 'budgts'"),
        (changed(cycles=3), InvalidInput, r"the key 'cycles'"),
        (changed(budgets=[3, 1]), InvalidInput, r"budgets: expected whole numbers"),
        (changed(count=0), InvalidInput, r"count: expected a whole number ≥ 1; got 0"),
        (changed(drive="ros"), InvalidInput, r"drive: expected one of auto, ideal, mujoco; got 'ros'"),
        (changed(laser_m=[1, 2]), InvalidInput, r"laser_m: expected three numbers"),
        (changed(noise={"friction": 1.5}), InvalidInput, r"friction: expected a number below 1; got 1\.5"),
        (changed(noise={"laser_angle": -1e-3}), InvalidInput, r"laser_angle: expected a number, 0 or more"),
        (changed(noise={"laser_angle": math.nan}), InvalidInput, "laser_angle"),
        (changed(noise={"lazer_angle": 1}), InvalidInput, "expected 'laser_angle'"),
        (changed(payload=None), InvalidInput, "no `payload` of the block"),
        (changed(methods=[{"solver": "dsl"}]), UnknownName, "dls"),
        (
            changed(methods=[{"solver": "dls", "options": {"max_iterations": 3}}]), InvalidInput,
            "budgets in place of it",
        ),
        (changed(targets=[{"measure": "rp_mm", "at_most": 1}]), InvalidInput, "measure 'rp_mm'"),
        (changed(period=0), InvalidInput, r"period: expected seconds above 0; got 0"),
    ],
)  # fmt: skip
def test_a_wrong_value_is_one_line_that_names_it(data: Any, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says) as caught:
        load_kind("cell").settings(data)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (changed(options={"start_deg": START, "halfsize": 1}), "halfsize"),
        (changed(robot="ur5e"), "cell 'spots': robot: limits: expected limits on jerk"),
    ],
)
def test_what_only_trying_shows_is_refused_before_anything_is_written(data: Any, says: str) -> None:
    kind = load_kind("cell")
    with pytest.raises(InvalidInput, match=says):
        kind.prepare(kind.settings(data), 0)


@pytest.mark.parametrize("what", ["iso", "laws"])
def test_a_type_of_an_earlier_version_is_refused_in_a_suite_and_left_out_of_the_report_of_its_run(
    run: RunFolder, tmp_path: Path, what: str
) -> None:
    old = {"id": "old", "what": what, "robot": "paper6r", "start_deg": START}
    with pytest.raises(InvalidInput, match=rf"^cell 'old': what: expected spots, or .*; got '{what}' of an earlier"):
        suite_of("old", {"cell": [SMALL["cell"][0] | {"what": "spots"}, old]})
    shutil.copytree(run.path, tmp_path / "run")
    manifest = run.manifest()
    manifest["settings"]["cell"].append(old)
    (tmp_path / "run/run.json").write_text(json.dumps(manifest), encoding="utf-8")
    (block,) = Run(RunFolder(tmp_path / "run")).of("cell")
    assert block.rows.equals(Run(run).of("cell")[0].rows)


# ---------------------------------------------------------------- the claims


def drawn(
    error: Any, *, budgets: tuple[int, ...] = (1, 2, 4, 8), count: int = 500, other: float = 1e-5, along: bool = False
) -> pl.DataFrame:
    """Rows of dls whose error on each axis is a function of distance and budget, and whose other parts are small."""
    distance = np.random.default_rng(5).uniform(0.05, 0.5, count)
    frames = []
    for budget in budgets:
        e = error(distance, budget)
        frames.append(
            pl.DataFrame(
                {
                    "problem": np.arange(count), "repeat": 0, "solver": "dls", "setting": "dls", "budget": budget,
                    "drive": "ideal", "known": True, "along": along, "distance": distance,
                    "error_x": e, "error_y": -e, "error_z": 0.5 * e,
                    "position_error": 1.5 * e, "ik_error": 1.5 * e, "laser_error": other, "path_error": 0.0,
                    "servo_error": 0.0,
                }
            )
        )  # fmt: skip
    return pl.concat(frames)


@pytest.mark.parametrize(
    ("error", "verdicts"),
    [
        (lambda d, k: 0.2 * d * 0.2**k, (HOLDS, HOLDS, HOLDS)),
        (lambda d, k: np.where(d < 0.4, 1e-4, 0.1) + 0 * d, (PARTLY, FAILS, FAILS)),
        (lambda d, k: 0.1 + 0 * d, (FAILS, UNTESTED, FAILS)),
        (lambda d, k: 1e-6 + 0 * d, (HOLDS, FAILS, UNTESTED)),
    ],
)
def test_the_claims_as_executed_can_come_out_in_every_way(error: Any, verdicts: tuple[str, ...]) -> None:
    found = executed_claims(drawn(error))
    assert [f.key for f in found] == ["a", "b", "c"]
    for finding, verdict in zip(found, verdicts, strict=True):
        assert finding.verdict.startswith(verdict), (finding.verdict, finding.summary)


def test_both_readings_of_section_4_1_are_judged_each_by_its_own_trials() -> None:
    single, each = drawn(lambda d, k: 0.2 * d * 0.2**k), drawn(lambda d, k: 1e-6 + 0 * d, along=True)
    found = executed_claims(pl.concat([single, each]))
    assert [f.key for f in found] == ["a", "b", "c"] * 2
    assert [f.verdict for f in found] == [HOLDS, HOLDS, HOLDS, HOLDS, FAILS, UNTESTED]
    for i, f in enumerate(found):
        reading = ("one solve of k iterations", "k iterations at each pose")[i // 3]
        assert reading in f.claim and f.summary.startswith(reading)


def test_iterations_at_each_pose_follow_the_line_with_the_lag_of_their_step() -> None:
    """One step of size α leaves (1 - α) of the error, so with δ a pose the error tends to δ (1 - α) / α: 3 δ for a quarter."""
    robot = optik.load("paper6r")
    q, T = np.deg2rad(START), robot.fk(np.deg2rad(START))
    goal = T.copy()
    goal[:3, 3] += [-0.12, 0.0, 0.2]
    line = Line(T, goal)
    for step, k, left in ((0.25, 1, 0.75), (0.25, 2, 0.75**2), (0.5, 1, 0.5)):
        solver = make_solver(robot, "dls", step=step, damping=1e-4, max_iterations=k, max_restarts=0)
        answers = cell.answers_along(line, q, solver)
        assert len(answers) == 151 and (answers[0] == q).all()
        off = goal[:3, 3] - robot.fk(answers[-1])[:3, 3]
        lag = line.end / 150.0 * left / (1.0 - left)
        assert np.linalg.norm(off - lag * np.array([-0.12, 0.0, 0.2]) / line.end) < 0.02 * lag
        planned = cell.plan_through(robot, line, answers, "dls", "optimal")
        assert planned and np.abs(planned.trajectory(planned.trajectory.end) - answers[-1]).max() < 1e-12
        np.testing.assert_allclose(planned.joint_path(np.linspace(0.0, line.end, 151)), answers, atol=1e-12)


def test_too_few_trials_neither_prove_nor_refute_that_all_are_within_two_millimetres() -> None:
    good = executed_claims(drawn(lambda d, k: 1e-4 * d, count=12))[0]
    assert good.verdict == UNTESTED and "Too few" in good.summary
    assert executed_claims(drawn(lambda d, k: 0.1 + 0 * d, count=12))[0].verdict == FAILS


def test_the_iterations_that_a_spot_needs_are_those_from_which_on_it_is_reached() -> None:
    axis = {"once": [1.0, 1e-3, 5e-3, 1e-3], "early": [1e-3] * 4, "never": [1e-3, 1e-3, 1e-3, 3e-3]}
    rows = pl.concat(
        pl.DataFrame({"problem": name, "repeat": 0, "distance": 0.1, "budget": [1, 2, 4, 8], "axis": errors})
        for name, errors in axis.items()
    )
    assert dict(needed_budgets(rows).select("problem", "needed").iter_rows()) == {"once": 8, "early": 1}


def test_a_motion_that_was_not_executed_counts_as_missed() -> None:
    good = drawn(lambda d, k: 1e-4 * d)
    lost = good.with_columns(
        pl.when(pl.col("problem") < 250).then(None).otherwise(pl.col(c)).alias(c)
        for c in ("error_x", "error_y", "error_z", "position_error")
    )
    assert executed_claims(good)[0].verdict == HOLDS
    finding = executed_claims(lost)[0]
    assert finding.verdict == FAILS
    assert "250 were not executed" in finding.summary
    assert "50.0 %" in finding.summary


def test_facts_of_an_execution_are_those_of_its_arrays() -> None:
    from planners import plan
    from planners.cell.drives import make_drive

    robot = optik.load("paper6r")
    q = np.deg2rad(START)
    execution = make_drive("ideal", robot).execute(plan(robot, q + 0.02, q, timing="smooth"))
    moved = copy.copy(execution)
    off = np.zeros_like(execution.q)
    off[len(off) // 2, 3] = 1e-3
    object.__setattr__(moved, "q", execution.q + off)
    object.__setattr__(moved, "torque", np.full_like(execution.q, 2.0))
    facts = trial_facts(moved)
    assert facts["tracking_rad"] == pytest.approx(1e-3, rel=1e-3)
    assert facts["tracking_joint"] == robot.joint_names[3]
    way = np.abs(execution.q[-1] - execution.q[0]).sum()
    assert facts["energy"] == pytest.approx(2.0 * way, rel=1e-3)  # constant torque times the way of each joint
    object.__setattr__(moved, "torque", np.full_like(execution.q, -2.0))
    assert trial_facts(moved)["energy"] == pytest.approx(
        0.0, abs=1e-6
    )  # all joints brake, and braking gives nothing back
    bound = np.abs(execution.plan.certificate.torque.value)
    assert facts["torque_ratio"] == pytest.approx(2.0 / bound.min(), rel=1e-12)
    assert trial_facts(execution)["torque_ratio"] is None
