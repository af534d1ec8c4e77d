"""Speed limits of a polyline's segments: which one holds where, and what laws and certificates make of them."""

import pickle
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from optik.errors import InvalidInput
from optik.types import Array
from planners import MotionLimits, Polyline, Trajectory, certify, load_motion, plan, replan, save
from planners.certificate.analysis import MotionAnalysis
from planners.following.joint_path import JointPath
from planners.limits import PathPoints, motion_limits, tool_limits_at
from planners.motion.motion import find_stretch_factor
from planners.trajectory.curve import apply_chain_rule, quintic_through
from tests.planners.cases import START, default_line, paper6r

SPEEDS = (0.1, 0.3, 0.05)
PLACES = np.array([[0.0, 0.0, 0.0], [-0.06, 0.0, 0.1], [-0.12, 0.05, 0.12], [-0.1, 0.1, 0.2]])
LAWS = ("smooth", "ruckig", "constant_speed", "toppra", "optimal")


def limits(speeds: tuple[float, ...] | float = SPEEDS) -> MotionLimits:
    return MotionLimits(3.0, 15.0, 300.0, tool_speed=speeds)


@cache
def bent() -> Polyline:
    waypoints = np.tile(paper6r().fk(START), (len(PLACES), 1, 1))
    waypoints[:, :3, 3] += PLACES
    return Polyline(waypoints, blend=2e-3)


@cache
def along_bent() -> JointPath:
    return plan(paper6r(), bent(), START, limits=limits(0.3), timing="smooth").joint_path


def segment_of(points: Array) -> Array:
    """Of tool positions (k, 3): the segment whose straight line they are on, −1 − i within the corner after segment i."""
    corners = bent().waypoints[:, :3, 3]
    found = np.full(len(points), -9)
    for i, (a, b) in enumerate(pairwise(corners)):
        e = (b - a) / np.linalg.norm(b - a)
        part = (points - a) @ e
        off = np.linalg.norm(points - a - part[:, None] * e, axis=1)
        found[(off < 2e-8) & (part > -1e-9) & (part < np.linalg.norm(b - a) + 1e-9)] = i
    middle = found == -9
    nearest = np.linalg.norm(points[:, None] - corners[None, 1:-1], axis=2).argmin(axis=1)
    found[middle] = -1 - nearest[middle]
    return found


def dense(motion: Trajectory, speeds: tuple[float, ...], count: int = 40_001) -> tuple[Array, Array]:
    """Times, and ratios of differences of the tool's position to the limit of where it is."""
    t = np.linspace(0.0, motion.end, count)
    points = paper6r().fk(motion(t))[:, :3, 3]
    v = np.linalg.norm(points[2:] - points[:-2], axis=1) / (t[2:] - t[:-2])
    at = segment_of(points)[1:-1]
    corner = np.clip(-1 - at, 0, len(speeds) - 2)
    each = np.array(speeds)
    bound = np.where(at >= 0, each[np.maximum(at, 0)], np.minimum(each[corner], each[corner + 1]))
    return t[1:-1], v / bound


def test_a_corner_has_the_lesser_limit_of_both_its_segments() -> None:
    assert bent().segments == 3
    assert bent().least_on_pieces(np.array(SPEEDS)).tolist() == [0.1, 0.1, 0.3, 0.05, 0.05]
    twice = np.insert(bent().waypoints, 1, bent().waypoints[0], axis=0)  # two equal waypoints: one segment is left out
    path = Polyline(twice, blend=2e-3)
    assert (path.segments, path.dropped) == (4, (1,))
    assert path.least_on_pieces(np.array([0.7, 0.1, 0.3, 0.05])).tolist() == [0.1, 0.1, 0.3, 0.05, 0.05]
    assert path.least_on_pieces(np.array([0.02, 0.1, 0.3, 0.05])).tolist() == [0.02, 0.02, 0.3, 0.05, 0.05]
    assert default_line().least_on_pieces(np.array([0.4])).tolist() == [0.4]


@pytest.mark.parametrize("speeds", [SPEEDS, (0.1, 0.1, 0.3), (0.2, 0.2, 0.2), 0.3])
def test_the_speed_changes_at_the_breaks_at_which_its_limits_differ(speeds: tuple[float, ...] | float) -> None:
    least = bent().least_on_pieces(np.broadcast_to(speeds, 3).astype(float))
    expected = bent().breaks[1:-1][np.diff(least) != 0.0]
    assert motion_limits.find_tool_limit_changes(limits(speeds), bent()).tolist() == expected.tolist()


