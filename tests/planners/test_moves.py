"""The least duration of a move of the joints: against Ruckig, which times each joint alone; and of plans."""

import numpy as np
import pytest

import optik
from optik import Scene
from planners import Arc, MotionLimits, plan, replan
from planners.limits.motion_limits import compute_least_duration
from planners.paths.point_to_point import PointToPoint
from tests.planners.cases import START, paper6r
from tests.seeds import shift_seed

LIMITS = MotionLimits(2.0, 10.0, 100.0)


@pytest.mark.parametrize("sided", [False, True])
def test_it_is_that_of_ruckigs_slowest_joint(sided: bool) -> None:
    ruckig = pytest.importorskip("ruckig")
    rng, n = np.random.default_rng(shift_seed(38)), 4
    for _ in range(200):
        V, A, J, below = (10.0 ** rng.uniform(-1.0, 1.0, n) * scale for scale in (1.0, 5.0, 50.0, 5.0))
        away = rng.uniform(-3.0, 3.0, n) * 10.0 ** rng.uniform(-4.0, 1.0)
        given = ruckig.InputParameter(n)
        given.current_position, given.target_position = [0.0] * n, away.tolist()
        given.max_velocity, given.max_jerk, given.max_acceleration = V.tolist(), J.tolist(), A.tolist()
        if sided:
            given.min_acceleration = (-below).tolist()
        motion = ruckig.Trajectory(n)
        assert ruckig.Ruckig(n).calculate(given, motion) in (ruckig.Result.Working, ruckig.Result.Finished)
        limits = MotionLimits(V, (-below, A) if sided else A, J)
        assert compute_least_duration(away, limits) == pytest.approx(max(motion.independent_min_durations), rel=1e-12)


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        (MotionLimits(2.0, None, None), 0.5),
        (MotionLimits(None, 4.0, None), 1.0),
        (MotionLimits(None, None, 32.0), 1.0),
        (MotionLimits(1.0, 4.0, None), 1.25),
        (MotionLimits(None, None, None), 0.0),
    ],
)
def test_limits_that_are_unknown_do_not_count(limits: MotionLimits, expected: float) -> None:
    """One radian: at V; in 2 (d / A)^½; in (32 d / J)^⅓; and the other joint by nothing."""
    assert compute_least_duration(np.array([-1.0, 0.0]), limits) == pytest.approx(expected, abs=2e-9)


def test_plans_of_joint_moves_state_it_and_none_is_faster() -> None:
    rng = np.random.default_rng(shift_seed(39))
    for law in ("optimal", "ruckig", "smooth"):
        goal = START + rng.uniform(-0.6, 0.6, 6)
        move = plan(paper6r(), goal, START, limits=LIMITS, timing=law)
        assert move.least_duration == compute_least_duration(goal - START, LIMITS)
        assert move.trajectory.duration >= move.least_duration * (1.0 - 1e-9)
        assert f"(slowest joint alone: {move.least_duration:.3g} s)" in str(move)
        assert replan(move, 0.1, stop=True).least_duration is None


def test_a_tool_path_has_none() -> None:
    T = paper6r().fk(START)
    line = plan(paper6r(), Arc.about(T, T[:3, 3] + 0.05 * T[:3, 0], T[:3, 2], 1.0), START, limits=LIMITS)
    assert line and line.least_duration is None and "slowest joint" not in str(line)


def test_a_free_move_around_obstacles_is_as_fast_as_its_slowest_joint() -> None:
    robot = optik.load("panda")
    goal = np.array([0.9, 0.2, 0.0, -2.0, 0.0, 1.8, 0.8])
    start, limits = goal - [1.8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], MotionLimits.of(robot)
    around = plan(robot, goal, start, limits=limits, scene=Scene(spheres=[((0.75, 0.0, 1.2), 0.1)]), avoid=True)
    assert around and around.least_duration <= around.trajectory.duration <= 1.01 * around.least_duration


def test_a_move_through_via_points_states_that_of_its_ends() -> None:
    goal = START + 0.5
    path = PointToPoint(paper6r(), START, START + np.array([0.9, 0, 0, 0, 0, 0]), goal)
    move = plan(paper6r(), path, START, limits=LIMITS)
    assert move and 1.2 * move.least_duration < move.trajectory.duration
