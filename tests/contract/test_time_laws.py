"""What every time law must keep, whatever its method: runs over all files in planners/timing."""

from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest

from optik.errors import InvalidInput, NoSolution
from optik.registry import short_name
from optik.types import Array
from planners import Line, MotionLimits, Plan, Polyline, Trajectory, certify, make_law, plan
from planners.following.joint_path import JointPath
from planners.limits import ALL_LIMITS, DERIVATIVES, LOADED, TOOL_SPEEDS
from planners.timing import TimeLaw
from tests import oracles
from tests.oracles import PAPER
from tests.outside import everything
from tests.planners import cases
from tests.planners.cases import default_joint_path, paper6r, random_joint_paths

LINES = range(5)
SETS = {"fast": (2.0, 10.0, 100.0), "slow": (1.0, 2.0, 20.0)}

PROMISE = {"toppra": 1.0 + 2e-5}
"""Largest ratio of what a law promises. TOPP-RA sets its limits at grid points only: shown, not mended."""
ON_PATH = {"quintic": 2e-5}
"""Largest distance to the path [m]; the paper's law leaves it between its samples."""

every_law = pytest.mark.parametrize("law", everything("planners.timing"), ids=short_name)
every_line = pytest.mark.parametrize("line", LINES, ids="line{}".format)
every_set = pytest.mark.parametrize("limits", SETS)


def every_motion(test: Any) -> Any:
    return every_law(every_line(every_set(test)))


def joint_path_of(line: int) -> JointPath:
    """The default line, and lines drawn at random; every other one turns the tool."""
    return (default_joint_path(), *random_joint_paths(4))[line]


@cache
def motion(law: str, line: int, limits: str) -> Trajectory:
    return make_law(law).run(joint_path_of(line), MotionLimits(*SETS[limits]))


def joint_limits(law: str) -> tuple[str, ...]:
    """What the law keeps of velocity, acceleration and jerk."""
    return tuple(f for f in DERIVATIVES if f in make_law(law).enforced)


def instants(trajectory: Trajectory, count: int) -> Array:
    """Knots, and instants that are none."""
    t = np.concatenate([np.linspace(0.0, trajectory.duration, count), trajectory.knots])
    return np.unique(t)


@every_law
def test_a_law_says_its_name_and_what_it_keeps(law: str) -> None:
    built = make_law(law)
    assert isinstance(built, TimeLaw)
    assert built.name == short_name(law)
    assert isinstance(built.enforced, tuple)
    assert set(built.enforced) <= set(ALL_LIMITS)
    assert built.enforced == joint_limits(law) + tuple(f for f in (*TOOL_SPEEDS, *LOADED) if f in built.enforced)


