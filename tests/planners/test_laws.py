"""What holds for one law only; what holds for every law stands in tests/contract/test_time_laws.py."""

import socket
from typing import Any

import numpy as np
import pytest
import ruckig
import toppra
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PPoly, make_interp_spline

import planners.timing.ruckig as ruckig_call
from optik.errors import InvalidInput, NoSolution
from optik.ik import make_solver
from optik.types import Array
from planners import Line, MotionLimits, Polyline, Trajectory, certify, follow, make_law
from planners.following.joint_path import JointPath
from planners.paths.base import Path
from planners.timing import base
from planners.timing import toppra as toppra_law
from planners.timing._sectional import Ramp, law_of, make_table, phases_of, ratio_of
from planners.timing.base import refit
from planners.timing.constant_speed import _distance as distance_of
from planners.timing.quintic import Quintic
from planners.timing.toppra import Toppra
from planners.trajectory.curve import constant_acceleration
from tests import oracles
from tests.oracles import PAPER
from tests.oracles.time_optimum import best_duration
from tests.planners import cases
from tests.planners.cases import default_joint_path, default_line, paper6r, random_joint_paths

LIMITS = MotionLimits(2.0, 10.0, 100.0)
SETS = [LIMITS, MotionLimits(1.0, 2.0, 20.0)]
SETS_OF = {id(LIMITS): (2.0, 10.0, 100.0), id(SETS[1]): (1.0, 2.0, 20.0)}
lines = pytest.mark.parametrize("joint_path", range(4), ids="line{}".format, indirect=True)
limit_sets = pytest.mark.parametrize("limits", SETS, ids=["fast", "slow"])


def each_case(test: Any) -> Any:
    return lines(limit_sets(test))


@pytest.fixture
def joint_path(request: pytest.FixtureRequest) -> JointPath:
    """The default line, and three drawn at random."""
    return (default_joint_path(), *random_joint_paths(3))[request.param]


WRONG = {
    ("quintic", "duration"): (0.0, -3.0, np.nan, np.inf), ("quintic", "step"): (0.0, 2.0, np.nan),
    ("toppra", "grid"): (0, -3, 9, 10.5, None), ("optimal", "intervals"): (7, 0, -1, 2.5, "many"),
    ("constant_speed", "speed"): (0.0, -1.0, np.nan, "fast"), ("constant_speed", "ramp"): (0.0, 0.6, np.nan),
}  # fmt: skip


@pytest.mark.parametrize(("law", "option"), WRONG)
def test_options_that_cannot_be_meant_are_refused_by_name(law: str, option: str) -> None:
    for value in WRONG[law, option]:
        with pytest.raises(InvalidInput, match=rf"^{option}: "):
            make_law(law, **{option: value})


