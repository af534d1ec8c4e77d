"""What holds for one law only; what holds for every law stands in tests/contract/test_time_laws.py."""

from __future__ import annotations

import socket
from typing import Any

import numpy as np
import pytest
import ruckig
import toppra
from numpy.typing import NDArray
from scipy.interpolate import PPoly

import planners.timing.ruckig as ruckig_law
from optik.errors import InvalidInput
from optik.ik import make_solver
from planners import JointPath, MotionLimits, Trajectory, certify, follow, make_law
from planners.timing.base import refit
from planners.timing.toppra import constant_acceleration
from tests.planners import plain
from tests.planners.plain import default_joint_path, default_line, paper6r, random_joint_paths

Array = NDArray[np.float64]
LIMITS = MotionLimits(2.0, 10.0, 100.0)
SETS = [LIMITS, MotionLimits(1.0, 2.0, 20.0)]
lines = pytest.mark.parametrize("joint_path", range(4), ids="line{}".format, indirect=True)
limit_sets = pytest.mark.parametrize("limits", SETS, ids=["fast", "slow"])


@pytest.fixture
def joint_path(request: pytest.FixtureRequest) -> JointPath:
    """The default line, and three drawn at random."""
    return (default_joint_path(), *random_joint_paths(3))[request.param]


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


def test_the_papers_velocity_is_the_chord_over_the_time_without_rotation() -> None:
    V = default_line()(0.0, 1) * default_line().end / 3.0
    np.testing.assert_allclose(V, [*(plain.MOVE / 3.0), 0.0, 0.0, 0.0], rtol=0.0, atol=1e-15)


def test_another_duration_and_step_are_kept() -> None:
    trajectory = make_law("quintic", duration=1.5, step=0.05).run(default_joint_path(), LIMITS)
    assert trajectory.duration == 1.5
    np.testing.assert_allclose(trajectory.knots, 0.05 * np.arange(31), rtol=0.0, atol=1e-14)
    middle = np.linalg.solve(paper6r().jacobian(trajectory(0.75)), [*(plain.MOVE / 1.5), 0.0, 0.0, 0.0])
    np.testing.assert_allclose(trajectory(0.75, 1), middle, rtol=0.0, atol=1e-10)


def test_the_papers_law_reaches_full_speed_within_one_step() -> None:
    trajectory = make_law("quintic").run(default_joint_path(), LIMITS)
    speed = [np.linalg.norm((plain.jacobian(trajectory(t)) @ trajectory(t, 1))[:3]) for t in (0.0, 0.02, 1.5, 3.0)]
    np.testing.assert_allclose(speed, [0.0, default_line().end / 3, default_line().end / 3, 0.0], rtol=1e-9, atol=1e-12)
    hardest = trajectory.extrema(2).t_worst
    assert np.minimum(hardest, 3.0 - hardest).max() <= 0.02


@pytest.mark.parametrize(
    ("argument", "options"),
    [
        ("duration", {"duration": 0.0}),
        ("duration", {"duration": -3.0}),
        ("duration", {"duration": np.nan}),
        ("duration", {"duration": np.inf}),
        ("step", {"step": 0.0}),
        ("step", {"step": 2.0}),
        ("step", {"step": np.nan}),
        ("options", {"speed": 1.0}),
    ],
)
def test_times_that_cannot_be_meant_are_refused(argument: str, options: dict[str, float]) -> None:
    with pytest.raises(InvalidInput) as info:
        make_law("quintic", **options)
    assert info.value.argument == argument


# ---------------------------------------------------------------- ruckig


@lines
@limit_sets
def test_ruckig_on_s_keeps_velocity_acceleration_and_jerk_exactly(joint_path: JointPath, limits: MotionLimits) -> None:
    trajectory = make_law("ruckig").run(joint_path, limits)
    for order, bound in enumerate((limits.velocity, limits.acceleration, limits.jerk), start=1):
        assert trajectory.extrema(order).worst.max() <= bound
        for k in range(len(trajectory.knots) - 1):
            t = np.linspace(trajectory.knots[k], trajectory.knots[k + 1], 7)
            values = [plain.value(trajectory, w, order, k) for w in t]
            assert np.abs(values).max() <= bound * (1.0 + 1e-12)