def test_rows_have_the_limit_of_their_place_and_at_a_break_the_lesser() -> None:
    path, joints = bent(), along_bent()
    rows = limits().rows("tool_speed", PathPoints(joints, path.breaks))[:, 0, 0]
    size = np.linalg.norm(path.twist(path.breaks)[:, :3], axis=1)
    np.testing.assert_allclose(size / rows, [0.1, 0.1, 0.1, 0.05, 0.05, 0.05], rtol=1e-12)
    middles = 0.5 * (path.breaks[1:] + path.breaks[:-1])
    rows = limits().rows("tool_speed", PathPoints(joints, middles))[:, 0, 0]
    np.testing.assert_allclose(np.linalg.norm(path.twist(middles)[:, :3], axis=1) / rows, [0.1, 0.1, 0.3, 0.05, 0.05])


@pytest.mark.parametrize("law", LAWS)
def test_laws_keep_the_limit_of_every_segment(law: str) -> None:
    found = plan(paper6r(), bent(), START, limits=limits(), timing=law, allow="jerk")
    assert found and found.certificate.is_valid, found.certificate.reasons
    ratio = dense(found.trajectory, SPEEDS)[1]
    proof = found.certificate.tool_speed
    assert 0.95 < ratio.max() <= proof.ratio * (1.0 + 1e-5) and proof.ratio <= 1.0 + 1e-12
    if law in ("ruckig", "toppra", "optimal"):  # which are as fast as each piece allows
        least = float((np.diff(bent().breaks) / bent().least_on_pieces(np.array(SPEEDS))).sum())
        assert least < found.trajectory.duration < (1.02 if law == "toppra" else 1.05) * least
        assert "tool_speed" in found.certificate.binding.limit


@pytest.mark.parametrize("speeds", [(0.3, 0.2, 0.3), (0.05, 0.3, 0.3), (0.3, 0.3, 0.05), (0.3, 0.02, np.inf)])
def test_the_proof_is_of_each_segment_on_its_own_stretch(speeds: tuple[float, ...]) -> None:
    motion = plan(paper6r(), bent(), START, limits=limits(0.3), timing="ruckig").trajectory
    proof = certify(paper6r(), bent(), motion, limits(speeds), enforced=("tool_speed",))
    times, ratio = dense(motion, speeds)
    k = int(ratio.argmax())
    assert ratio[k] <= proof.tool_speed.ratio * (1.0 + 1e-5)
    assert proof.tool_speed.ratio == pytest.approx(ratio[k], rel=2e-3)  # differences of positions at 40 kHz
    assert not proof.is_valid and "tool_speed of tool" in proof.reasons[0]
    near = ratio > 0.998 * ratio[k]
    assert times[near].min() - 1e-3 <= proof.tool_speed.time <= times[near].max() + 1e-3
    assert proof.binding.ratio.max() == pytest.approx(proof.tool_speed.ratio, rel=0.02)
    alone = certify(paper6r(), bent(), motion, limits(0.3))
    assert proof.tool_speed.value == alone.tool_speed.value
    factor = find_stretch_factor(MotionAnalysis(paper6r(), motion, bent()), limits(speeds), ("tool_speed",))
    assert factor == pytest.approx(proof.tool_speed.ratio, rel=1e-9)


def by_nearest_place(motion: Trajectory, speeds: tuple[float, ...]) -> tuple[Array, Array]:
    """Times, and ratios of differences of the tool's position to the limit of the nearest place of the bent path."""
    times, places = np.linspace(0.0, motion.end, 40_001), np.linspace(0.0, bent().end, 40_001)
    points = paper6r().fk(motion(times))[:, :3, 3]
    place = places[cKDTree(bent().pose(places)[:, :3, 3]).query(points)[1]]
    bound = bent().least_on_pieces(np.array(speeds))[np.searchsorted(bent().breaks[1:-1], place)]
    return times, np.linalg.norm(np.gradient(points, times, axis=0), axis=1) / bound


