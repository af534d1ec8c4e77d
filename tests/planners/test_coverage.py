"""A certificate that holds has run through its path: to its end, forwards, at rest there, every joint on its own scale."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly
from scipy.spatial.transform import Rotation

from optik.errors import InvalidInput
from optik.ik import Tolerance
from planners import Arc, Certificate, JointLine, Line, MotionLimits, Trajectory, certify, plan
from planners.certificate.analysis import COVERED, Coverage, measure_between
from planners.trajectory.curve import quintic_through
from tests import oracles
from tests.planners.cases import START, default_line, paper6r

ROBOT = paper6r()
LINE = default_line()
LIMITS = MotionLimits(2.0, 10.0, 100.0)


def judged(motion: Trajectory, **options: Any) -> Certificate:
    return certify(ROBOT, LINE, motion, LIMITS, **({"tolerance": (1e-5, 1e-5)} | options))


@pytest.fixture(scope="module")
def whole() -> Trajectory:
    return plan(ROBOT, LINE, START, limits=LIMITS).trajectory


def pieces(motion: Trajectory, first: int, last: int) -> Trajectory:
    """Some pieces of a motion."""
    knots = motion.knots[first : last + 1]
    return Trajectory(PPoly(motion.coefficients[:, first:last].copy(), knots - knots[0]))


def backwards(motion: Trajectory) -> Trajectory:
    q, v, a = (motion(motion.knots[::-1], order) for order in (0, 1, 2))
    return Trajectory(quintic_through(motion.end - motion.knots[::-1], q, -v, a))


def test_the_whole_motion_holds(whole: Trajectory) -> None:
    proof = judged(whole)
    assert proof.reasons == ()
    assert proof.coverage.wanted == (0.0, LINE.end)
    np.testing.assert_allclose([proof.coverage.begin, proof.coverage.end], [0.0, LINE.end], rtol=0.0, atol=1e-9)


def test_a_motion_without_a_path_covers_itself(whole: Trajectory) -> None:
    end, nothing = whole.end, (0.0, 0.0)
    proof = certify(ROBOT, None, whole, LIMITS)
    assert proof.coverage == Coverage(0.0, end, (0.0, end), end, end, (nothing, nothing, nothing))


def test_half_of_a_motion_does_not_hold(whole: Trajectory) -> None:
    half = pieces(whole, 0, whole.knots.size // 2)
    words = judged(half).reasons
    assert any("the motion ends at s = " in w for w in words)
    assert "the motion does not end at rest" in words
    second = judged(pieces(whole, whole.knots.size // 2, whole.knots.size - 1)).reasons
    assert len(second) == 1
    assert second[0].startswith("the motion begins at s = ")


def test_a_part_that_was_asked_for_holds(whole: Trajectory) -> None:
    m = whole.knots.size // 2
    part = pieces(whole, m, whole.knots.size - 1)
    s = judged(whole).binding.s[m]
    assert judged(part, span=(s, LINE.end)).is_valid
    assert not judged(part, span=(s - 3e-5, LINE.end)).is_valid
    for wrong in ((0.1, 0.05), (-0.1, 0.1), (0.0, 2.0 * LINE.end), (0.0,), "ab"):
        with pytest.raises(InvalidInput, match="span"):
            judged(part, span=wrong)


def test_a_motion_backwards_does_not_hold(whole: Trajectory) -> None:
    words = judged(backwards(whole)).reasons
    assert any("begins at s = 0.233" in w for w in words)
    assert any("ends at s = 0 " in w for w in words)
    assert any("goes back along its path" in w for w in words)


@pytest.mark.parametrize("size", [0.95 * COVERED[0], 1.05 * COVERED[0], 3e-5, 1e-4, 3e-4, 0.01])
def test_a_step_back_on_the_way_does_not_hold(size: float) -> None:
    """To the middle, back along the path by so many metres, on to the end: at rest in between, all of it on the path."""
    joints = plan(ROBOT, LINE, START, limits=LIMITS).joint_path
    stops = np.array([0.0, 0.12, 0.12 - size, LINE.end])
    s, t = [], [0.0]
    for a, b in pairwise(stops):
        u = np.linspace(0.0, 1.0, 61)[(1 if s else 0) :]
        s += [(a + (b - a) * (10 * x**3 - 15 * x**4 + 6 * x**5), 30 * (b - a) * (x * (1 - x)) ** 2,
               60 * (b - a) * x * (1 - x) * (1 - 2 * x)) for x in u]  # fmt: skip
        t += list(t[-1] + u[u > 0.0])
    p, v, a = np.array(s).T[..., None]
    q, q1, q2 = (joints(p[:, 0], order) for order in (0, 1, 2))
    motion = Trajectory(quintic_through(np.array(t), q, q1 * v, q1 * a + q2 * v * v))
    proof = judged(motion, enforced=())
    assert proof.coverage.missing[2][0] == pytest.approx(size, rel=0.01)
    assert len(proof.reasons) == (size > COVERED[0])
    assert proof.is_valid or "goes back along its path" in proof.reasons[0]


@pytest.mark.parametrize("tolerance", [None, (3e-4, 2e-5)])
@pytest.mark.parametrize("part", range(2))
@pytest.mark.parametrize("way", range(3))
def test_what_may_be_missing_is_the_tolerance_and_no_more(
    tolerance: tuple[float, float] | None, part: int, way: int
) -> None:
    words = ("begins at s = 0.1 ", "ends at s = 0.9 ", "goes back along its path, to s = 0.4 ")[way]
    for share in (1.0, 1.01):
        missing = np.zeros((3, 2))
        missing[way, part] = share * (tolerance or COVERED)[part]
        within = tolerance and Tolerance(*tolerance)
        found = Coverage(0.1, 0.9, (0.0, 1.0), 0.4, 0.7, tuple(map(tuple, missing))).find_violations(within, 2.0)
        assert [(words in x.words, x.t) for x in found] == ([(True, (0.0, 2.0, 0.7)[way])] if share > 1.0 else [])


def test_a_step_back_between_two_knots_does_not_hold() -> None:
    """One quintic, on a straight way in joint space, that swings back between its ends."""
    goal = START + np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0])
    c = np.zeros((6, 1, 6))
    c[5, 0] = START
    c[:, 0, 0] = np.polyadd([1.2, -3.0, 2.0, 0.0, 0.0, START[0]], 8.0 * np.poly([0, 0, 0.5, 1, 1]))  # swings by 0.09
    motion = Trajectory(PPoly(c, [0.0, 1.0]))
    assert (np.diff(motion(np.linspace(0.0, 1.0, 101))[:, 0]) < 0.0).any()
    words = certify(ROBOT, JointLine(ROBOT, START, goal), motion, LIMITS, enforced=()).reasons
    assert len(words) == 1
    assert "goes back along its path" in words[0]


def test_standing_still_on_a_circle_does_not_hold() -> None:
    T = ROBOT.fk(START)
    circle = Arc.about(T, T[:3, 3] + np.array([0.05, 0, 0]), [0, 1, 0], 2 * np.pi)
    still = Trajectory(PPoly(np.concatenate([np.zeros((5, 1, 6)), START[None, None]]), np.array([0.0, 1.0])))
    proof = certify(ROBOT, circle, still, LIMITS, tolerance=(1e-5, 1e-5))
    assert proof.reasons == (f"the motion ends at s = 0 of its path, not at {circle.end:.6g}",)


def test_a_tenth_of_a_circle_does_not_hold_and_all_of_it_does() -> None:
    T = ROBOT.fk(START)
    circle = Arc.about(T, T[:3, 3] + np.array([0.03, 0, 0]), [0, 1, 0], 2 * np.pi)
    made = plan(ROBOT, circle, START, limits=LIMITS)
    assert made.certificate.is_valid
    tenth = pieces(made.trajectory, 0, made.trajectory.knots.size // 10)
    assert not certify(ROBOT, circle, tenth, LIMITS, tolerance=(1e-5, 1e-5)).is_valid


@pytest.mark.parametrize("back", [2e-6, 3e-5, 2e-4])
def test_a_short_stretch_back_between_two_knots_is_as_long_as_its_extrema_say(back: float) -> None:
    """A cubic in time along a straight way of one joint, back by so much."""
    goal = START + np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0])
    half = (back / 4.0) ** (1.0 / 3.0)  # x³ − 3 h² x falls by 4 h³
    wave = np.poly1d([1.0, 0.0, -3.0 * half**2, 0.0])
    h = 0.4 * 0.2 ** (1.0 / 3.0)
    v, a = wave.deriv()(h), wave.deriv(2)(h)
    t = np.cumsum([0.0, 0.55, 2.0 * h, 0.55])
    q = np.tile(START, (4, 1))
    q[:, 0] += [0.0, 0.1 + wave(-h), 0.1 + wave(h), 0.2]
    dq, ddq = np.zeros((2, 4, 6))
    dq[1:3, 0], ddq[1, 0], ddq[2, 0] = v, -a, a
    motion = Trajectory(quintic_through(t, q, dq, ddq))
    x = motion(np.linspace(0.0, t[-1], 200_001))[:, 0]
    assert (np.maximum.accumulate(x) - x).max() == pytest.approx(back, rel=1e-4)
    proof = certify(ROBOT, JointLine(ROBOT, START, goal), motion, LIMITS, enforced=())
    T = ROBOT.fk(np.array([START, goal]))  # joint 1 turns the tool about an axis
    radius = np.linalg.norm(T[1, :3, 3] - T[0, :3, 3]) / (2.0 * np.sin(0.1))
    assert proof.coverage.missing[2] == pytest.approx((back * radius, back), rel=1e-2)
    assert proof.coverage.t_back == pytest.approx(t[1] + h, abs=2.0 * half)


def test_the_length_of_a_stretch_is_its_arc_and_its_turn() -> None:
    circle = Arc.about(np.eye(4), np.array([0.05, 0.0, 0.0]), [0.0, 1.0, 0.0], 1.7)
    for a, b in np.random.default_rng(3).uniform(0.0, circle.end, (9, 2)):
        assert measure_between(circle, a, b) == pytest.approx((abs(b - a), 0.0), rel=1e-9)
    turn = Line(np.eye(4), oracles.pose((0.3, 0.1, 0.2), (0.5, 0.4, -0.2)))
    goal = turn.pose(turn.end)
    size = np.linalg.norm(goal[:3, 3]), np.linalg.norm(Rotation.from_matrix(goal[:3, :3]).as_rotvec())
    for a, b in np.random.default_rng(4).uniform(0.0, 1.0, (9, 2)):
        found = measure_between(turn, a * turn.end, b * turn.end)
        assert found == pytest.approx(np.multiply(abs(b - a), size), rel=1e-9)


# ---------------------------------------------------------------- every joint on its own scale
def two_paces(jump: float, fast: float = 1e3) -> Trajectory:
    """Joint 1 from rest to rest, fast; joint 2 begins to move in the middle, with a jump of its velocity."""
    h = 1e-3
    full = np.poly1d(fast * h * np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0]))
    c = np.zeros((6, 2, 6))
    c[5] = START
    for k in range(2):
        local = full(np.poly1d([0.5 / h, 0.5 * k]))
        c[:, k, 0] += np.pad(local.coeffs, (6 - len(local.coeffs), 0))
    c[4, 1, 1] = jump
    return Trajectory(PPoly(c, np.array([0.0, h, 2.0 * h])))


@pytest.mark.parametrize("jump", [1e-6, 0.009, 1.0])
def test_a_slow_joint_that_jumps_beside_a_fast_one_is_seen(jump: float) -> None:
    big = MotionLimits(1e9, 1e12, 1e15)
    way = JointLine(ROBOT, START, START + np.array([1.0, 0, 0, 0, 0, 0]))
    proof = certify(ROBOT, way, two_paces(jump), big)
    assert proof.continuous == 0
    assert not proof.is_valid
    assert proof.acceleration.value[1] == np.inf
    assert proof.jerk.value[1] == np.inf
    assert np.isfinite(proof.acceleration.value[0])


@pytest.mark.parametrize("size", [0.1, 1e-6])
def test_rounding_in_short_pieces_is_no_jump(size: float) -> None:
    """A tenth of a microsecond a piece: the last bit of q is 10⁶ rad/s³ there."""
    t = np.array([0.0, 0.5, 0.5 + 1e-7, 0.5 + 2e-7, 1.0])
    u = np.poly1d([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
    orders = [np.multiply.outer((u.deriv(k) if k else u)(t), size * np.arange(6.0)) for k in range(3)]
    orders[0] += START
    proof = certify(ROBOT, LINE, Trajectory(quintic_through(t, *orders)), LIMITS)
    assert proof.continuous == 2, "the jerk begins and ends with a step, and nothing else jumps"


def test_rounding_of_a_joint_that_stands_is_no_jump() -> None:
    """As splines of other programs have it: where pieces are short, the last bit of q is a velocity."""
    t = np.array([0.0, 0.5, 0.501, 1.0])
    u = np.poly1d([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
    orders = [np.multiply.outer((u.deriv(k) if k else u)(t), 0.1 * np.arange(6.0)) for k in range(3)]
    orders[0] += START
    c = quintic_through(t, *orders).c
    c[4, :, 0] = [2e-16, -1e-13, 2e-16]  # joint 1 stands
    assert certify(ROBOT, LINE, Trajectory(PPoly(c, t)), LIMITS).continuous == 2
    c[4, :, 0] = [2e-16, -1e-9, 2e-16]
    assert certify(ROBOT, LINE, Trajectory(PPoly(c, t)), LIMITS).continuous == 0, "so much is no rounding"


# ---------------------------------------------------------------- what a plan says of it
def test_a_plan_whose_certificate_does_not_hold_is_not_proved_but_can_be_looked_at() -> None:
    made = plan(ROBOT, LINE, START, limits=LIMITS, timing="quintic", tolerance=(1e-8, 1e-8))
    assert not made
    assert made.status == "not_proved"
    assert "certificate is not valid" in made.failure.reason
    assert made.trajectory.end > 0.0
    assert not made.certificate.is_valid
    data = made.to_dict()
    assert data["status"] == "not_proved"
    assert data["certificate"]["is_valid"] is False
