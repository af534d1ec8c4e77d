import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BPoly

from optik.arm.library import load
from optik.errors import InvalidInput, NoSolution
from optik.ik import make_solver
from planners import JointLine, MotionLimits, Trajectory, follow, laws, make_law
from planners.following.joint_path import JointPath
from planners.limits import DERIVATIVES
from planners.limits.velocity_by_position import VelocityByPositionLimit
from planners.timing import optimal
from planners.timing.base import PathState
from planners.timing.interior_point import iteration, newton
from planners.timing.interior_point.rows import derivatives, distances
from planners.timing.optimal import Optimal
from tests.oracles.time_optimum import best_duration
from tests.planners.cases import default_joint_path, random_joint_paths
from tests.seeds import shift_seed

LIMITS = MotionLimits(2.0, 10.0, 100.0)
SLOW = MotionLimits(1.0, 2.0, 20.0)


def ratios(trajectory: Trajectory, limits: MotionLimits) -> list[float]:
    bound = limits.arrays(trajectory.n)
    return [float((trajectory.extrema(k).worst / bound[f]).max()) for k, f in enumerate(DERIVATIVES, start=1)]


@pytest.mark.parametrize("line", range(3))
def test_the_duration_is_that_of_a_plain_programme_solved_by_ipopt(line: int) -> None:
    """The plain one keeps its limits at its places only, so it is a little too fast; its coarse grid makes it slower."""
    joint_path = random_joint_paths(3)[line]
    theirs = best_duration(joint_path, LIMITS.arrays(6).values(), K=60)
    ours = Optimal().run(joint_path, LIMITS).duration
    assert ours == pytest.approx(theirs, rel=5e-3)


@pytest.mark.parametrize("limits", [LIMITS, SLOW], ids=["fast", "slow"])
@pytest.mark.parametrize("line", range(4))
def test_no_law_that_keeps_jerk_is_faster(line: int, limits: MotionLimits) -> None:
    joint_path = random_joint_paths(4)[line]
    best = Optimal().run(joint_path, limits).duration
    for law in laws():
        if "jerk" in make_law(law).enforced and law != "constant_speed":
            assert make_law(law).run(joint_path, limits).duration >= best * 0.999
    assert best >= make_law("toppra").run(joint_path, limits).duration


@pytest.mark.parametrize("line", range(4))
def test_some_limit_binds_nearly_everywhere(line: int) -> None:
    joint_path = random_joint_paths(4, shift_seed(5))[line]
    trajectory = Optimal().run(joint_path, LIMITS)
    bound = LIMITS.arrays(6)
    piece = np.max(
        [(trajectory.piece_worst(k) / bound[f]).max(axis=1) for k, f in enumerate(DERIVATIVES, start=1)], axis=0
    )
    assert piece.max() <= 1.0
    assert np.quantile(piece, 0.1) >= 0.99


@pytest.mark.parametrize("line", range(4))
def test_more_intervals_are_as_good_or_better(line: int) -> None:
    joint_path = random_joint_paths(4)[line]
    durations = [Optimal(intervals=K).run(joint_path, LIMITS).duration for K in (48, 96, 192, 400)]
    assert (np.diff(durations) <= 1e-4 * durations[0]).all()
    assert durations[2] <= 1.002 * durations[3]


def test_a_density_multiplies_the_intervals_unless_their_number_is_given() -> None:
    joint_path = random_joint_paths(1)[0]
    counts = [
        law.run_with_optimum(joint_path, LIMITS, density)[1].programme.s.size
        for law in (Optimal(), Optimal(intervals=100))
        for density in (1.0, 2.0)
    ]
    assert 1.6 < counts[1] / counts[0] < 2.2
    assert counts[2] == counts[3]


@given(
    line=st.integers(0, 3),
    velocity=st.floats(-2.0, 2.0),
    acceleration=st.floats(-2.0, 2.0),
    jerk=st.floats(-2.0, 2.0),
    joint=st.integers(0, 5),
    share=st.floats(0.05, 1.0),
)
def test_limits_of_any_size_are_kept_exactly(
    line: int, velocity: float, acceleration: float, jerk: float, joint: int, share: float
) -> None:
    limit = [np.full(6, b * 10.0**e) for b, e in ((2.0, velocity), (10.0, acceleration), (100.0, jerk))]
    for row in limit:
        row[joint] *= share
    limits = MotionLimits(*limit)
    trajectory = Optimal().run(random_joint_paths(4)[line], limits)
    assert max(ratios(trajectory, limits)) <= 1.0
    assert max(ratios(trajectory, limits)) >= 1.0 - 1e-9