def through_places(t: Array, s: Array, v: Array, a: Array) -> Trajectory:
    """The motion through places of the path at knots t, with ṡ and s̈ there."""
    q, q1, q2 = (along_bent()(s, i) for i in range(3))
    return Trajectory(quintic_through(t, q, *apply_chain_rule((q1, q2), (v[:, None], a[:, None]))))


@pytest.mark.parametrize("knots", [24, 9])
@pytest.mark.parametrize(
    "speeds", [(0.1, 1.0, 1.0), (1.0, 0.1, 1.0), (1.0, 1.0, 0.1), (1.0, 0.2, 0.01), (0.01, 0.2, 1.0)]
)
def test_a_limit_that_changes_between_two_knots_begins_at_its_place(speeds: tuple[float, ...], knots: int) -> None:
    t = np.linspace(0.0, 1.0, knots)  # no knot is at a break; two limits change between two of few
    s = bent().end * (10 * t**3 - 15 * t**4 + 6 * t**5)
    v = bent().end * (30 * t**2 - 60 * t**3 + 30 * t**4)
    a = bent().end * (60 * t - 180 * t**2 + 120 * t**3)
    assert np.abs(s[:, None] - bent().breaks[1:-1]).min() > 1e-4
    motion = through_places(t, s, v, a)
    proof = certify(paper6r(), bent(), motion, limits(speeds), enforced=("tool_speed",))
    assert proof.coverage.missing[2] == (0.0, 0.0)
    times, ratio = by_nearest_place(motion, speeds)
    assert proof.tool_speed.ratio == pytest.approx(ratio.max(), rel=1e-3)
    assert proof.tool_speed.time == pytest.approx(times[ratio.argmax()], abs=1e-3)


@pytest.mark.parametrize(("side", "speeds"), [(1.0, (0.001, 1.0, 1.0)), (-1.0, (1.0, 1.0, 0.001))])
def test_where_a_motion_goes_back_over_a_break_between_knots_the_lesser_limit_counts(
    side: float, speeds: tuple[float, ...]
) -> None:
    """Both ends of its one piece are on one side of the slow corner; between them it dips into that and returns."""
    place = float(bent().breaks[2 if side > 0.0 else 3])
    still = np.zeros(2)
    motion = through_places(np.array([0.0, 1.0]), place + np.full(2, side * 1e-3), still, np.full(2, side * -0.064))
    proof = certify(paper6r(), bent(), motion, limits(speeds), enforced=("tool_speed",))
    ratio = by_nearest_place(motion, speeds)[1]
    assert max(proof.coverage.missing[2]) > 1e-4  # it does go back
    assert ratio.max() > 1.0
    assert ratio.max() * (1.0 - 1e-4) <= proof.tool_speed.ratio < 20.0 * ratio.max()


@cache
def straight() -> tuple[Polyline, JointPath]:
    """A straight way of three segments, the second of them 2 mm."""
    waypoints = np.tile(paper6r().fk(START), (4, 1, 1))
    waypoints[:, :3, 3] += np.multiply.outer([0.0, 0.05, 0.052, 0.1], [-0.6, 0.0, 0.8])
    path = Polyline(waypoints, blend=1e-4)
    return path, plan(paper6r(), path, START, limits=limits(0.3), timing="smooth").joint_path


def along_straight(
    t: Array, s: Array, v: Array, a: Array, speeds: tuple[float, ...]
) -> tuple[float, float, float, float]:
    """The proved ratio of a motion through places at knots, and when; and the largest of dense samples, and when."""
    path, joints = straight()
    q, q1, q2 = (joints(s, i) for i in range(3))
    motion = Trajectory(quintic_through(t, q, *apply_chain_rule((q1, q2), (v[:, None], a[:, None]))))
    proof = certify(paper6r(), path, motion, limits(speeds), enforced=("tool_speed",)).tool_speed
    times = np.linspace(0.0, motion.end, 40_001)
    points = paper6r().fk(motion(times))[:, :3, 3]
    place = (points - path.pose(0.0)[:3, 3]) @ [-0.6, 0.0, 0.8]
    bound = path.least_on_pieces(np.array(speeds))[np.searchsorted(path.breaks[1:-1], place)]
    ratio = np.linalg.norm(np.gradient(points, times, axis=0), axis=1) / bound
    return proof.ratio, proof.time, ratio.max(), times[ratio.argmax()]