def test_ruckig_on_s_has_no_jump_of_acceleration() -> None:
    trajectory = make_law("ruckig").run(default_joint_path(), LIMITS)
    assert np.abs(trajectory.jumps(2)).max() <= 1e-6 * trajectory.extrema(2).worst.max()
    first, last = trajectory.ends(2)
    np.testing.assert_allclose(np.stack([first[0], last[-1]]), 0.0, rtol=0.0, atol=1e-6)


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
    real = ruckig_law.ruckig
    proxy = type("Proxy", (), {"__getattr__": lambda self, name: getattr(real, name), "Ruckig": Watched})()
    monkeypatch.setattr(ruckig_law, "ruckig", proxy)
    make_law("ruckig").run(default_joint_path(), LIMITS)
    assert seen
    assert all(positions == [] for positions in seen), "intermediate positions are what ruckig sends to a cloud"


@pytest.mark.parametrize("length", [1e-2, 1e-3])
def test_a_short_line_takes_the_time_of_the_closed_form(length: float) -> None:
    line = default_line()
    goal = plain.moved(line.start, plain.MOVE / line.end * length)
    joint_path = plain.followed_line(line.start, goal)
    trajectory = make_law("ruckig").run(joint_path, LIMITS)
    steepest = np.abs(joint_path.derivatives[:, 0]).max()
    assert trajectory.duration == pytest.approx((32.0 * length * steepest / 100.0) ** (1 / 3), rel=0.02 * length / 1e-2)


@lines
@limit_sets
def test_no_uniform_bounds_on_s_are_much_faster(joint_path: JointPath, limits: MotionLimits) -> None:
    trajectory = make_law("ruckig").run(joint_path, limits)
    assert trajectory.duration <= 1.01 * plain.best_uniform(
        joint_path, limits.velocity, limits.acceleration, limits.jerk
    )


def test_where_jerk_alone_limits_the_time_goes_with_its_cube_root() -> None:
    for joint_path in (default_joint_path(), random_joint_paths(1)[0]):
        durations = [
            make_law("ruckig").run(joint_path, MotionLimits(1e3, 1e3, j)).duration * np.cbrt(j)
            for j in (1e-3, 1e-1, 10.0, 1e3)
        ]
        np.testing.assert_allclose(durations, durations[0], rtol=0.01)


@pytest.mark.parametrize("length", [1e-5, 1e-6])
def test_a_very_short_line_has_a_motion_too(length: float) -> None:
    line = default_line()
    goal = plain.moved(line.start, plain.MOVE / line.end * length)
    joint_path = plain.followed_line(line.start, goal)
    trajectory = make_law("ruckig").run(joint_path, LIMITS)
    assert trajectory.extrema(3).worst.max() <= 100.0


@pytest.mark.parametrize("limits", [(1e3, 1e3, 1e-3), (100.0, 1000.0, 1.0)])
def test_a_jerk_limit_far_below_the_others_has_a_motion_too(limits: tuple[float, float, float]) -> None:
    trajectory = make_law("ruckig").run(default_joint_path(), MotionLimits(*limits))
    assert trajectory.extrema(3).worst.max() <= limits[2]


def test_a_jerk_limit_far_above_the_others_is_kept_exactly_too() -> None:
    for path, limits in (
        (default_joint_path(), (2.0, 1e-2, 1e4)),
        *((path, (1.0, 1e-3, 1e3)) for path in random_joint_paths(3)),
    ):
        trajectory = make_law("ruckig").run(path, MotionLimits(*limits))
        for order, limit in enumerate(limits, start=1):
            assert trajectory.extrema(order).worst.max() <= limit


def test_infinite_limits_are_free_or_refused() -> None:
    try:
        trajectory = make_law("ruckig").run(default_joint_path(), MotionLimits(2.0, np.inf, np.inf))
    except InvalidInput:
        return
    assert trajectory.extrema(1).worst.max() <= 2.0


def test_samples_close_together_do_not_slow_the_motion() -> None:
    line = default_line()
    dense = follow(make_solver(paper6r(), "dls"), line, plain.START, samples=20_001).joint_path
    assert dense is not None
    durations = [make_law("ruckig").run(path, LIMITS).duration for path in (default_joint_path(), dense)]
    assert durations[1] == pytest.approx(durations[0], rel=5e-3)


# ---------------------------------------------------------------- toppra


@lines
@limit_sets
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
    assert trajectory.duration == pytest.approx(theirs.duration, rel=1e-5)