# ---------------------------------------------------------------- the paper's quintic
@lines
def test_the_papers_law_is_exactly_the_papers(joint_path: JointPath) -> None:
    trajectory = make_law("quintic").run(joint_path, LIMITS)
    line = joint_path.path
    V = line(0.0, 1) * line.end / 3.0  # for the default line (chord / T, 0)
    assert trajectory.duration == 3.0
    np.testing.assert_allclose(trajectory.knots, 0.02 * np.arange(151), rtol=0.0, atol=1e-14)
    assert trajectory.coefficients.shape == (6, 150, 6)
    for i in range(151):
        t = trajectory.knots[i]
        np.testing.assert_allclose(trajectory(t), joint_path.q[i], rtol=0.0, atol=1e-13)
        wanted = np.linalg.solve(paper6r().jacobian(joint_path.q[i]), V) if 0 < i < 150 else np.zeros(6)
        np.testing.assert_allclose(trajectory(t, 1), wanted, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(trajectory(t, 2), np.zeros(6), rtol=0.0, atol=1e-9)
    first, last = trajectory.ends(2)
    np.testing.assert_allclose(np.concatenate([first, last]), 0.0, rtol=0.0, atol=1e-9)


def test_another_duration_and_step_are_kept() -> None:
    trajectory = make_law("quintic", duration=1.5, step=0.05).run(default_joint_path(), LIMITS)
    assert trajectory.duration == 1.5
    np.testing.assert_allclose(trajectory.knots, 0.05 * np.arange(31), rtol=0.0, atol=1e-14)
    middle = np.linalg.solve(paper6r().jacobian(trajectory(0.75)), [*(cases.MOVE / 1.5), 0.0, 0.0, 0.0])
    np.testing.assert_allclose(trajectory(0.75, 1), middle, rtol=0.0, atol=1e-10)


@each_case
def test_the_least_duration_of_the_papers_law_just_breaks_no_limit(joint_path: JointPath, limits: MotionLimits) -> None:
    law = make_law("quintic")
    assert isinstance(law, Quintic)
    least = law.least_duration(joint_path, limits)
    worst = []
    for factor in (1.0 + 1e-9, 0.999):
        trajectory = make_law("quintic", duration=factor * least, step=factor * least / 150).run(joint_path, limits)
        assert len(trajectory.knots) == 151
        u = np.linspace(0.0, 1.0, 41)[:, None, None] * np.diff(trajectory.knots)[:, None]
        c, ratios = trajectory.coefficients, []
        for limit in (limits.velocity, limits.acceleration, limits.jerk):
            c = c[:-1] * np.arange(len(c) - 1, 0, -1)[:, None, None]
            ratios.append(np.abs(np.polyval(c, u)).max() / limit)
        worst.append(max(ratios))
    assert worst[0] <= 1.0 + 1e-9
    assert worst[1] > 1.0


def test_the_papers_law_never_breaks_limits_that_nobody_gave() -> None:
    law = make_law("quintic")
    assert isinstance(law, Quintic)
    assert law.least_duration(default_joint_path(), MotionLimits()) == 0.0


# ---------------------------------------------------------------- smooth
def quintic_states(end: float, duration: float, count: int) -> Array:
    """s, ṡ, s̈, s⃛ (4, count) of one quintic from rest to rest, written out."""
    u = np.linspace(0.0, 1.0, count)
    return np.stack(
        [
            end * (10 * u**3 - 15 * u**4 + 6 * u**5),
            end / duration * 30 * u**2 * (1 - u) ** 2,
            end / duration**2 * 60 * u * (1 - u) * (1 - 2 * u),
            end / duration**3 * 60 * (1 - 6 * u + 6 * u**2),
        ]
    )


def asked(joint_path: JointPath, states: Array, limits: MotionLimits) -> float:
    """Largest ratio to a joint limit over states (4, k) of s, by the chain rule."""
    s, v, a, j = states
    q1, q2, q3 = (joint_path(np.clip(s, 0.0, joint_path.end), order).T for order in (1, 2, 3))
    return float(
        max(
            np.abs(q1 * v).max() / limits.velocity,
            np.abs(q1 * a + q2 * v**2).max() / limits.acceleration,
            np.abs(q1 * j + 3 * q2 * v * a + q3 * v**3).max() / limits.jerk,
        )
    )


@each_case
def test_smooth_is_the_shortest_single_quintic_that_holds(joint_path: JointPath, limits: MotionLimits) -> None:
    trajectory = make_law("smooth").run(joint_path, limits)
    T = trajectory.duration
    assert asked(joint_path, quintic_states(joint_path.end, T, 20_001), limits) <= 1.0 + 1e-3
    assert asked(joint_path, quintic_states(joint_path.end, 0.998 * T, 20_001), limits) > 1.0
    s, *_ = quintic_states(joint_path.end, T, 11)
    np.testing.assert_allclose(trajectory(np.linspace(0.0, T, 11)), joint_path(np.clip(s, 0, s[-1])), atol=1e-7)


# ---------------------------------------------------------------- ramps
@given(st.floats(0.0, 2.0), st.floats(0.1, 2.0), st.floats(1e-3, 1.0), st.floats(0.05, 0.6), st.floats(0.05, 0.38))
def test_a_ramp_goes_from_speed_to_speed_over_its_length(
    v0: float, v1: float, length: float, rise: float, fall: float
) -> None:
    ramp = Ramp(0.3, v0, 0.3 + length, v1, rise, fall)
    law = law_of([ramp], [phases_of(ramp)])
    ends = np.array([0.0, law.x[-1]])
    np.testing.assert_allclose(law(ends), [0.3, 0.3 + length], atol=1e-12)
    np.testing.assert_allclose(law(ends, 1), [v0, v1], atol=1e-11)
    np.testing.assert_allclose(law(ends, 2), 0.0, atol=1e-9 * max(1.0, np.abs(law.c[1]).max()))


@lines
def test_the_ratio_of_a_ramp_is_what_the_chain_rule_says(joint_path: JointPath) -> None:
    end = joint_path.end
    ramp = Ramp(0.1 * end, 0.2 * end, 0.6 * end, 0.7 * end, 0.3, 0.4)
    law = law_of([ramp], [phases_of(ramp)])
    worst = np.zeros(3)
    for k in range(3):
        for t in np.linspace(law.x[k], law.x[k + 1], 60):
            _, *derivatives = chain(joint_path, law, t, k)
            worst = np.maximum(worst, [np.abs(d).max() for d in derivatives])
    slow = max((worst[0] / 2.0), (worst[1] / 10.0) ** (1 / 2), (worst[2] / 100.0) ** (1 / 3))
    assert ratio_of(make_table(joint_path, LIMITS), ramp, 60) == pytest.approx(slow, rel=2e-3)


# ---------------------------------------------------------------- ruckig
def near_singular_path() -> JointPath:
    """A line on which the wrist nearly stretches: q5 passes close by 0."""
    q = np.array([0.3, -0.6, 0.9, 0.5, 0.08, -0.3])
    robot = paper6r()
    for move in np.eye(3):
        for sign in (0.3, -0.3):
            line = Line(robot.fk(q), oracles.moved(robot.fk(q), sign * move))
            joint_path = follow(make_solver(robot, "dls"), line, q).joint_path
            whole = joint_path is not None and joint_path.end == line.end
            if whole and 0.01 < joint_path.singular_values.min() < 0.05:
                return joint_path
    raise AssertionError("no near-singular line among these")


@limit_sets
def test_ruckig_by_sections_is_near_the_jerk_limited_optimum(limits: MotionLimits) -> None:
    for joint_path, most in ((default_joint_path(), 1.12), (random_joint_paths(1)[0], 1.12)):
        best = best_duration(joint_path, limits.arrays(6).values(), K=60)
        ratio = make_law("ruckig").run(joint_path, limits).duration / best
        assert 0.99 <= ratio <= most


def test_one_bad_point_does_not_pace_the_whole_line() -> None:
    joint_path = near_singular_path()
    duration = make_law("ruckig").run(joint_path, LIMITS).duration
    assert 0.99 <= duration / best_duration(joint_path, LIMITS.arrays(6).values(), K=60) <= 1.2
    assert duration <= 0.6 * oracles.best_uniform(joint_path, 2.0, 10.0, 100.0)


def test_ruckig_is_never_given_waypoints_and_no_socket_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*args: Any, **kwargs: Any) -> None:
        raise AssertionError("a socket was opened")

    seen = []

    class Watched:
        def __init__(self, dofs: int) -> None:
            assert dofs == 1
            self.own = ruckig.Ruckig(dofs)

        def calculate(self, problem: Any, answer: Any) -> Any:
            seen.append(list(problem.intermediate_positions))
            return self.own.calculate(problem, answer)

    monkeypatch.setattr(socket, "socket", refuse)
    monkeypatch.setattr(socket, "create_connection", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    real = ruckig_call.ruckig
    proxy = type("Proxy", (), {"__getattr__": lambda self, name: getattr(real, name), "Ruckig": Watched})()
    monkeypatch.setattr(ruckig_call, "ruckig", proxy)
    make_law("ruckig").run(default_joint_path(), LIMITS)
    assert len(seen) >= 6
    assert all(positions == [] for positions in seen), "intermediate positions are what ruckig sends to a cloud"


@pytest.mark.parametrize("length", [1e-2, 1e-3])
def test_a_short_line_takes_the_time_of_the_closed_form(length: float) -> None:
    line = default_line()
    goal = oracles.moved(line.start, cases.MOVE / line.end * length)
    joint_path = cases.followed_line(line.start, goal)
    trajectory = make_law("ruckig").run(joint_path, LIMITS)
    steepest = np.abs(joint_path.derivatives[:, 0]).max()
    assert trajectory.duration == pytest.approx((32.0 * length * steepest / 100.0) ** (1 / 3), rel=0.02 * length / 1e-2)


@each_case
def test_no_uniform_bounds_on_s_are_much_faster(joint_path: JointPath, limits: MotionLimits) -> None:
    trajectory = make_law("ruckig").run(joint_path, limits)
    assert trajectory.duration <= 1.01 * oracles.best_uniform(
        joint_path, limits.velocity, limits.acceleration, limits.jerk
    )


def test_where_jerk_alone_limits_the_time_goes_with_its_cube_root() -> None:
    for joint_path in (default_joint_path(), random_joint_paths(1)[0]):
        durations = [
            make_law("ruckig").run(joint_path, MotionLimits(1e3, 1e3, j)).duration * np.cbrt(j)
            for j in (1e-3, 1e-1, 10.0, 1e3)
        ]
        np.testing.assert_allclose(durations, durations[0], rtol=0.01)


def test_a_jerk_limit_far_above_the_others_is_kept_exactly_too() -> None:
    for path, limits in (
        (default_joint_path(), (2.0, 1e-2, 1e4)),
        *((path, (1.0, 1e-3, 1e3)) for path in random_joint_paths(3)),
    ):
        trajectory = make_law("ruckig").run(path, MotionLimits(*limits))
        for order, limit in enumerate(limits, start=1):
            assert trajectory.extrema(order).worst.max() <= limit


def test_samples_close_together_do_not_slow_the_motion() -> None:
    line = default_line()
    dense = follow(make_solver(paper6r(), "dls"), line, cases.START, samples=20_001).joint_path
    assert dense is not None
    durations = [make_law("ruckig").run(path, LIMITS).duration for path in (default_joint_path(), dense)]
    assert durations[1] == pytest.approx(durations[0], rel=5e-3)


# ---------------------------------------------------------------- toppra
@each_case
def test_toppra_is_as_fast_as_toppra_itself_on_another_interpolator(
    joint_path: JointPath, limits: MotionLimits
) -> None:
    trajectory = make_law("toppra").run(joint_path, limits)
    bounds = [np.full((6, 2), b) * [-1.0, 1.0] for b in (limits.velocity, limits.acceleration)]
    peer = toppra.algorithm.TOPPRA(
        [
            toppra.constraint.JointVelocityConstraint(bounds[0]),
            toppra.constraint.JointAccelerationConstraint(bounds[1]),
        ],
        toppra.SplineInterpolator(joint_path.knots, joint_path.q),
        gridpoints=np.linspace(0.0, joint_path.end, 201),
    )
    theirs = peer.compute_trajectory(0.0, 0.0)
    assert trajectory.duration == pytest.approx(theirs.duration, rel=5e-4)  # our grid is finer where theirs exceeds


@each_case
def test_toppra_uses_a_limit_to_the_full_almost_everywhere(joint_path: JointPath, limits: MotionLimits) -> None:
    trajectory = make_law("toppra").run(joint_path, limits)
    t = np.linspace(0.0, trajectory.duration, 999)[1:-1]
    used = np.maximum(
        np.abs(trajectory(t, 1)).max(axis=1) / limits.velocity,
        np.abs(trajectory(t, 2)).max(axis=1) / limits.acceleration,
    )
    assert np.median(used) > 0.98
    assert np.quantile(used, 0.05) > 0.95


@each_case
def test_the_certificate_of_toppra_says_the_exact_acceleration_jumps_included(
    joint_path: JointPath, limits: MotionLimits
) -> None:
    law = make_law("toppra")
    trajectory = law.run(joint_path, limits)
    certificate = certify(paper6r(), joint_path.path, trajectory, limits, law="toppra", enforced=law.enforced)
    worst = np.zeros(6)
    for k in range(len(trajectory.knots) - 1):
        for t in np.linspace(trajectory.knots[k], trajectory.knots[k + 1], 9):
            worst = np.maximum(worst, np.abs(oracles.value(trajectory, t, 2, k)))
    np.testing.assert_allclose(certificate.acceleration.value, worst, rtol=1e-6)
    assert (certificate.acceleration.value >= worst * (1.0 - 1e-12)).all()
    np.testing.assert_allclose(certificate.acceleration.ratio, worst / limits.acceleration, rtol=1e-6)
    assert np.isinf(certificate.jerk.value).all()
    assert np.isinf(certificate.jerk.ratio).all()
    assert certificate.continuous == 1
    assert np.isfinite(certificate.sampled_jerk).all()


def test_more_grid_points_are_as_fast() -> None:
    coarse, fine = (make_law("toppra", grid=g).run(default_joint_path(), LIMITS) for g in (100, 800))
    assert coarse.duration == pytest.approx(fine.duration, rel=5e-3)


def test_constant_acceleration_between_speeds() -> None:
    s, speed = np.array([0.0, 0.5, 2.0, 2.5]), np.array([0.0, 1.0, 2.0, 0.5])
    law = constant_acceleration(s, speed)
    np.testing.assert_allclose(law(law.x), s, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(law(law.x, 1)[:-1], speed[:-1], rtol=0.0, atol=1e-14)
    for k in range(3):  # v² − v₀² = 2 a Δs
        a = 2.0 * law.c[0, k]
        assert speed[k + 1] ** 2 - speed[k] ** 2 == pytest.approx(2.0 * a * (s[k + 1] - s[k]), abs=1e-13)


def test_toppra_exceeds_its_limits_by_next_to_nothing_between_grid_points() -> None:
    for joint_path in (default_joint_path(), *random_joint_paths(3), near_singular_path()):
        for limits in SETS:
            trajectory = make_law("toppra").run(joint_path, limits)
            assert trajectory.extrema(1).worst.max() <= limits.velocity * (1.0 + 1.5e-5)
            assert trajectory.extrema(2).worst.max() <= limits.acceleration * (1.0 + 1.5e-5)


def test_toppra_tries_other_grids_and_counts_them(monkeypatch: pytest.MonkeyPatch) -> None:
    real, sizes = toppra_law._solve, []

    def fragile(joint_path: JointPath, limits: MotionLimits, s: Array, around: Array | None = None) -> Array | None:
        sizes.append(s.size)
        return None if len(sizes) < 3 else real(joint_path, limits, s, around)

    monkeypatch.setattr(toppra_law, "_solve", fragile)
    law = make_law("toppra")
    assert isinstance(law, Toppra)
    trajectory = law.run(default_joint_path(), LIMITS)
    assert law.retries == 2
    assert len(set(sizes[:3])) == 3
    monkeypatch.undo()
    assert trajectory.duration == pytest.approx(law.run(default_joint_path(), LIMITS).duration, rel=1e-2)
    assert law.retries == 0
    monkeypatch.setattr(toppra_law, "_solve", lambda *_: None)
    with pytest.raises(NoSolution, match="grids of"):
        law.run(default_joint_path(), LIMITS)


# ---------------------------------------------------------------- constant speed of the tool
class Uneven(Path):
    """A line on which s is no distance: |v| goes up and down along s."""

    name = "uneven"

    def __init__(self, line: Line) -> None:
        self.line = line

    @property
    def end(self) -> float:
        return self.line.end

    def _evaluate(self, x: Array, order: int) -> Array:
        w = 2.0 * np.pi / self.end
        if order == 0:
            return self.line.pose(np.clip(x + 0.3 / w * np.sin(w * x), 0.0, self.end))
        rate = (1.0 + 0.3 * np.cos(w * x), -0.3 * w * np.sin(w * x), -0.3 * w * w * np.cos(w * x))[order - 1]
        return rate[:, None] * self.line.twist(0.0)

    def derivative_bounds(self) -> Array:
        w = 2.0 * np.pi / self.end
        return np.array([[1.3, 0.3 * w, 0.3 * w**2, 0.3 * w**3], np.zeros(4)])  # the default line does not turn

    def to_dict(self) -> Any:
        raise NotImplementedError

    from_dict = to_dict


def speed_of_tool(trajectory: Trajectory, t: Array) -> Array:
    """Speeds (k,) of the tool's point."""
    return oracles.speeds(PAPER, trajectory, t)[:, 0]


@each_case
def test_the_middle_is_at_one_speed_and_the_ramps_are_limited(joint_path: JointPath, limits: MotionLimits) -> None:
    law = make_law("constant_speed")
    trajectory = law.run(joint_path, limits)
    for order, bound in enumerate((limits.velocity, limits.acceleration, limits.jerk), start=1):
        assert trajectory.extrema(order).worst.max() <= bound
    assert np.abs(trajectory.jumps(2)).max() <= 1e-6 * trajectory.extrema(2).worst.max()
    places = joint_path.path.nearest(paper6r().fk(trajectory(trajectory.knots)))
    inside = (places >= 0.2501 * joint_path.end) & (places <= 0.7499 * joint_path.end)
    speeds = speed_of_tool(trajectory, trajectory.knots[inside][::4])
    assert speeds.size > 5
    np.testing.assert_allclose(speeds, speeds[0], rtol=1e-7)
    faster = law.run(joint_path, MotionLimits(*(1.1**k * b for k, b in enumerate(SETS_OF[id(limits)], start=1))))
    assert faster.duration == pytest.approx(trajectory.duration / 1.1, rel=1e-3)


@lines
def test_a_given_speed_is_kept_to_the_last_digits_and_the_ramps_shrink(joint_path: JointPath) -> None:
    fastest = speed_of_tool(t := make_law("constant_speed").run(joint_path, LIMITS), np.array([0.5 * t.duration]))[0]
    shares = []
    for factor in (0.9, 0.5, 0.2):
        speed = factor * fastest
        trajectory = make_law("constant_speed", speed=speed).run(joint_path, LIMITS)
        for order, bound in enumerate((2.0, 10.0, 100.0), start=1):
            assert trajectory.extrema(order).worst.max() <= bound
        speeds = speed_of_tool(trajectory, np.linspace(0.0, trajectory.duration, 120))
        assert speeds.max() <= speed * (1.0 + 1e-6)
        constant = np.abs(speeds - speed) <= 1e-7 * speed
        assert constant[60]
        shares.append(constant.mean())
    assert (np.diff(shares) > 0.0).all()


@pytest.mark.parametrize("which", range(3))
def test_a_speed_beyond_the_limits_is_refused_with_the_greatest_that_works(which: int) -> None:
    joint_path = (default_joint_path(), *random_joint_paths(2))[which]
    with pytest.raises(NoSolution) as info:
        make_law("constant_speed", speed=30.0).run(joint_path, LIMITS)
    assert info.value.s is not None and 0.0 <= info.value.s <= joint_path.end
    assert info.value.joint in paper6r().joint_names
    greatest = float(info.value.advice.removeprefix("speed=").split()[0])
    assert "timing='optimal' with tool_speed=30" in info.value.advice
    trajectory = make_law("constant_speed", speed=greatest).run(joint_path, LIMITS)
    middle = np.array([0.5 * trajectory.duration])
    assert speed_of_tool(trajectory, middle)[0] == pytest.approx(greatest, rel=1e-8)
    with pytest.raises(NoSolution):
        make_law("constant_speed", speed=1.001 * greatest).run(joint_path, LIMITS)


def test_a_speed_limit_of_the_tool_bounds_the_constant_speed() -> None:
    trajectory = make_law("constant_speed").run(default_joint_path(), MotionLimits(2.0, 10.0, 100.0, tool_speed=0.1))
    assert speed_of_tool(trajectory, np.array([0.5 * trajectory.duration]))[0] == pytest.approx(0.1, rel=1e-6)
    with pytest.raises(NoSolution, match="limit on tool speed") as info:
        make_law("constant_speed", speed=0.11).run(default_joint_path(), MotionLimits(2.0, 10.0, 100.0, tool_speed=0.1))
    assert info.value.joint is None


def corner(blend: float) -> JointPath:
    poses = np.tile(default_line().start, (3, 1, 1))
    poses[1:, :3, 3] += [[0.0, 0.05, 0.0], [0.03, 0.05, 0.03]]
    followed = follow(make_solver(paper6r(), "lm"), Polyline(poses, blend=blend), cases.START).joint_path
    assert followed is not None
    return followed


def test_a_corner_that_makes_all_a_crawl_is_named_unless_that_speed_is_asked() -> None:
    joint_path = corner(1e-7)
    with pytest.raises(NoSolution, match="one that slows at corners only about") as info:
        make_law("constant_speed").run(joint_path, LIMITS)
    assert info.value.s == pytest.approx(0.05, abs=1e-5)
    assert info.value.joint in paper6r().joint_names
    assert "a larger blend" in info.value.advice
    speed = float(info.value.advice.split("speed=")[1].split()[0])
    slow = make_law("constant_speed", speed=speed).run(joint_path, LIMITS)
    assert slow.duration == pytest.approx(joint_path.end / speed, rel=0.1)
    assert make_law("constant_speed").run(corner(1e-3), LIMITS).duration < 10.0


def test_a_tool_that_only_turns_turns_at_one_speed() -> None:
    start = default_line().start
    joint_path = cases.followed_line(start, oracles.moved(start, np.zeros(3), np.array([0.3, -0.2, 0.2])))
    trajectory = make_law("constant_speed", speed=0.2).run(joint_path, LIMITS)
    speeds = oracles.speeds(PAPER, trajectory, np.linspace(0.3, 0.7, 9) * trajectory.duration)[:, 1]
    np.testing.assert_allclose(speeds, 0.2, rtol=1e-8)


def test_the_speed_is_the_tools_also_where_s_is_no_distance() -> None:
    path = Uneven(default_line())
    joint_path = follow(make_solver(paper6r(), "dls"), path, cases.START).joint_path
    assert joint_path is not None
    trajectory = make_law("constant_speed", speed=0.1).run(joint_path, LIMITS)
    speeds = speed_of_tool(trajectory, np.linspace(0.3, 0.7, 41) * trajectory.duration)
    np.testing.assert_allclose(speeds, 0.1, rtol=1e-6)
    straight = make_law("constant_speed", speed=0.1).run(default_joint_path(), LIMITS)
    assert trajectory.duration == pytest.approx(straight.duration, rel=1e-3)
    one, other = (distance_of(path, LIMITS).table for path in (joint_path, default_joint_path()))
    assert one.s[-1] == pytest.approx(other.s[-1], rel=1e-9)
    slowness, rows = (make_interp_spline(other.s, y)(one.s) for y in (other.slowness, other.parts))
    np.testing.assert_allclose(one.slowness, slowness, rtol=1e-4)  # the joint that bounds it changes
    off = np.abs(one.parts - rows).max(axis=(0, 2)) / np.abs(rows).max(axis=(0, 2))
    assert (off <= [1e-6, 1e-3, 1e-6, 1e-3, 3e-2]).all()


# ---------------------------------------------------------------- the refit of a law on s
def chain(joint_path: JointPath, law: PPoly, t: float, k: int) -> tuple[Array, Array, Array, Array]:
    """q, q̇, q̈ and jerk of q(s(t)) by the chain rule, s on the law's piece k."""
    u = t - law.x[k]
    s, v, a, j = (np.polyval(np.polyder(law.c[:, k], order) if order else law.c[:, k], u) for order in range(4))
    q = [joint_path(float(np.clip(s, 0.0, joint_path.end)), order) for order in range(4)]
    return (q[0], q[1] * v, q[1] * a + q[2] * v**2, q[1] * j + 3.0 * q[2] * v * a + q[3] * v**3)


LAWS = {
    "jerk limited": lambda end: oracles.s_curve(end, 4.0, 0.25, 0.1),
    "slow": lambda end: oracles.s_curve(end, 1.0, 2.0, 1.0),
    "acceleration jumps": lambda end: constant_acceleration(
        np.array([0.0, 0.2, 0.7, 1.0]) * end, np.array([0.0, 0.4, 0.5, 0.0])
    ),
}


@pytest.mark.parametrize("name", LAWS)
@lines
def test_what_the_refit_is_checked_by_is_the_chain_rule(name: str, joint_path: JointPath) -> None:
    """Jerk as the derivative of acceleration, by differences inside a piece of the law where the joint path is smooth."""
    law = LAWS[name](joint_path.end)
    k = int(np.argmax(np.diff(law.x)))
    t = law.x[k] + np.array([0.31, 0.5, 0.77]) * (law.x[k + 1] - law.x[k])
    q, jerk = base._exact(joint_path, law, law.x[k : k + 2], t[None])
    exact = [chain(joint_path, law, x, k) for x in t]
    np.testing.assert_allclose(q, [x[0] for x in exact], rtol=0.0, atol=1e-13)
    h = 1e-5
    by_differences = [
        (chain(joint_path, law, x + h, k)[2] - chain(joint_path, law, x - h, k)[2]) / (2.0 * h) for x in t
    ]
    np.testing.assert_allclose(jerk, by_differences, rtol=0.0, atol=1e-5 * np.abs(jerk).max())


@pytest.mark.parametrize("name", LAWS)
@lines
def test_the_refit_agrees_with_the_chain_rule_between_its_knots(name: str, joint_path: JointPath) -> None:
    law = LAWS[name](joint_path.end)
    trajectory = refit(joint_path, law, 100.0)
    knots = trajectory.knots
    assert trajectory.duration == law.x[-1]
    assert np.isin(law.x, knots).all(), "a knot at every switch"
    rng = np.random.default_rng(0)
    worst = np.zeros(4)
    for i in rng.choice(len(knots) - 1, 40):
        k = int(np.clip(np.searchsorted(law.x, 0.5 * (knots[i] + knots[i + 1]), side="right") - 1, 0, len(law.x) - 2))
        for u in (0.05, 0.2, 0.45, 0.7, 0.95):
            t = knots[i] + u * (knots[i + 1] - knots[i])
            off = [
                np.abs(trajectory(t, order) - exact).max() for order, exact in enumerate(chain(joint_path, law, t, k))
            ]
            worst = np.maximum(worst, off)
    assert worst[0] <= 1e-8
    assert worst[1] <= 1e-6
    assert worst[2] <= 1e-3
    assert worst[3] <= 1.0  # 1 % of the jerk scale


@pytest.mark.parametrize("name", LAWS)
def test_the_refit_has_the_laws_one_sided_accelerations_at_its_switches(name: str) -> None:
    joint_path = default_joint_path()
    law = LAWS[name](joint_path.end)
    trajectory = refit(joint_path, law, 100.0)
    for k in range(len(law.x) - 1):
        i = int(np.flatnonzero(trajectory.knots == law.x[k])[0])
        j = int(np.flatnonzero(trajectory.knots == law.x[k + 1])[0])
        for t, piece in ((law.x[k], i), (law.x[k + 1], j - 1)):
            exact = chain(joint_path, law, t, k)
            for order, tolerance in enumerate((1e-12, 1e-10, 1e-8)):
                mine = oracles.value(trajectory, t, order, piece)
                np.testing.assert_allclose(
                    mine, exact[order], rtol=0.0, atol=tolerance * (1 + np.abs(exact[order]).max())
                )


@pytest.mark.parametrize("name", LAWS)
def test_the_refit_is_continuous_and_ends_where_the_joint_path_ends(name: str) -> None:
    joint_path = default_joint_path()
    trajectory = refit(joint_path, LAWS[name](joint_path.end), 100.0)
    np.testing.assert_allclose(trajectory(0.0), joint_path.q[0], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(trajectory(trajectory.duration), joint_path.q[-1], rtol=0.0, atol=1e-13)
    assert np.abs(trajectory.jumps(0)).max() <= 1e-13
    assert np.abs(trajectory.jumps(1)).max() <= 1e-10
    jump = np.abs(trajectory.jumps(2)).max()
    assert (jump > 0.1) == (name == "acceleration jumps")


def test_a_finer_jerk_scale_gives_a_finer_refit() -> None:
    joint_path = default_joint_path("dls", 15)
    law = oracles.s_curve(joint_path.end, 4.0, 0.25)
    rough, fine = (refit(joint_path, law, scale) for scale in (1e6, 0.1))
    assert len(fine.knots) > len(rough.knots)
    assert isinstance(fine, Trajectory)