@pytest.mark.parametrize("speeds", [(1.0, 0.2, 0.01), (0.01, 0.2, 1.0), (0.3, 1.0, 0.01), (1.0, 0.02, 1.0)])
def test_two_limits_that_change_between_two_instants_each_count_from_their_place(speeds: tuple[float, ...]) -> None:
    t = np.linspace(0.0, 1.0, 8)  # from the fourth to the fifth it runs over the second segment
    s, v, a = t**3 * (10 - 15 * t + 6 * t**2), 30 * (t * (1 - t)) ** 2, 60 * t * (1 - t) * (1 - 2 * t)
    ratio, time, largest, when = along_straight(t, *(straight()[0].end * x for x in (s, v, a)), speeds)
    assert ratio == pytest.approx(largest, rel=1e-3)
    assert time == pytest.approx(when, abs=1e-3)


@pytest.mark.parametrize(("place", "side"), [(1, -1.0), (2, 1.0), (2, -1.0), (3, 1.0)])
@pytest.mark.parametrize("over", [2e-6, 1e-3])
def test_a_motion_that_dips_into_a_slow_segment_between_two_instants_has_its_limit(
    place: int, side: float, over: float
) -> None:
    """Pieces are the first segment, its corner, the next one, and the last segment; both corners have the lesser limit."""
    slow, speeds = 1e-6 if over < 1e-4 else 1e-3, np.ones(3)
    speeds[1 if place != 2 else 0 if side > 0.0 else 2] = slow
    a, t = np.array([-0.064, -0.05]), np.linspace(0.0, 1.0, 10_001)
    dip = -0.5 * (a[0] * t**2 * (1 - t) ** 3 + a[1] * t**3 * (1 - t) ** 2)
    s = straight()[0].breaks[place] + np.full(2, side * (dip.max() - over))
    ratio, _, largest, _ = along_straight(np.array([0.0, 1.0]), s, np.zeros(2), side * a, tuple(speeds))
    assert largest > 1.0
    assert largest * (1.0 - 1e-4) <= ratio < 5.0 * largest


def test_a_wrong_count_is_named_with_both_numbers() -> None:
    wrong = limits((0.1, 0.3))
    motion = plan(paper6r(), bent(), START, limits=limits(0.3), timing="smooth")
    for call in (
        lambda: plan(paper6r(), bent(), START, limits=wrong),
        lambda: certify(paper6r(), bent(), motion.trajectory, wrong),
        lambda: replan(motion, 0.2, limits=wrong),
    ):
        with pytest.raises(
            InvalidInput, match=r"expected 3 numbers, one for each segment of the polyline, .*; got 2 num"
        ):
            call()
    with pytest.raises(
        InvalidInput, match="rotation_speed: expected one number: a line has one segment; got 2 numbers"
    ):
        plan(paper6r(), default_line(), START, limits=MotionLimits(2.0, 10.0, 100.0, rotation_speed=(1.0, 2.0)))
    with pytest.raises(InvalidInput, match="path"):
        find_stretch_factor(MotionAnalysis(paper6r(), motion.trajectory), limits())
    for bad in ((0.1, -0.3, 0.2), (), (0.1, float("nan")), [[0.1, 0.2]], (0.1, "x")):
        with pytest.raises(InvalidInput, match="tool_speed"):
            MotionLimits(tool_speed=bad)


def test_limits_of_segments_are_values(tmp_path: Path) -> None:
    one = limits()
    assert one == pickle.loads(pickle.dumps(one)) == MotionLimits.from_plain(one.to_plain(), 6)
    assert hash(one) == hash(limits((0.1, 0.3, 0.05))) and one != limits((0.1, 0.3, 0.06))
    assert limits((0.2,)) == limits(0.2)
    assert one.scale(2.0).value("tool_speed").tolist() == [0.2, 0.6, 0.1]
    assert one.to_dict(6)["tool_speed"] == list(SPEEDS)
    assert one.tool == (0.3, np.inf)
    assert tool_limits_at(one, bent(), np.array([0.05, 0.15]))[:, 0].tolist() == [0.1, 0.3]
    motion = plan(paper6r(), bent(), START, limits=one, timing="ruckig").motion
    for suffix in (".json", ".csv", ".npz"):
        save(motion, tmp_path / f"motion{suffix}")
        again = load_motion(tmp_path / f"motion{suffix}")
        assert again.limits == one and again.certify().tool_speed == motion.certify().tool_speed