@lines
@limit_sets
def test_toppra_uses_a_limit_to_the_full_almost_everywhere(joint_path: JointPath, limits: MotionLimits) -> None:
    trajectory = make_law("toppra").run(joint_path, limits)
    t = np.linspace(0.0, trajectory.duration, 999)[1:-1]
    used = np.maximum(
        np.abs(trajectory(t, 1)).max(axis=1) / limits.velocity,
        np.abs(trajectory(t, 2)).max(axis=1) / limits.acceleration,
    )
    assert np.median(used) > 0.98
    assert np.quantile(used, 0.05) > 0.95


@lines
@limit_sets
def test_the_certificate_of_toppra_says_the_exact_acceleration_jumps_included(
    joint_path: JointPath, limits: MotionLimits
) -> None:
    law = make_law("toppra")
    trajectory = law.run(joint_path, limits)
    certificate = certify(paper6r(), joint_path.path, trajectory, limits, law="toppra", keeps=law.keeps)
    worst = np.zeros(6)
    for k in range(len(trajectory.knots) - 1):
        for t in np.linspace(trajectory.knots[k], trajectory.knots[k + 1], 9):
            worst = np.maximum(worst, np.abs(plain.value(trajectory, t, 2, k)))
    np.testing.assert_allclose(certificate.acceleration.value, worst, rtol=1e-6)
    assert (certificate.acceleration.value >= worst * (1.0 - 1e-12)).all()
    np.testing.assert_allclose(certificate.acceleration.ratio, worst / limits.acceleration, rtol=1e-6)
    assert np.isinf(certificate.jerk.value).all()
    assert np.isinf(certificate.jerk.ratio).all()
    assert certificate.continuous == 1
    assert np.isfinite(certificate.sampled_jerk).all()


def test_more_grid_points_are_as_fast_and_a_wrong_grid_is_refused() -> None:
    coarse, fine = (make_law("toppra", grid=g).run(default_joint_path(), LIMITS) for g in (100, 800))
    assert coarse.duration == pytest.approx(fine.duration, rel=5e-3)
    for wrong in (0, -3, 9, 10.5, None):
        with pytest.raises(InvalidInput) as info:
            make_law("toppra", grid=wrong)
        assert info.value.argument == "grid"


def test_constant_acceleration_between_speeds() -> None:
    s, speed = np.array([0.0, 0.5, 2.0, 2.5]), np.array([0.0, 1.0, 2.0, 0.5])
    law = constant_acceleration(s, speed)
    np.testing.assert_allclose(law(law.x), s, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(law(law.x, 1)[:-1], speed[:-1], rtol=0.0, atol=1e-14)
    for k in range(3):  # v² − v₀² = 2 a Δs
        a = 2.0 * law.c[0, k]
        assert speed[k + 1] ** 2 - speed[k] ** 2 == pytest.approx(2.0 * a * (s[k + 1] - s[k]), abs=1e-13)


# ---------------------------------------------------------------- the refit of a law on s


def chain(joint_path: JointPath, law: PPoly, t: float, k: int) -> tuple[Array, Array, Array, Array]:
    """q, q̇, q̈ and jerk of q(s(t)) by the chain rule, s on the law's piece k."""
    u = t - law.x[k]
    s, v, a, j = (np.polyval(np.polyder(law.c[:, k], order) if order else law.c[:, k], u) for order in range(4))
    q = [joint_path(float(np.clip(s, 0.0, joint_path.end)), order) for order in range(4)]
    return (
        q[0],
        q[1] * v,
        q[1] * a + q[2] * v**2,
        q[1] * j + 3.0 * q[2] * v * a + q[3] * v**3,
    )


LAWS = {
    "jerk limited": lambda end: plain.s_curve(end, 4.0, 0.25, 0.1),
    "slow": lambda end: plain.s_curve(end, 1.0, 2.0, 1.0),
    "acceleration jumps": lambda end: constant_acceleration(
        np.array([0.0, 0.2, 0.7, 1.0]) * end, np.array([0.0, 0.4, 0.5, 0.0])
    ),
}


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
                mine = plain.value(trajectory, t, order, piece)
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
    law = plain.s_curve(joint_path.end, 4.0, 0.25)
    rough, fine = (refit(joint_path, law, scale) for scale in (1e6, 0.1))
    assert len(fine.knots) > len(rough.knots)
    assert isinstance(fine, Trajectory)
