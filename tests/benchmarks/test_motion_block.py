"""Blocks of motion problems: rows against the certificate and coal, targets, settings, missing files and the report."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.interpolate import PPoly

import optik
from benchmarks.blocks import motion
from benchmarks.blocks.base import load_kind
from benchmarks.blocks.block import Target
from benchmarks.blocks.motion import FIELDS, OF_OMPL, OURS, PYROBOPLAN, ROUNDED, MotionBlock
from benchmarks.peers.base import Absent
from benchmarks.peers.ik.drake import METHOD as DRAKE
from benchmarks.peers.models import list_solids
from benchmarks.peers.pyroboplan_motions import move_by_pyroboplan
from benchmarks.problems.motionbench import MotionProblem, write_problems
from benchmarks.records import Journal, RunFolder
from benchmarks.report.base import Run
from benchmarks.report.motion import REPORT, unsolved_of
from benchmarks.run.session import run_suite
from benchmarks.suite import Suite, load_suite
from optik import Scene
from optik.arm.shapes import Shapes
from optik.errors import InvalidInput, NoSolution
from optik.scene.contact import find_nearest_pairs
from planners import JointLine, MotionLimits, Trajectory, find_path, plan
from tests.outside import hide
from tests.planners.contacts import Oracle

pytest.importorskip("yaml")
JOINT_GOALS = ("VAMP, rounded", "pyroboplan")
SUITE = """
seed = 26
[[motion]]
id = "table"
robot = "panda_hand"
count = {count}
{more}
limits = {{ velocity = "robot", acceleration = "robot", jerk = "robot" }}
"""


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Suite:
    """A suite with three generated problems in a file."""
    folder = tmp_path_factory.mktemp("motion")
    write_problems(folder / "three.tar.bz2", optik.load("panda_hand"), seed=26, count=3)
    (folder / "s.toml").write_text(SUITE.format(count=3, more='problems = "three.tar.bz2"'))
    return load_suite(str(folder / "s.toml"))


@pytest.fixture(scope="module")
def run(suite: Suite, tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("motion") / "run"
    run_suite(suite, folder)
    return Run(RunFolder(folder))


def test_every_method_has_a_row_for_every_problem_and_durations_are_those_of_proved_motions(run: Run) -> None:
    rows = run.of("motion")[0].rows
    assert set(FIELDS) <= set(rows.columns)
    labels = [OURS, *(label for label in ROUNDED if label in rows["method"].to_list())]
    assert rows["method"].to_list() == labels * 3 and len(labels) >= 2
    assert rows["number"].to_list() == [n for n in (1, 1, 2) for _ in labels]
    ours = rows.filter(pl.col("method") == OURS)
    assert ours["solved"].all() and not ours["contact"].any() and not ours["exceeded"].any()
    assert (rows["duration"].is_not_null() == rows["solved"]).all()
    bent = ours.filter(pl.col("edges") > 1)
    assert (
        len(bent) and (bent["over_stops"] == bent["duration"] / bent["stops"]).all() and (bent["over_stops"] < 1).all()
    )
    if OF_OMPL in labels:
        theirs = rows.filter(pl.col("method") == OF_OMPL)["duration"]
        assert (ours["not_longer"] == (ours["duration"] <= theirs * (1.0 + 1e-6))).drop_nulls().all()


def test_a_file_gives_the_problems_that_the_block_generates_from_the_seed(suite: Suite) -> None:
    block, robot = suite.of("motion")[0], optik.load("panda_hand")
    given = block.read_problems(robot, 0)  # the seed of a file does not count
    made = block.model_copy(update={"problems": ""}).read_problems(robot, 26)
    assert [each[:2] for each in given] == [("table_boxes", 1), ("table_cylinders", 1), ("table_boxes", 2)]
    assert [each[:2] for each in given] == [each[:2] for each in made]
    for (_kind, _number, one), (_k, _n, other) in zip(given, made, strict=True):
        assert np.array_equal(one.start, other.start) and one.scene == other.scene


def test_targets_leave_out_problems_whose_ends_are_not_free(run: Run) -> None:
    kind, rows = load_kind("motion"), run.of("motion")[0].rows
    spoiled = rows.with_columns(touched=pl.col("problem") == 0, solved=pl.col("solved") & (pl.col("problem") != 1))
    assert kind.judge(spoiled, Target(measure="solved", at_least=95)) == (50.0, "2 problems")
    assert kind.judge(rows, Target(measure="solved", at_least=95)) == (100.0, "3 problems")


def test_a_peer_that_ended_the_process_has_rows_that_say_so_and_is_at_work_while_it_is_called(
    suite: Suite, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    block, robot = suite.of("motion")[0], optik.load("panda_hand")
    block = block.model_copy(update={"peers": ("OMPL, rounded", "OMPL, toppra", "VAMP, rounded")})
    limits, problem = block.limits.of(robot), block.read_problems(robot, 0)[0][2]
    folder = RunFolder(tmp_path / "run")
    seen: list[tuple[str, str]] = []

    def find(*arguments: Any) -> Any:
        seen.append((arguments[-1], journal.left))
        raise Absent("nothing")

    find_own, polyline = motion.find_polyline, lambda *a: find_own(*a) if a[-1] == "rrt_connect" else find(*a)
    monkeypatch.setattr(motion, "find_polyline", polyline)
    with Journal(folder, "rows/motion/table.journal") as journal:
        journal.crashed["OMPL, rounded"] = "its process ended: SIGSEGV"
        found = dict(motion.solve_by_all(block, robot, limits, problem, journal))
    assert seen == [("vamp", "VAMP, rounded")] and found[OURS]["solved"]
    for label in ("OMPL, rounded", "OMPL, toppra"):
        assert (found[label]["status"], found[label]["reason"]) == ("crashed", "its process ended: SIGSEGV")
    assert set(found) == {OURS, "OMPL, rounded", "OMPL, toppra"}


def test_an_end_in_contact_is_told_and_no_method_is_run() -> None:
    robot = optik.load("panda_hand")
    start = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    goal = start + np.array([0.9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    at = robot.fk(goal)[:3, 3]
    problem = MotionProblem(Scene(spheres=[(at, 0.05)]), start, goal)
    assert "the goal is in contact" in motion.find_touching_end(robot, problem)
    assert "the start is in contact" in motion.find_touching_end(robot, MotionProblem(problem.scene, goal, start))
    beyond = start + np.array([9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert "outside the joint limits" in motion.find_touching_end(robot, MotionProblem(Scene(), start, beyond))
    assert not motion.find_touching_end(robot, MotionProblem(Scene(), start, goal))


def test_a_motion_in_contact_or_over_a_limit_is_counted_and_has_no_duration() -> None:
    robot = optik.load("panda_hand")
    start = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    goal = start + np.array([0.9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    middle, limits = robot.fk(start + 0.5 * (goal - start))[:3, 3], MotionLimits(2.0, 10.0, 100.0)
    straight = find_path(robot, start, goal, scene=Scene(), paths=1)
    made = motion.time_rounded(robot, limits, Scene(spheres=[(middle, 0.05)]), straight, "optimal")
    row = motion._judge(made, 1.0, robot)
    assert row["contact"] and not row["exceeded"] and not row["solved"] and row["duration"] is None
    fast = plan(robot, JointLine(robot, start, goal), start, limits=limits, timing="quintic", scene=Scene())
    row = motion._judge(fast, 1.0, robot)
    assert row["exceeded"] and not row["contact"] and not row["solved"] and row["duration"] is None
    assert motion._judge(None, 1.0, robot)["status"] == "timing_infeasible"


def test_a_goal_pose_is_planned_and_its_motion_measured_and_peers_that_need_joints_have_no_row(suite: Suite) -> None:
    robot, block = (
        optik.load("panda_hand"),
        suite.of("motion")[0].model_copy(update={"rules": "curobo", "peers": ("own, rounded", *JOINT_GOALS)}),
    )
    problem = block.read_problems(robot, 26)[0][2]
    assert problem.goal.shape == (4, 4) and not motion.find_touching_end(robot, problem)
    limits = MotionLimits(2.0, 10.0, 100.0)
    rows = dict(motion.solve_by_all(block, robot, limits, problem))
    assert list(rows) == [OURS, "own, rounded"] and rows[OURS]["solved"]
    made = plan(robot, problem.goal, problem.start, limits=limits, scene=problem.scene, avoid=True, winding="exact")
    q, t = made.trajectory, np.linspace(0.0, made.trajectory.duration, 20_001)
    length, power = (
        np.linalg.norm(np.diff(q(t), axis=0), axis=1).sum(),
        np.abs(robot.torques(q(t), q(t, 1), q(t, 2)) * q(t, 1)),
    )
    assert abs(rows[OURS]["travel"] - length) <= 2e-3 * length
    assert abs(rows[OURS]["energy"] - np.trapezoid(power.sum(1), t)) <= 2e-3 * rows[OURS]["energy"]


def test_peers_without_their_packages_have_no_rows(
    suite: Suite, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    block, robot = suite.of("motion")[0].model_copy(update={"peers": (*ROUNDED, PYROBOPLAN)}), optik.load("panda_hand")
    monkeypatch.setenv("OPTIK_PEERS", str(tmp_path))
    hide(monkeypatch, "ompl", "vamp")
    problem = block.read_problems(robot, 0)[0][2]
    labels = [label for label, _ in motion.solve_by_all(block, robot, block.limits.of(robot), problem)]
    assert labels == [OURS, "own, rounded"]


def test_a_waypoint_in_an_obstacle_and_an_exceeded_limit_of_another_package_are_seen(
    suite: Suite, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = optik.load("panda_hand")
    limits, problem = MotionLimits.of(robot), suite.of("motion")[0].read_problems(robot, 0)[0][2]
    free = find_path(robot, problem.start, problem.goal, scene=problem.scene).vertices
    moved = free.copy()
    moved[1, 1] += 0.6  # the shoulder, towards the table
    assert find_nearest_pairs(robot, problem.scene, moved)[0].argmin() == 1
    slower = MotionLimits(0.99 * limits.velocity, limits.acceleration)
    for path, allowed, judged in (
        (free, limits, (True, False, False)), (moved, limits, (False, True, False)), (free, slower, (False, False, True))
    ):  # fmt: skip
        each = [plan(robot, JointLine(robot, a, b), a, limits=limits).trajectory for a, b in pairwise(path)]
        knots = np.cumsum([0.0, *np.concatenate([np.diff(one.knots) for one in each])])
        made = Trajectory(PPoly(np.concatenate([one.padded for one in each], axis=1), knots))
        monkeypatch.setattr(motion, "move_by_pyroboplan", lambda *_, path=path, made=made: (path, made, 1.0, 2.0))
        row = motion.solve_by_pyroboplan(robot, allowed, problem)
        assert (row["solved"], row["contact"], row["exceeded"]) == judged and (row["search_ms"], row["ms"]) == (
            1.0,
            2.0,
        )
        assert row["duration"] == (made.duration if judged[0] else None) and bool(row["reason"]) != judged[0]


@pytest.mark.skipif(bool(DRAKE.missing()), reason="Drake has no environment here")
def test_pyroboplan_moves_around_the_obstacles_and_is_certified(suite: Suite) -> None:
    robot = optik.load("panda_hand")
    limits, problem = MotionLimits.of(robot), suite.of("motion")[0].read_problems(robot, 0)[0][2]
    path, *_ = move_by_pyroboplan(robot, limits, problem.scene, (problem.start, problem.goal))
    q = np.concatenate([np.linspace(a, b, 1 + int(20 * np.linalg.norm(b - a))) for a, b in pairwise(path)])
    assert find_nearest_pairs(robot, problem.scene, q)[0].min() > 1e-3  # it keeps 2 mm at other samples
    row = motion.solve_by_pyroboplan(robot, limits, problem)
    assert row["solved"] and row["edges"] >= 2 and 0.0 < row["search_ms"] <= row["ms"]
    assert "limits of velocity" in motion.solve_by_pyroboplan(robot, MotionLimits(2.0), problem)["reason"]


def test_vamp_finds_paths_for_an_arm_with_its_joints_and_spheres_only() -> None:
    if find_spec("vamp") is None:  # it has no wheels: who compares with it builds it
        with pytest.raises(Absent, match="pip install vamp-planner"):
            motion.find_polyline(optik.load("panda"), Scene(), (np.zeros(7), np.ones(7)), "vamp")
        return
    vamp = import_module("vamp")
    panda, rest = optik.load("panda"), np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    spheres = Shapes([(0, np.zeros(3), 0.01)] * vamp.panda.n_spheres())
    arm = optik.Robot.from_dict(panda.to_dict() | {"joint_names": vamp.panda.joint_names()}).with_shapes(spheres)
    wall = np.eye(4)
    wall[:3, 3] = [0.5, 0.0, 0.45]
    scene, ends = Scene(boxes=[(wall, (0.5, 0.02, 0.7))]), (rest - 0.9 * np.eye(7)[0], rest + 0.9 * np.eye(7)[0])
    found = motion.find_polyline(arm, scene, ends, "vamp")
    assert found and np.array_equal(found.vertices[[0, -1]], ends)
    q = np.concatenate([np.linspace(a, b, 20) for a, b in pairwise(found.vertices)])
    assert find_nearest_pairs(panda, scene, q)[0].min() > -0.03  # our capsules are wider than the spheres
    blocked = motion.find_polyline(arm, Scene(spheres=[(arm.fk(ends[1])[:3, 3], 0.1)]), ends, "vamp")
    assert not blocked and "an end is in contact" in blocked.reason
    for other in (panda, panda.with_shapes(spheres), arm.with_shapes(panda.shapes)):
        with pytest.raises(Absent, match="no sphere model"):
            motion.find_polyline(other, scene, ends, "vamp")


def test_objects_are_solids_of_coal_at_the_same_places() -> None:
    coal = pytest.importorskip("coal")
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]], [0.5, 0.1, 0.3]
    a, b = np.array([0.4, -0.4, 0.2]), np.array([0.5, -0.2, 0.6])
    scene = Scene(boxes=[(T, (0.1, 0.2, 0.3))], spheres=[(a, 0.05)], capsules=[(a, b, 0.04)], cylinders=[(b, a, 0.03)])
    point, at = coal.Sphere(1e-9), coal.Transform3s(np.eye(3), np.array([0.6, 0.3, 0.9]))
    oracle = Oracle(optik.load("panda_hand"), scene).bodies
    for (kind, sizes, place), (shape, there, *_) in zip(list_solids(scene), oracle, strict=True):
        ours = getattr(coal, kind)(*sizes), coal.Transform3s(place[:3, :3].copy(), place[:3, 3].copy())
        requests = coal.DistanceRequest(), coal.DistanceResult()
        one, other = (coal.distance(*each, point, at, *requests) for each in (ours, (shape, there)))
        assert one == pytest.approx(other, abs=1e-6) and one > 0.1
    with pytest.raises(NoSolution, match="only boxes"):
        list_solids(Scene(planes=[((0, 0, 0), (0, 0, 1))]))


def test_the_report_has_the_methods_the_unsolved_problems_and_the_plots(run: Run) -> None:
    (table,) = REPORT.tables(run)
    assert table.rows[0]["label"] == OURS and table.rows[0]["problems"] == 3 and table.rows[0]["solved"][0] == 100.0
    shown = REPORT.sections[0].build(run)
    assert shown is not None and [board.id for board in shown["boards"]] == ["motion-board"]
    assert {trace.name for trace in shown["boards"][0].figures[0].data} >= {OURS}
    assert "3 of 3 motions" in REPORT.findings(run)[0]


def test_problems_without_a_proved_motion_are_listed_with_their_reason(run: Run) -> None:
    b = run.of("motion")[0]
    failed = b.rows.with_columns(solved=pl.col("problem") != 1, reason=pl.lit("too narrow"))
    table = unsolved_of(replace(b, rows=failed))
    assert [(row["problem"], row["reason"]) for row in table.rows] == [("table_cylinders 1", "too narrow")]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ('problems = "none.tar.bz2"', "github.com/KavrakiLab/vamp"),
        ('peers = ["OMPL"]', "OMPL, rounded"),
        ("count = 0", "count"),
        ('robot = "kr6"', "shapes"),
    ],
)
def test_wrong_settings_are_refused_in_one_line(more: str, said: str, tmp_path: Path) -> None:
    given = {
        "id": "table",
        "robot": "panda_hand",
        "count": 2,
        "limits": {"velocity": 2.0, "acceleration": 10.0, "jerk": 100.0},
    }
    key, value = more.split(" = ")
    given[key] = eval(value)  # the literal above
    with pytest.raises(InvalidInput) as caught:
        load_kind("motion").prepare(MotionBlock.read(given), 1)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_the_shipped_suites_are_read_without_the_files_and_have_the_peer_that_targets_compare() -> None:
    for name in ("motionbench", "motionbench-quick"):
        (block,) = load_suite(name).of("motion")
        assert OF_OMPL in block.labels