@every_motion
def test_it_starts_at_the_start_and_ends_at_the_end_of_the_joint_path(law: str, line: int, limits: str) -> None:
    trajectory, joint_path = motion(law, line, limits), joint_path_of(line)
    assert 0.0 < trajectory.duration < np.inf
    assert trajectory.knots[0] == 0.0
    np.testing.assert_allclose(trajectory(0.0), joint_path.q[0], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(trajectory(trajectory.duration), joint_path.q[-1], rtol=0.0, atol=1e-9)


@every_motion
def test_it_starts_and_ends_at_rest(law: str, line: int, limits: str) -> None:
    trajectory = motion(law, line, limits)
    first, last = trajectory.ends(1)
    np.testing.assert_allclose(np.stack([first[0], last[-1]]), 0.0, rtol=0.0, atol=1e-9)
    if "jerk" in joint_limits(law):
        first, last = trajectory.ends(2)
        np.testing.assert_allclose(np.stack([first[0], last[-1]]), 0.0, rtol=0.0, atol=1e-6)


@every_motion
def test_position_and_velocity_are_continuous_and_all_is_finite(law: str, line: int, limits: str) -> None:
    trajectory = motion(law, line, limits)
    assert np.isfinite(trajectory.coefficients).all()
    assert np.abs(trajectory.jumps(0)).max() <= 1e-12
    assert np.abs(trajectory.jumps(1)).max() <= 1e-9 * max(1.0, trajectory.extrema(1).worst.max())


@every_motion
def test_the_tool_stays_on_the_path(law: str, line: int, limits: str) -> None:
    trajectory, path = motion(law, line, limits), joint_path_of(line).path
    assert isinstance(path, Line)
    worst = np.zeros(2)
    rng = np.random.default_rng(0)
    for t in rng.uniform(0.0, trajectory.duration, 60):
        worst = np.maximum(worst, oracles.off_line(path.start, path.goal, oracles.fk(PAPER, trajectory(t))))
    assert worst[0] <= ON_PATH.get(law, 1e-6)
    assert worst[1] <= 10.0 * ON_PATH.get(law, 1e-6)


@every_motion
def test_the_tool_never_runs_backwards(law: str, line: int, limits: str) -> None:
    trajectory, path = motion(law, line, limits), joint_path_of(line).path
    s = path.nearest(paper6r().fk(trajectory(instants(trajectory, 301))))
    assert np.diff(s).min() >= -1e-9 * path.end
    assert s[0] == pytest.approx(0.0, abs=1e-9)
    assert s[-1] == pytest.approx(path.end, abs=1e-9)


@every_motion
def test_every_limit_it_promises_is_kept_at_every_instant(law: str, line: int, limits: str) -> None:
    trajectory = motion(law, line, limits)
    x = trajectory.knots
    u = np.linspace(0.0, 1.0, 9) * np.diff(x)[:, None]  # both ends of every piece, so one-sided values too
    for field in joint_limits(law):
        order = DERIVATIVES.index(field) + 1
        c = trajectory.coefficients
        power = np.arange(len(c))[::-1]
        value = np.zeros((*u.shape, trajectory.n))
        for row, p in zip(c, power, strict=True):
            if p >= order:
                value += np.prod(np.arange(p - order + 1, p + 1)) * row[:, None, :] * u[..., None] ** (p - order)
        worst = float(np.abs(value).max())
        limit = SETS[limits][order - 1]
        assert worst <= PROMISE.get(law, 1.0 + 1e-12) * limit
        if field == "jerk":
            assert np.abs(trajectory.jumps(2)).max() <= 1e-6 * trajectory.extrema(2).worst.max()


@every_motion
def test_the_certificate_judges_what_it_promises(law: str, line: int, limits: str) -> None:
    joint_path, bounds, enforced = joint_path_of(line), MotionLimits(*SETS[limits]), joint_limits(law)
    certificate = certify(paper6r(), joint_path.path, motion(law, line, limits), bounds, law=law, enforced=enforced)
    ratios = [certificate.worst(field)[0] for field in enforced]
    assert max(ratios, default=0.0) <= PROMISE.get(law, 1.0)
    assert certificate.is_valid == (max(ratios, default=0.0) <= 1.0)
    assert certificate.rest == (True, True)
    assert certificate.continuous >= 1
    assert (certificate.position_margin > 0.0).all()
    assert certificate.path_error.distance <= ON_PATH.get(law, 1e-6)


@every_law
def test_a_missing_limit_is_named(law: str) -> None:
    enforced = joint_limits(law)
    for missing, absent in product(enforced, (None, np.full(6, np.inf))):
        with pytest.raises(InvalidInput) as info:
            make_law(law).run(default_joint_path(), MotionLimits(**(dict.fromkeys(enforced, 10.0) | {missing: absent})))
        assert info.value.argument == "limits"
        assert missing in str(info.value)
        for other in set(enforced) - {missing}:
            assert other not in info.value.expected.partition(":")[0]
    make_law(law).run(default_joint_path(), MotionLimits(**dict.fromkeys(enforced, 10.0)))


@every_law
def test_limits_of_another_length_are_refused(law: str) -> None:
    for field in joint_limits(law):
        given: dict[str, Any] = {"velocity": 2.0, "acceleration": 10.0, "jerk": 100.0} | {field: [1.0, 2.0]}
        with pytest.raises(InvalidInput, match=rf"^{field}: "):
            make_law(law).run(default_joint_path(), MotionLimits(**given))


@every_law
@pytest.mark.parametrize("joint", [0, 3])
def test_a_limit_of_one_joint_is_kept_by_that_joint(law: str, joint: int) -> None:
    free = MotionLimits(2.0, 10.0, 100.0)
    tight = {f: np.full(6, b) for f, b in zip(DERIVATIVES, (2.0, 10.0, 100.0), strict=True)}
    for bound in tight.values():
        bound[joint] /= 5.0
    law_of = make_law(law)
    slow, fast = (law_of.run(default_joint_path(), m) for m in (MotionLimits(**tight), free))
    for field in joint_limits(law):
        order = DERIVATIVES.index(field) + 1
        assert (slow.extrema(order).worst <= PROMISE.get(law, 1.0) * tight[field]).all()
    if law_of.enforced:
        assert slow.duration > 1.2 * fast.duration


@every_law
@every_line
def test_limits_scaled_by_powers_of_a_factor_scale_the_time(law: str, line: int) -> None:
    """With k v, k² a and k³ j the same motion runs k times as fast; a law that looks at no limit does not change."""
    k = 1.7
    joint_path, law_of = joint_path_of(line), make_law(law)
    one = law_of.run(joint_path, MotionLimits(1.0, 4.0, 30.0)).duration
    other = law_of.run(joint_path, MotionLimits(k, 4.0 * k**2, 30.0 * k**3)).duration
    assert other == pytest.approx(one / k if law_of.enforced else one, rel=1e-3)


@every_law
def test_higher_limits_are_never_slower(law: str) -> None:
    durations = [
        make_law(law).run(default_joint_path(), MotionLimits(2.0 * f, 10.0 * f, 100.0 * f)).duration
        for f in (0.5, 1.0, 2.0, 4.0)
    ]
    assert (np.diff(durations) <= 1e-6).all()


@every_law
def test_the_same_problem_has_the_same_motion(law: str) -> None:
    again = make_law(law).run(joint_path_of(1), MotionLimits(*SETS["fast"]))
    np.testing.assert_array_equal(again.coefficients, motion(law, 1, "fast").coefficients)
    np.testing.assert_array_equal(again.knots, motion(law, 1, "fast").knots)


# ---------------------------------------------------------------- speeds of the tool
def greatest_speed(trajectory: Trajectory, field: str) -> float:
    """Of the tool, over a dense grid."""
    t = np.linspace(0.0, trajectory.duration, 3001)
    return float(oracles.speeds(PAPER, trajectory, t)[:, TOOL_SPEEDS.index(field)].max())


@every_law
@pytest.mark.parametrize("field", TOOL_SPEEDS)
def test_a_speed_of_the_tool_is_kept_and_used_by_the_laws_that_promise_it(law: str, field: str) -> None:
    law_of, joint_path = make_law(law), joint_path_of(1)
    limit = 0.6 * greatest_speed(motion(law, 1, "fast"), field)
    limits = MotionLimits(*SETS["fast"], **{field: limit})
    trajectory = law_of.run(joint_path, limits)
    reached = greatest_speed(trajectory, field)
    if field in law_of.enforced:
        assert reached <= limit * PROMISE.get(law, 1.0 + 1e-9)
        assert reached >= 0.98 * limit
        for order, name in enumerate(DERIVATIVES, start=1):
            if name in law_of.enforced:
                assert trajectory.extrema(order).worst.max() <= SETS["fast"][order - 1] * PROMISE.get(law, 1.0)
    else:
        assert reached > limit


# ---------------------------------------------------------------- paths and limits at the ends of their range
@cache
def short_path(length: float) -> JointPath:
    line = cases.default_line()
    return cases.followed_line(line.start, oracles.moved(line.start, cases.MOVE / line.end * length))


@cache
def one_joint_path() -> JointPath:
    """A turn about the last axis: only joint6 moves."""
    q = cases.START.copy()
    q[5] += 0.5
    return cases.followed_line(paper6r().fk(cases.START), paper6r().fk(q))


@every_law
@pytest.mark.parametrize("length", [1e-3, 1e-5, 1e-8])
def test_short_lines_have_motions_that_keep_the_limits(law: str, length: float) -> None:
    trajectory = make_law(law).run(short_path(length), MotionLimits(*SETS["fast"]))
    assert 0.0 < trajectory.duration < np.inf
    for field in joint_limits(law):
        order = DERIVATIVES.index(field) + 1
        assert trajectory.extrema(order).worst.max() <= SETS["fast"][order - 1] * (1.001 if law == "toppra" else 1.0)
    np.testing.assert_allclose(trajectory(trajectory.duration), short_path(length).q[-1], rtol=0.0, atol=1e-12)


@every_law
@pytest.mark.parametrize(
    "limits",
    [(1e6, 1e8, 1e10), (1e-4, 1e-5, 1e-6), (1e9, 10.0, 100.0), (1e-3, 10.0, 100.0), (2.0, 1e-2, 1e4), (1e3, 1e3, 1e-3)],
)
def test_huge_and_tiny_limits_are_kept(law: str, limits: tuple[float, float, float]) -> None:
    trajectory = make_law(law).run(default_joint_path(), MotionLimits(*limits))
    assert 0.0 < trajectory.duration < np.inf
    for field in joint_limits(law):
        order = DERIVATIVES.index(field) + 1
        assert trajectory.extrema(order).worst.max() <= limits[order - 1] * PROMISE.get(law, 1.0)


@every_law
@pytest.mark.parametrize("free", [("velocity",), ("acceleration",), ("jerk",), ("acceleration", "jerk")])
def test_a_joint_that_moves_may_be_free_in_some_limit(law: str, free: tuple[str, ...]) -> None:
    bound = dict(zip(DERIVATIVES, SETS["fast"], strict=True))
    limits = {f: np.full(6, b) for f, b in bound.items()}
    for field in free:
        limits[field][5] = np.inf
    trajectory = make_law(law).run(one_joint_path(), MotionLimits(**limits))
    assert 0.0 < trajectory.duration < np.inf
    for field in set(joint_limits(law)) - set(free):
        order = DERIVATIVES.index(field) + 1
        assert trajectory.extrema(order).worst[5] <= bound[field] * PROMISE.get(law, 1.0)


@every_law
def test_limits_on_nothing_that_moves_are_no_motion(law: str) -> None:
    if not joint_limits(law):
        return
    limits = {f: np.append(np.full(5, 1.0), np.inf) for f in DERIVATIVES}
    with pytest.raises(NoSolution) as info:
        make_law(law).run(one_joint_path(), MotionLimits(**limits))
    assert "limit" in info.value.reason
    assert paper6r().joint_names[5] in info.value.advice
    assert paper6r().joint_names[0] not in info.value.advice


@every_law
def test_joints_that_do_not_move_stand_still(law: str) -> None:
    trajectory = make_law(law).run(one_joint_path(), MotionLimits(*SETS["fast"]))
    assert np.ptp(trajectory(np.linspace(0.0, trajectory.duration, 200))[:, :5], axis=0).max() <= 1e-12


@cache
def sharp_corners() -> Plan:
    """Corners of 30° between stretches and nearly back on the way, rounded within a tenth of a millimetre."""
    robot = paper6r()
    poses = np.tile(robot.fk(cases.START), (4, 1, 1))
    poses[1, :3, 3] += (0.0, 0.06, 0.0)
    poses[2, :3, 3] += (0.03, 0.008, 0.0)
    poses[3, :3, 3] += (0.03, 0.058, 0.004)
    return plan(robot, Polyline(poses, blend=1e-4), cases.START, limits=MotionLimits(2.0, 10.0, 100.0))


@pytest.mark.parametrize(
    "law", [law for law in everything("planners.timing") if make_law(law).enforced], ids=short_name
)
def test_sharp_corners_are_kept_to_and_certified(law: str) -> None:
    followed = sharp_corners().joint_path
    limits = MotionLimits(2.0, 10.0, 100.0)
    proof = plan(paper6r(), followed.path, cases.START, timing=law, limits=limits, allow="jerk").certificate
    assert proof.is_valid
    assert max(proof.path_error[:2]) <= 1e-6
    s = proof.binding.s
    assert (np.diff(s) >= 0.0).all()
    assert s[-1] >= (1.0 - 1e-9) * followed.end


def test_a_corner_paces_the_corner_only() -> None:
    followed, best = sharp_corners().joint_path, sharp_corners().trajectory.duration
    assert followed is not None
    assert best < 1.2
    assert make_law("ruckig").run(followed, MotionLimits(2.0, 10.0, 100.0)).duration <= 1.5 * best