@pytest.mark.parametrize("share", [0.05, 0.3, 0.9])
def test_a_tool_speed_is_kept_and_used(share: float) -> None:
    from planners.certificate.bounds import tool_speed

    joint_path = default_joint_path()
    free = Optimal().run(joint_path, LIMITS)
    limit = share * tool_speed(joint_path.robot, free).speed
    slow = Optimal().run(joint_path, MotionLimits(2.0, 10.0, 100.0, tool_speed=limit))
    found = tool_speed(joint_path.robot, slow).speed
    assert 0.999 * limit <= found <= limit
    assert joint_path.end / limit < slow.duration <= joint_path.end / limit + free.duration


@pytest.mark.parametrize(("end", "i"), [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_the_slopes_of_a_row_with_jerk_are_its_differences(end: int, i: int) -> None:
    rng, h = np.random.default_rng(5), 1e-6
    edge, (v, a, j) = rng.normal(size=(1, 2, 2, 6)), rng.normal(size=3)
    by_v, by_a = (
        (
            iteration._edge_value(edge, 0, end, i, v + x, a + y, j)
            - iteration._edge_value(edge, 0, end, i, v - x, a - y, j)
        )
        / (2.0 * h)
        for x, y in ((h, 0.0), (0.0, h))
    )
    assert newton.edge_slope(edge, 0, end, i, v, a) == pytest.approx((by_v, by_a), rel=1e-6)


# ---------------------------------------------------------------- from a moving state
def moving(
    joint_path: JointPath, limits: MotionLimits, share: float, part: float = 0.8
) -> tuple[PathState, Trajectory]:
    """A state of the optimum under a share of the limits, at a part of its path, and that optimum."""
    trajectory = Optimal().run(joint_path, limits.scale(share))
    t = part * trajectory.end
    q, dq, ddq = (trajectory(t, order) for order in range(3))
    grid = np.linspace(0.0, joint_path.end, 20001)
    s = float(grid[np.linalg.norm(joint_path(grid) - q, axis=1).argmin()])
    for _ in range(5):
        q1 = joint_path(s, 1)
        s += float(q1 @ (q - joint_path(s)) / (q1 @ q1))
    q1, q2 = joint_path(s, 1), joint_path(s, 2)
    v = float(q1 @ dq / (q1 @ q1))
    return PathState(s, v, float(q1 @ (ddq - q2 * v * v) / (q1 @ q1))), trajectory


@pytest.mark.parametrize("stop", [False, True])
@pytest.mark.parametrize("part", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("line", range(3))
def test_from_a_moving_state_within_the_limits(line: int, part: float, stop: bool) -> None:
    joint_path = random_joint_paths(3)[line]
    state, _ = moving(joint_path, LIMITS, 0.7, part)
    law, rest = Optimal(), Optimal().run_from(joint_path, LIMITS, state)
    trajectory = law.run_to(joint_path, LIMITS, state, 0.5 * (state.s + joint_path.end)) if stop else rest
    if trajectory is None:  # too fast to stop half way
        assert part > 0.1
        return
    s, v, a, _ = state
    q1, q2 = joint_path(s, 1), joint_path(s, 2)
    for order, expected in enumerate((joint_path(s), q1 * v, q1 * a + q2 * v * v)):
        np.testing.assert_allclose(trajectory(0.0, order), expected, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(trajectory(trajectory.end, 1), 0.0, atol=1e-9)
    np.testing.assert_allclose(trajectory(trajectory.end, 2), 0.0, atol=1e-7)
    assert max(ratios(trajectory, LIMITS)) <= 1.0
    end = joint_path.end if not stop else 0.5 * (state.s + joint_path.end)
    np.testing.assert_allclose(trajectory(trajectory.end), joint_path(end), atol=1e-9)


def test_the_rest_of_the_optimum_is_as_fast_as_the_optimum() -> None:
    joint_path = random_joint_paths(3)[1]
    state, whole = moving(joint_path, LIMITS, 1.0, 0.3)
    rest = Optimal().run_from(joint_path, LIMITS, state)
    assert rest.duration == pytest.approx(0.7 * whole.duration, rel=5e-3)


def test_a_state_too_fast_to_stop_has_no_motion() -> None:
    joint_path = default_joint_path()
    state, _ = moving(joint_path, LIMITS, 1.0, 0.8)
    with pytest.raises(NoSolution) as info:
        Optimal().run_from(joint_path, LIMITS.scale(0.3), state)
    assert info.value.s == state.s
    assert info.value.advice


@pytest.mark.parametrize("law", ["optimal", "smooth", "constant_speed", "toppra", "ruckig"])
@pytest.mark.parametrize("joint", [0, 5])
def test_a_joint_that_moves_where_its_velocity_limit_is_0_is_named(law: str, joint: int) -> None:
    robot = load("fr3")
    goal = robot.limits.middle.copy()
    goal[joint] = robot.limits.upper[joint] - 1e-3
    followed = follow(make_solver(robot, "lm"), JointLine(robot, robot.limits.middle, goal))
    assert followed.joint_path is not None
    options = {"speed": 0.1} if law == "constant_speed" else {}
    with pytest.raises(NoSolution, match=f"{robot.joint_names[joint]} moves at .* towards the upper end .* is 0"):
        make_law(law, **options).run(followed.joint_path, MotionLimits.of(robot))


def test_a_limit_that_is_0_between_the_points_of_the_check_is_no_error_of_numbers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = load("fr3")
    goal = robot.limits.middle.copy()
    goal[0] = robot.limits.upper[0] - 1e-3
    joint_path = follow(make_solver(robot, "lm"), JointLine(robot, robot.limits.middle, goal)).joint_path
    assert joint_path is not None
    monkeypatch.setattr(VelocityByPositionLimit, "check_still", lambda *_: None)
    with pytest.raises(NoSolution, match="a velocity limit is 0 at s = "):
        Optimal().run(joint_path, MotionLimits.of(robot))


def test_laws_from_rest_only_say_so() -> None:
    with pytest.raises(InvalidInput, match=r"^timing: "):
        make_law("quintic").run_from(default_joint_path(), LIMITS, PathState(0.1, 0.1, 0.0))


def test_a_gentle_start_leads_to_the_same_optimum(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = make_law("optimal").run(default_joint_path(), LIMITS)
    monkeypatch.setattr(optimal, "START_ATTEMPTS", ())
    gentle = make_law("optimal").run(default_joint_path(), LIMITS)
    assert gentle.duration == pytest.approx(usual.duration, rel=5e-3)
    assert not np.array_equal(gentle.knots, usual.knots)


def test_acceleration_limits_far_below_the_others_have_a_motion() -> None:
    """Of random limits: none of the usual starts leads on here, or nearly none."""
    acceleration = np.full(6, 0.10771508)
    jerk = np.full(6, 184.17958317)
    acceleration[5], jerk[0] = 0.05345505, 12.21961096
    limits = MotionLimits(3.15623072, acceleration, jerk)
    for joint_path in (default_joint_path(), *random_joint_paths(4)):
        best = make_law("optimal").run(joint_path, limits)
        assert best.duration <= make_law("ruckig").run(joint_path, limits).duration


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(3))
def test_no_limits_over_four_decades_are_without_a_motion(seed: int) -> None:
    rng = np.random.default_rng([8, seed])
    joint_paths = (default_joint_path(), *random_joint_paths(12))
    for _ in range(500):
        sizes = np.array([2.0, 10.0, 100.0]) * 10.0 ** rng.uniform(-2.0, 2.0, 3)
        each = sizes[:, None] * np.where(
            np.arange(6) == rng.integers(6, size=(3, 1)), rng.uniform(0.05, 1.0, (3, 1)), 1.0
        )
        tool = None if rng.random() < 0.7 else 10.0 ** rng.uniform(-3.0, 0.0)
        limits = MotionLimits(*each, tool_speed=tool)
        trajectory = make_law("optimal").run(joint_paths[rng.integers(len(joint_paths))], limits)
        for order, field in enumerate(DERIVATIVES, start=1):
            assert (trajectory.extrema(order).worst <= limits.arrays(6)[field]).all()


# ---------------------------------------------------------------- the iteration's parts
def test_the_barrier_of_many_tiny_slacks_is_the_sum_of_their_logarithms() -> None:
    """Their product is far below the least number that there is."""
    rng, K, n = np.random.default_rng(1), 3, 7
    node, edge = np.zeros((K + 1, n, 2)), np.zeros((K, 2, n, 3))
    one = {"ds": np.ones(K), "tau": np.ones(K), "least": np.full(K, 0.1), "top": np.full(K + 1, 3.0)}
    given = one | {"node": node, "edge": edge, "goal": np.zeros(2)}
    problem = newton.Problem(**{name: given[name] for name in newton.Problem._fields})
    z = np.abs(rng.normal(size=(K + 1, 4))) + 0.2
    slack = 10.0 ** rng.uniform(-40.0, -20.0, (K + 1, 2, 3 * n))
    slack[1] = 10.0 ** rng.uniform(20.0, 40.0, (2, 3 * n))
    mu = 0.3
    wanted = 0.0
    for k in range(K):
        wanted += z[k, 2] - mu * np.log(z[k, 2] - 0.1) - mu * np.log(slack[k, :, n if k == 0 else 0 :]).sum()
        wanted -= mu * (np.log(z[k, 0]) + np.log(3.0 - z[k, 0])) if k else 0.0
    objective, _ = iteration.merit(problem, mu, z, np.zeros((K, 3)), np.zeros((K + 1, 3 * n)), slack, None)
    assert objective == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(
    "limits", [MotionLimits(2.0, 10.0, 1e4), MotionLimits(0.5, 50.0, 100.0), MotionLimits(5.0, 2.0, 1e3)]
)
def test_the_end_is_met_however_far_apart_the_limits_are(limits: MotionLimits) -> None:
    for joint_path in (default_joint_path(), *random_joint_paths(3)):
        trajectory = make_law("optimal").run(joint_path, limits)
        np.testing.assert_allclose(trajectory(trajectory.end), joint_path.q[-1], rtol=0.0, atol=1e-9)
        assert np.abs(trajectory(trajectory.end, 1)).max() < 1e-9


def test_limits_far_apart_take_tens_of_iterations(monkeypatch: pytest.MonkeyPatch) -> None:
    counts, real, rng = [], iteration.solve_barrier, np.random.default_rng(0)
    monkeypatch.setattr(iteration, "solve_barrier", lambda *given: counts.append(real(*given)) or counts[-1])
    for k in range(8):
        limits = np.array([2.0, 10.0, 100.0]) * 10.0 ** rng.uniform(-3.0, 3.0, 3)
        make_law("optimal").run(random_joint_paths(4)[k % 4], MotionLimits(*limits))
    assert 10 < max(counts) <= 80


def test_where_no_motion_is_found_the_reason_names_the_place_and_the_joint(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(iteration, "solve_barrier", lambda *_: -1)
    with pytest.raises(NoSolution) as info:
        make_law("optimal").run(default_joint_path(), LIMITS)
    assert info.value.joint in default_joint_path().robot.joint_names
    assert info.value.joint in info.value.reason
    assert info.value.s is not None
    assert 0.0 <= info.value.s <= default_joint_path().end
    assert "times the jerk limit" in info.value.reason or "times the acceleration limit" in info.value.reason


@pytest.mark.parametrize("tool_speed", [1e-3, 1e-2])
@pytest.mark.parametrize("line", range(4))
def test_where_speeds_alone_bind_there_is_a_motion_as_long_as_they_ask(line: int, tool_speed: float) -> None:
    joint_path = random_joint_paths(4)[line]
    trajectory = Optimal().run(joint_path, MotionLimits(2.0, 2e3, 2e5, tool_speed=tool_speed))
    s = np.linspace(0.0, joint_path.end, 4001)
    least = np.trapezoid(np.linalg.norm(joint_path.path.twist(s)[:, :3], axis=1), s) / tool_speed
    assert least <= trajectory.duration <= 1.002 * least


def test_a_state_that_hardly_moves_starts_as_one_at_rest() -> None:
    joint_path = default_joint_path()
    still = Optimal().run_from(joint_path, LIMITS, PathState(0.05, 0.0, 0.0))
    for speed, acceleration in ((1e-20, 3e-17), (1e-13, 1e-9), (1e-10, 0.0), (1e-7, 1e-4)):
        state = PathState(0.05, speed, acceleration)
        assert Optimal().run_from(joint_path, LIMITS, state).duration == pytest.approx(still.duration, rel=2e-3)


def test_derivatives_at_many_places_are_those_of_the_spline() -> None:
    for joint_path in (default_joint_path(), *random_joint_paths(2)):
        s = np.sort(np.concatenate([np.random.default_rng(2).uniform(0.0, joint_path.end, 300), joint_path.nodes]))
        found = derivatives(joint_path, s)
        for order in range(4):
            wanted = joint_path(s, order)
            np.testing.assert_allclose(found[order], wanted, rtol=0.0, atol=1e-11 * np.abs(wanted).max())


def test_distances_to_the_path_are_those_of_scipys_quintics() -> None:
    joint_path, rng = random_joint_paths(1)[0], np.random.default_rng(3)
    s = joint_path.end * np.array([0.1, 0.2, 0.35, 0.4, 0.7])
    tau, state = rng.uniform(0.1, 0.3, 4), rng.normal(size=(5, 2)) * np.array([0.3, 1.0])
    t, v, a = np.append(0.0, np.cumsum(tau)), state[:, :1], state[:, 1:]
    q, q1, q2 = (joint_path(s, order) for order in range(3))
    motion = BPoly.from_derivatives(t, np.stack([q, q1 * v, q1 * a + q2 * v * v], axis=1))
    place = BPoly.from_derivatives(t, np.stack([s, state[:, 0], state[:, 1]], axis=1))
    found = distances(joint_path, s, state, tau, np.stack([q, q1, q2]))
    for k in range(4):
        at = t[k] + tau[k] * np.array([0.25, 0.5, 0.75])
        off = np.abs(motion(at) - joint_path(np.clip(place(at), 0.0, joint_path.end))).max()
        assert found[k] == pytest.approx(off, rel=1e-9)
