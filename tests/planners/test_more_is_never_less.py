"""More is never less: what is solved stays solved, and takes no longer, with more freedom, its own start or more time."""

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import optik
from optik import Robot, Scene, se3
from optik.errors import InvalidInput
from optik.types import Array
from planners import Arc, Line, MotionLimits, Plan, Polyline, free, plan
from planners.following.branches import CollisionCheck
from planners.following.resolve import graph
from planners.following.resolve.freedoms import Resolver
from planners.paths.base import Path

ARMS = ("ur5e", "kr6", "irb120", "panda", "iiwa14", "fr3", "gen3lite")
SEAM_ARMS = ("ur5e", "kr6", "irb120", "paper6r")
LIMITS = MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)
LONGER = 1.002
"""Most that a duration may grow: the accuracy with which the choice ends its iteration."""
FAR = 0.2
"""Least distance [m] from the motion of an obstacle that must not matter."""
TURN = (-1.6, 1.6)
SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(max_examples=settings().max_examples // 8)


def draw(seed: int) -> tuple[Robot, Path, Array]:
    """Return an arm, a line, an arc or a polyline near the middle of its ranges that it can follow, and a start."""
    rng = np.random.default_rng(seed)
    robot = optik.load(ARMS[rng.integers(len(ARMS))])
    half = np.minimum(np.where(robot.limits.bounded, robot.limits.half, np.pi), 2.0)
    while True:
        q = robot.limits.middle + 0.6 * half * rng.uniform(-1.0, 1.0, robot.n)
        poses = [robot.fk(q)]
        for _ in range(3):
            pose, step = poses[-1].copy(), rng.normal(size=3)
            pose[:3, 3] += rng.uniform(0.04, 0.15) * step / np.linalg.norm(step)
            pose[:3, :3] = se3.exp_so3(0.2 * rng.normal(size=3)) @ pose[:3, :3]
            poses.append(pose)
        try:
            path = (
                Line(*poses[:2]),
                Arc.through(poses[0], poses[1][:3, 3], poses[2]),
                Polyline(poses, blend=0.01),
            )[rng.integers(3)]
        except InvalidInput:
            continue
        if robot.singular_values(q)[-1] > 0.05 and plan(robot, path, q, limits=LIMITS, resolve="local"):
            return robot, path, q


def widened(path: Path, rng: np.random.Generator) -> list[Path]:
    """Return the path with more and more freedom."""
    turn, tilt = rng.uniform(0.1, 1.5), rng.uniform(0.02, 0.2)
    wide = turn * rng.uniform(1.1, 2.0)
    return [
        path, free(path, turn=turn), free(path, turn=(-turn, wide)), free(path, turn=wide, tilt=tilt),
        free(path, turn=wide, tilt=tilt * rng.uniform(1.1, 2.0)),
    ]  # fmt: skip


def assert_not_less(found: Plan, before: Plan) -> None:
    assert not before or found, found
    if before:
        assert found.duration <= LONGER * before.duration


# ---------------------------------------------------------------- properties
def check_freedoms(seed: int, *, held: bool) -> None:
    robot, path, q = draw(seed)
    before = None
    for wider in widened(path, np.random.default_rng(seed)):
        found = plan(robot, wider, q if held else None, limits=LIMITS)
        if before is not None:
            assert_not_less(found, before)
        before = found


@given(SEEDS)
@FEW
def test_more_freedom_from_a_start_is_never_less(seed: int) -> None:
    check_freedoms(seed, held=True)


@pytest.mark.soak
@given(SEEDS)
@FEW
def test_more_freedom_without_a_start_is_never_less(seed: int) -> None:
    check_freedoms(seed, held=False)


@pytest.mark.soak
@given(SEEDS)
@FEW
def test_its_own_start_is_never_less(seed: int) -> None:
    robot, path, _q = draw(seed)
    rng = np.random.default_rng(seed)
    more: dict[str, Any] = {"elbow": True} if robot.n > 6 and rng.integers(2) else {}
    path = free(path, turn=rng.uniform(0.1, 2.0), **more)
    before = plan(robot, path, limits=LIMITS)
    assert_not_less(plan(robot, path, before.trajectory(0.0), limits=LIMITS), before)


@pytest.mark.soak
@given(SEEDS)
@FEW
def test_more_time_is_never_less(seed: int) -> None:
    robot, path, _q = draw(seed)
    path, rng = free(path, turn=True), np.random.default_rng(seed)
    before = plan(robot, path, limits=LIMITS, time_limit=float(rng.uniform(1e-4, 0.2)))
    assert_not_less(plan(robot, path, limits=LIMITS, time_limit=1e6), before)


def far_box(robot: Robot, found: Plan, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return a box that stays away from a motion."""
    q = found.trajectory(np.linspace(0.0, found.duration, 100))
    while True:
        box = se3.pose(p=rng.uniform(-1.5, 1.5, 3)), rng.uniform(0.05, 0.3, 3)
        wide = box[0], box[1] + 2.0 * FAR
        if CollisionCheck(robot, Scene(boxes=[wide])).find_rooms(q).min() > 0.0:
            return box


def check_far_box(seed: int, *, held: bool) -> None:
    robot, path, q = draw(seed)
    assume(robot.shapes is not None)
    start, rng = q if held else None, np.random.default_rng(seed)
    path = free(path, turn=rng.uniform(0.1, 1.5))
    before = plan(robot, path, start, limits=LIMITS, scene=Scene())
    assume(bool(before))
    scene = Scene(boxes=[far_box(robot, before, rng)])
    assert_not_less(plan(robot, path, start, limits=LIMITS, scene=scene), before)


@given(SEEDS)
@FEW
def test_an_obstacle_far_from_a_motion_does_not_matter(seed: int) -> None:
    check_far_box(seed, held=True)


@pytest.mark.soak
@given(SEEDS)
@FEW
def test_an_obstacle_far_from_a_motion_without_a_start_does_not_matter(seed: int) -> None:
    check_far_box(seed, held=False)


# ---------------------------------------------------------------- seams
def cases(*quick: int) -> list[Any]:
    """Return 24 cases, of which only some are quick enough for every run."""
    return [pytest.param(case, marks=[] if case in quick else pytest.mark.soak) for case in range(24)]


def seam(case: int) -> tuple[Robot, Polyline, Array]:
    """Return an arm, 41 poses that a joint motion sweeps, turned away by up to 1.5 rad, and the motion's start."""
    robot, rng = optik.load(SEAM_ARMS[case % 4]), np.random.default_rng([24, case])
    while True:
        way = np.cumsum([0.7 * robot.limits.sample(rng, 1)[0], *rng.uniform(-0.6, 0.6, (3, robot.n))], axis=0)
        q = CubicSpline(np.linspace(0.0, 1.0, 4), way)(np.linspace(0.0, 1.0, 41))
        if not robot.limits.contains(q).all() or robot.singular_values(q)[:, -1].min() < 0.03:
            continue
        poses = robot.fk(q)
        angle = 1.5 * np.sin(rng.uniform(2.0, 5.0) * np.linspace(0.0, 1.0, 41) + rng.uniform(0.0, 6.0))
        poses[:, :3, :3] = poses[:, :3, :3] @ Rotation.from_euler("z", -angle[:, None]).as_matrix()
        try:
            return robot, Polyline(poses, blend=1e-3), q[0]
        except InvalidInput:
            continue


@pytest.mark.parametrize("case", cases(8))
def test_a_narrow_tilt_loses_no_seam(case: int) -> None:
    robot, path, _q = seam(case)
    for more in ({}, {"tilt": 0.03}):
        found = plan(robot, free(path, turn=TURN, **more), limits=LIMITS)
        assert found, found


@pytest.mark.parametrize("case", cases(7))
def test_the_start_that_a_plan_chose_is_one_that_can_be_given(case: int) -> None:
    robot, path, _q = seam(case)
    path = free(path, turn=TURN)
    before = plan(robot, path, limits=LIMITS)
    found = plan(robot, path, before.trajectory(0.0), limits=LIMITS)
    assert_not_less(found, before)
    np.testing.assert_allclose(found.trajectory(0.0), before.trajectory(0.0), atol=1e-6)


@pytest.mark.parametrize("case", cases(9))
def test_a_start_keeps_its_own_turn(case: int) -> None:
    robot, path, q = seam(case)
    off = np.linalg.norm(robot.pose_errors(q, path.pose(0.0)))
    found = plan(robot, free(path, turn=TURN), q, limits=LIMITS)
    assert found, found
    np.testing.assert_allclose(found.trajectory(0.0), q, atol=1e-8)
    turned = found.path.coordinates(np.zeros(1))[0, 0, 0]  # type: ignore[attr-defined]
    assert abs(turned) == pytest.approx(off, abs=1e-6) and off > 0.01


def test_a_turn_beyond_its_range_is_named_with_its_angle() -> None:
    robot, path, q = seam(1)
    with pytest.raises(InvalidInput, match=r"q_start: .*0\.1 mm and 0\.0057°.*turn in \[-0\.3, 0\.3\] rad.*61\.8°"):
        plan(robot, free(path, turn=0.3), q, limits=LIMITS)


@pytest.mark.parametrize("names", [("turn",), ("tilt",), ("turn", "tilt"), ("tilt", "turn")])
def test_a_path_begins_at_a_pose_by_its_freedoms(names: tuple[str, ...]) -> None:
    robot, rng = optik.load("ur5e"), np.random.default_rng(len(names))
    T = robot.fk(np.full(6, 0.4))
    path = free(
        Line(T, T @ se3.pose(p=[0.1, 0.0, 0.1])), **{name: {"turn": (-1.0, 9.0), "tilt": 0.5}[name] for name in names}
    )
    for _ in range(10):
        f = [rng.uniform(1.0, 8.0)] if names == ("turn",) else []
        for name in names if not f else ():
            f += list(rng.uniform(-0.3, 0.3, 2)) if name == "tilt" else [rng.uniform(-0.9, 0.9)]
        pose = path.with_coefficients(np.tile(f, (path.spline.count, 1)), None).pose(0.0)
        begun = path.begin_at(pose)
        assert np.abs(se3.error(begun.pose(0.0), pose)).max() < 1e-9
        off = begun.coefficients[0] - f
        np.testing.assert_allclose(off, 2.0 * np.pi * np.round(off / (2.0 * np.pi)), atol=1e-9)
    far = path.begin_at(path.pose(0.0) @ se3.pose(se3.exp_so3([1.0, 0.0, 0.0])))
    assert all(one.reached[1] <= one.allowed[1] + 1e-9 for one in far.ranges)


# ---------------------------------------------------------------- the budget of work
class Clock:
    """A clock that runs so many seconds at each look."""

    def __init__(self, speed: float) -> None:
        self.now, self.speed = 0.0, speed

    def __call__(self) -> float:
        self.now += self.speed
        return self.now


def test_a_loaded_machine_gives_the_same_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, path, _q = seam(7)
    durations = []
    for speed, limit in ((1e-9, 1e6), (100.0, 1e6), (1e9, None)):
        monkeypatch.setattr(graph, "perf_counter", Clock(speed))
        found = plan(robot, free(path, turn=TURN), limits=LIMITS, time_limit=limit)
        assert found.resolution is not None and not found.resolution.limited
        durations.append(found.duration)
    assert len(set(durations)) == 1


def test_a_plan_that_met_its_time_limit_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, path, _q = seam(7)
    monkeypatch.setattr(graph, "perf_counter", Clock(1.0))
    found = plan(robot, free(path, turn=TURN), limits=LIMITS, time_limit=3.0)
    assert found.resolution is not None and found.resolution.limited
    assert "ended by time_limit" in str(found)
    assert found.to_dict()["resolution"]["limited"]
    assert found or "time_limit: a larger limit may find more" in found.failure.reason  # type: ignore[union-attr]


def test_the_budget_of_work_ends_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = optik.load("panda")
    T = robot.fk(np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.8, 0.8]))
    path = Line(T, T @ se3.pose(p=[0.0, 2.0, 0.0]))
    whole = Resolver(robot, path, None, np.inf)
    assert whole.find(None, held=False, many=True)[1].stuck is not None and not whole.sampler.is_over
    monkeypatch.setattr(graph, "MOST_WORK", whole.sampler.work // 4)
    part = Resolver(robot, path, None, np.inf)
    made = part.find(None, held=False, many=True)[1]
    assert "budget of" in made.reason and made.reached and not made.limited
    assert part.sampler.work < whole.sampler.work
