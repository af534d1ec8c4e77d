from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from optik import se3
from optik.errors import InvalidInput
from optik.types import Array
from planners import Line, Polyline
from planners.paths.polyline import SAME_POSE
from tests import oracles
from tests.planners.cases import pose_of, vectors

tolerances = st.floats(-5.0, -1.0).map(lambda e: 10.0**e)


waypoints = st.lists(st.builds(pose_of, vectors, vectors.map(lambda w: 0.8 * w)), min_size=3, max_size=6)


def returns(poses: list[Array]) -> bool:
    """Whether the way back from a pose is that of the way there."""
    rates = [se3.error(a, b) / length(a, b) for a, b in pairwise(poses)]
    return any(np.linalg.norm(a + b) < 1e-2 for a, b in pairwise(rates))


def length(a: Array, b: Array) -> float:
    """What a segment counts in s."""
    distance, angle = oracles.off_by(a, b)
    return max(distance, 0.1 * angle)


def corner_width(path: Polyline, i: int) -> float:
    """How far in s the rounding of an inner waypoint reaches, by the breaks."""
    b, c = path.breaks, path.corners[i]
    return float(min(b[b > c][0] - c, c - b[b < c][-1]))


# ---------------------------------------------------------------- corners
@settings(phases=[Phase.explicit, Phase.generate])  # shrinking a brute force takes minutes
@given(waypoints, tolerances, tolerances)
def test_the_path_stays_within_its_tolerance_of_the_sharp_polyline_and_of_its_corners(
    given_poses: list[Array], blend: float, turn: float
) -> None:
    assume(min(length(a, b) for a, b in pairwise(given_poses)) > 0.05 and not returns(given_poses))
    path = Polyline(given_poses, blend=blend, blend_rotation=turn)
    lengths = [length(a, b) for a, b in pairwise(given_poses)]
    np.testing.assert_allclose(path.corners, np.cumsum(lengths)[:-1], rtol=1e-12)
    assert path.end == pytest.approx(sum(lengths), rel=1e-12)
    for i, c in enumerate(path.corners):
        before, corner, after = given_poses[i : i + 3]
        h = corner_width(path, i)
        s = np.linspace(c - h, c + h, 801)
        T = path(s)
        to_corner = np.linalg.norm(T[:, :3, 3] - corner[:3, 3], axis=1)
        assert to_corner.min() <= blend * (1.0 + 1e-9)
        # the places of the sharp corner, both parts as lines; each place of the path is near one of them, and vice versa
        one, two = Line(before, corner), Line(corner, after)
        if "rad" in (one.unit, two.unit):
            continue
        x = np.linspace(0.0, 1.0, 801)
        back, on = h / lengths[i] * one.end, h / lengths[i + 1] * two.end
        sharp = np.concatenate([one(np.clip(one.end - back * x, 0.0, None)), two(np.clip(on * x, None, two.end))])
        apart = np.linalg.norm(T[::8, None, :3, 3] - sharp[None, :, :3, 3], axis=2)
        turned = Rotation.from_matrix(
            (T[::8, None, :3, :3] @ np.swapaxes(sharp[None, ::4, :3, :3], 2, 3)).reshape(-1, 3, 3)
        ).magnitude().reshape(-1, sharp[::4].shape[0])  # fmt: skip
        grid = h / 800.0
        assert apart.min(axis=1).max() <= blend + grid
        assert apart.min(axis=0).max() <= blend + 8.0 * grid
        both = (apart[:, ::4] <= blend + 2.0 * grid) & (turned <= turn + 40.0 * grid)
        assert both.any(axis=1).all(), "somewhere neither position nor rotation is within the tolerance of one place"
        limited = h >= 0.499 * min(lengths[i], lengths[i + 1])
        moves = min(oracles.off_by(before, corner)[0] / lengths[i], oracles.off_by(corner, after)[0] / lengths[i + 1])
        alike = _turning_difference(before, corner, after, lengths[i], lengths[i + 1])
        if not limited and moves > 0.999 and alike * h * 10.0 / 64.0 < 0.999 * turn:
            assert to_corner.min() > 0.2 * blend
            assert to_corner.min() == pytest.approx(blend, rel=1e-4), "and uses all of it"


def _turning_difference(a: Array, b: Array, c: Array, one: float, two: float) -> float:
    return float(np.linalg.norm(oracles.error(b, c)[3:] / two - oracles.error(a, b)[3:] / one))


def test_the_middle_of_a_right_angle_is_at_the_tolerance() -> None:
    path = Polyline([pose_of([0, 0, 0]), pose_of([1, 0, 0]), pose_of([1, 1, 0])], blend=0.02)
    np.testing.assert_allclose(path(1.0)[:3, 3], [1.0 - 0.02 / np.sqrt(2.0), 0.02 / np.sqrt(2.0), 0.0], atol=1e-15)
    h = 0.02 * 64.0 / 10.0 / np.sqrt(2.0)
    np.testing.assert_allclose(path.breaks, [0.0, 1.0 - h, 1.0 + h, 2.0], rtol=0.0, atol=1e-14)


def test_outside_its_corners_it_is_made_of_lines() -> None:
    poses = [pose_of([0, 0, 0]), pose_of([0.3, 0, 0], [0.4, 0, 0]), pose_of([0.3, 0.2, 0], [0.4, 0.5, 0.1])]
    path, starts = Polyline(poses, blend=1e-3), [0.0, 0.3]
    for i, line in enumerate((Line(poses[0], poses[1]), Line(poses[1], poses[2]))):
        s = np.linspace(0.1, 0.6, 20) * line.end + 0.05
        np.testing.assert_allclose(path(s + starts[i]), line(s), rtol=0.0, atol=1e-15)
        np.testing.assert_allclose(path(s + starts[i], 1), line(s, 1), rtol=0.0, atol=1e-14)
        assert not path(s + starts[i], 2).any()


def test_two_waypoints_are_a_line() -> None:
    start, goal = pose_of([0, 0, 0]), pose_of([0.1, 0.2, 0.3], [1.0, 0.5, 0.2])
    path, line = Polyline([start, goal]), Line(start, goal)
    u = np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(path(u * path.end), line(u * line.end), rtol=0.0, atol=1e-15)
    np.testing.assert_array_equal(path.breaks, [0.0, path.end])
    assert path.corners.size == 0


def test_waypoints_on_a_straight_way_at_one_rate_do_not_round_it() -> None:
    line = Line(pose_of([0, 0, 0]), pose_of([0.3, 0.1, 0.2], [0.5, 0.2, 0.1]))
    path = Polyline(line(np.array([0.0, 0.3, 0.5, 1.0]) * line.end), blend=1e-6, blend_rotation=1e-6)
    s = np.linspace(0.0, line.end, 101)
    assert path.end == pytest.approx(line.end, rel=1e-14)
    np.testing.assert_allclose(path(s), line(s), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(path(s, 1), line(s, 1), rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(path(s, 2), 0.0, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("turns", [False, True])
def test_a_path_that_returns_the_way_it_came_is_refused(turns: bool) -> None:
    there, way = np.array([0.0, 0.0, 0.3]), np.array([0.5, 0.0, 0.0])
    out = [pose_of(0.2 * i * way, i * there * turns) for i in (0, 1, 1, 3)]
    for back in (out[0], out[1]):
        with pytest.raises(InvalidInput) as info:
            Polyline([*out, back])
        assert info.value.argument == "waypoints[3]"
    only_turning = [pose_of([0, 0, 0], i * there) for i in (0, 1, 0)]
    with pytest.raises(InvalidInput, match=r"waypoints\["):
        Polyline(only_turning)


@pytest.mark.parametrize("aside", [1e-3, 0.1])
def test_a_path_that_nearly_returns_never_stands_still(aside: float) -> None:
    path = Polyline([pose_of([0, 0, 0]), pose_of([0.5, 0, 0]), pose_of([0, 0.5 * aside, 0])], blend=1e-3)
    s = np.append(np.linspace(0.0, path.end, 100_001), path.corners)
    assert np.linalg.norm(path(s, 1)[:, :3], axis=1).min() == pytest.approx(0.5 * aside, rel=0.01)
    turned = Polyline(
        [pose_of([0, 0, 0]), pose_of([0.5, 0, 0], [0, 0, 0.1]), pose_of([0, 0, 0], [0, 0, 0.2])], blend=1e-3
    )
    assert np.linalg.norm(turned(0.5, 1)[3:]) == pytest.approx(0.2, rel=1e-9)


def test_the_speed_along_s_is_at_most_one_and_never_stands_still() -> None:
    rng = np.random.default_rng(5)
    path = Polyline([oracles.random_pose(rng) for _ in range(6)], blend=0.02)
    v = np.linalg.norm(path(np.linspace(0.0, path.end, 5001), 1)[:, :3], axis=1)
    assert v.max() <= 1.0 + 1e-14
    assert v.min() > 0.01


def test_short_segments_limit_their_corners_to_half_of_them() -> None:
    path = Polyline(
        [pose_of([0, 0, 0]), pose_of([0.5, 0, 0]), pose_of([0.5, 0.01, 0]), pose_of([0, 0.01, 0])], blend=0.1
    )
    np.testing.assert_allclose(path.breaks, [0.0, 0.495, 0.505, 0.515, 1.01], rtol=0.0, atol=1e-15)


def test_each_corner_can_have_a_tolerance_of_its_own() -> None:
    square = [pose_of(p) for p in ([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])]
    path = Polyline(square, blend=[0.02, 0.005])
    off = [np.linalg.norm(path(c)[:3, 3] - T[:3, 3]) for c, T in zip(path.corners, square[1:3], strict=True)]
    np.testing.assert_allclose(off, [0.02, 0.005], rtol=1e-12)


def test_the_tolerance_of_a_dropped_waypoint_goes_with_it() -> None:
    a, b, c, d = (pose_of(p) for p in ([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]))
    path = Polyline([a, a, b, b, b, c, d, d], blend=[9e-3, 0.02, 8e-3, 7e-3, 0.005, 6e-3])
    assert path.dropped == (1, 3, 4, 7)
    assert Polyline([a, b, c, d]).dropped == ()
    plain_one = Polyline([a, b, c, d], blend=[0.02, 0.005])
    s = np.linspace(0.0, path.end, 101)
    np.testing.assert_array_equal(path(s), plain_one(s))
    np.testing.assert_array_equal(path.waypoints, plain_one.waypoints)


@pytest.mark.parametrize(("blend", "near"), [(1e-3, 1e-4), (1e-5, 2.5e-6), (0.05, 1e-4), (1e-9, 1e-9)])
def test_a_chain_of_tiny_steps_is_not_dropped_as_a_whole(blend: float, near: float) -> None:
    steps = [pose_of([0.6 * near * i, 0, 0]) for i in range(5)]
    assert Polyline([*steps, pose_of([1, 0, 0])], blend=blend).dropped == (1, 3)
    turned = [pose_of([0, 0, 0], [6.0 * near * i, 0, 0]) for i in range(5)]
    kept = Polyline([*turned, pose_of([1, 0, 0])], blend=1.0, blend_rotation=10.0 * blend)
    assert kept.dropped == (() if near == 1e-9 else (1, 3))


def test_a_waypoint_that_nearly_repeats_its_neighbour_changes_little() -> None:
    rng = np.random.default_rng(3)
    sharp = [pose_of(p) for p in ([0, 0, 0], [0, 0.05, 0], [0.03, 0.05, 0.03], [0.03, 0, 0.05])]
    smooth = Polyline(sharp, blend=1e-3)
    for where, eps in [(i, e) for i in (0, 1, 2, 3) for e in (1e-8, 1e-6, 9e-5)]:
        again = oracles.moved(sharp[where], eps * Rotation.random(random_state=rng).as_matrix()[0], np.zeros(3))
        for at in (where, where + 1):
            poses = [*sharp[:at], again, *sharp[at:]]
            if at in (0, len(poses) - 1):
                continue
            path = Polyline(poses, blend=1e-3)
            assert len(path.dropped) == 1
            assert path.breaks.size == smooth.breaks.size
            for kept, T in ((path(0.0), poses[0]), (path(path.end), poses[-1])):
                np.testing.assert_allclose(kept, T, rtol=0.0, atol=1e-15)


@settings(phases=[Phase.explicit, Phase.generate])
@given(st.integers(0, 2**32 - 1), st.floats(-5.0, -1.5), st.floats(-9.0, -3.0))
def test_every_waypoint_is_passed_within_its_tolerance_merged_or_not(seed: int, blend: float, step: float) -> None:
    rng = np.random.default_rng(seed)
    big, small = 0.05 * rng.normal(size=(8, 3)), 10.0**step * rng.normal(size=(8, 3))
    poses = [pose_of(x) for x in np.cumsum(np.where(rng.random((8, 1)) < 0.5, big, small), axis=0)]
    try:
        path = Polyline(poses, blend=10.0**blend)
    except InvalidInput:  # all of them are one, or it returns the way it came
        assume(False)
    s = np.unique(np.concatenate([np.linspace(a, b, 60) for a, b in pairwise(path.breaks)]))
    at = path(s)[:, :3, 3]
    chords = np.diff(at, axis=0)
    for i, T in enumerate(poses):
        u = np.clip(np.einsum("ij,ij->i", T[:3, 3] - at[:-1], chords) / np.einsum("ij,ij->i", chords, chords), 0.0, 1.0)
        off = np.linalg.norm(at[:-1] + u[:, None] * chords - T[:3, 3], axis=1).min()
        same = SAME_POSE if step < -8.0 else 0.0  # what is nearer than that is one pose, the first of them
        assert off <= (10.0**blend if 0 < i < 7 else same) * (1.0 + 1e-3) + 1e-12


# ---------------------------------------------------------------- turns
def test_turns_only_count_in_radians() -> None:
    path = Polyline([pose_of([1, 2, 3], w) for w in ([0, 0, 0], [0.5, 0, 0], [0.5, 0.3, 0])])
    assert path.unit == "rad"
    first = oracles.off_by(path.waypoints[0], path.waypoints[1])[1]
    second = oracles.off_by(path.waypoints[1], path.waypoints[2])[1]
    assert path.end == pytest.approx(first + second, rel=1e-14)
    np.testing.assert_array_equal(path(np.linspace(0, path.end, 5))[:, :3, 3], np.tile([1.0, 2.0, 3.0], (5, 1)))


def test_a_hair_that_moves_among_turns_on_the_spot_does_not_break_them() -> None:
    places = [
        ([0, 0, 0], [0, 0, 0]),
        ([0, 0, 0], [0.5, 0, 0]),
        ([5e-7, 0, 0], [0.5, 0, 0]),
        ([5e-7, 0, 0], [0.5, 0.5, 0]),
    ]
    path = Polyline([pose_of(p, w) for p, w in places])
    assert path.unit == "rad"
    assert np.isfinite(path(np.linspace(0.0, path.end, 101), 3)).all()
    np.testing.assert_allclose(path(path.end), path.waypoints[-1], rtol=0.0, atol=1e-15)


def test_a_turn_on_the_spot_counts_a_tenth_of_a_metre_a_radian() -> None:
    path = Polyline(
        [
            pose_of([0, 0, 0]),
            pose_of([0.3, 0, 0]),
            pose_of([0.3, 0, 0], [0, 0, 0.5]),
            pose_of([0.3, 0.3, 0], [0, 0, 0.5]),
        ]
    )
    assert path.unit == "m"
    np.testing.assert_allclose(path.corners, [0.3, 0.35], rtol=1e-14)
    s = np.linspace(0.0, path.end, 301)
    np.testing.assert_allclose(path.nearest(path(s)), s, rtol=0.0, atol=1e-9)


def test_the_rotation_at_a_corner_keeps_its_tolerance() -> None:
    path = Polyline(
        [pose_of([0, 0, 0]), pose_of([1, 0, 0], [0.9, 0, 0]), pose_of([2, 0, 0])], blend=1.0, blend_rotation=0.01
    )
    assert oracles.off_by(path(1.0), path.waypoints[1])[1] == pytest.approx(0.01, rel=1e-9)
    s = np.linspace(0.0, path.end, 4001)
    assert Rotation.from_matrix(path(s)[:, :3, :3]).magnitude().max() == pytest.approx(0.89, rel=1e-6)


# ---------------------------------------------------------------- nearest
@settings(max_examples=15)
@given(waypoints, tolerances, st.builds(pose_of, vectors, vectors))
def test_no_place_of_a_polyline_is_nearer_than_the_nearest(poses: list[Array], blend: float, tool: Array) -> None:
    assume(min(length(a, b) for a, b in pairwise(poses)) > 0.01 and not returns(poses))
    path = Polyline(poses, blend=blend)
    found = path(path.nearest(tool[None]))[0]
    everywhere = path(np.linspace(0.0, path.end, 4001))
    off = np.linalg.norm(everywhere[:, :3, 3] - tool[:3, 3], axis=1)
    mine = np.linalg.norm(found[:3, 3] - tool[:3, 3])
    assert mine**2 <= (off**2).min() + (np.sqrt(2.0) * 2.0 * 1e-3) ** 2, "but for 1 mm a radian of rotation"
    R = everywhere[:, :3, :3] - tool[:3, :3]
    cost = off**2 + 0.5e-6 * (R * R).sum(axis=(1, 2))
    assert mine**2 + 0.5e-6 * ((found - tool)[:3, :3] ** 2).sum() <= cost.min() + 1e-12


def test_nearest_finds_the_right_one_of_two_passes() -> None:
    eight = [pose_of([x, y, z]) for x, y, z in ([0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 1e-3])]
    path = Polyline(eight, blend=0.01)
    assert path.nearest(pose_of([0.5, 0.5, 1e-5])[None])[0] == pytest.approx(np.sqrt(0.5), abs=1e-6)
    assert path.nearest(pose_of([0.5, 0.5, 5e-4])[None])[0] == pytest.approx(path.end - np.sqrt(0.5), abs=1e-5)


@pytest.mark.parametrize("x", [0.75, 0.755, 0.76, 0.765, 0.77, 0.775, 0.78])
def test_a_chord_of_the_search_is_not_taken_for_the_path(x: float) -> None:
    bend, tool = [pose_of([0, 0, 0]), pose_of([1, 0, 0]), pose_of([1, 1, 0])], np.array([x, 0.25, 0.0])
    places = Polyline(bend, blend=1.0)(np.linspace(0.5, 1.5, 100_001))[:, :3, 3]
    off = np.linalg.norm(places - tool, axis=1)
    least, away = off.min(), (tool - places[off.argmin()]) / off.min()
    pole, up = tool + away * (least - 1e-5), np.array([0.0, 0.0, 1.0])  # nearer than the bend, but not than its chords
    path = Polyline([*bend, pose_of(pole + up), pose_of(pole - up)], blend=[1.0, 1e-3, 1e-3])
    found = path(path.nearest(pose_of(tool)[None]))[0, :3, 3]
    assert np.linalg.norm(found - tool) == pytest.approx(least - 1e-5, abs=1e-9)


def test_nearest_takes_many_poses_on_a_long_path() -> None:
    rng = np.random.default_rng(1)
    path = Polyline([pose_of(p) for p in np.cumsum(rng.normal(size=(60, 3)), axis=0)], blend=0.01)
    s = rng.uniform(0.0, path.end, 4000)
    np.testing.assert_allclose(path(path.nearest(path(s)))[:, :3, 3], path(s)[:, :3, 3], rtol=0.0, atol=1e-12)


# ---------------------------------------------------------------- misuse
SQUARE = [pose_of(p) for p in ([0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0])]


@pytest.mark.parametrize("argument", ["blend", "blend_rotation"])
@pytest.mark.parametrize("wrong", [0.0, -1e-3, np.nan, np.inf, [1e-3], [1e-3, 0.0], [[1e-3, 1e-3]], "1 mm", None])
def test_a_tolerance_that_is_none_is_refused_by_name(argument: str, wrong: Any) -> None:
    with pytest.raises(InvalidInput, match=rf"^{argument}: "):
        Polyline(SQUARE, **{argument: wrong})


@pytest.mark.parametrize(
    "wrong", [None, "line", 3, [], SQUARE[:1], np.eye(4), [SQUARE[0], np.eye(3)], {"a": SQUARE[0]}]
)
def test_what_are_no_waypoints_is_refused(wrong: Any) -> None:
    with pytest.raises(InvalidInput) as info:
        Polyline(wrong)
    assert info.value.argument.startswith("waypoints")


def test_the_waypoint_that_is_wrong_is_named() -> None:
    bad = SQUARE[2].copy()
    bad[0, 0] = np.nan
    with pytest.raises(InvalidInput) as info:
        Polyline([*SQUARE[:2], bad])
    assert info.value.argument == "waypoints[2]"
    with pytest.raises(InvalidInput, match="180") as info:
        Polyline([SQUARE[0], SQUARE[0], SQUARE[1], pose_of([2, 0, 0], [np.pi, 0, 0])])
    assert info.value.argument == "waypoints[3]"


def test_waypoints_that_are_all_equal_are_refused() -> None:
    with pytest.raises(InvalidInput, match="3 equal poses") as info:
        Polyline([SQUARE[0]] * 3)
    assert info.value.argument == "waypoints"


def test_it_keeps_its_own_copy() -> None:
    poses = np.stack(SQUARE)
    path = Polyline(poses)
    before = path(0.5)
    poses[:] = 0.0
    np.testing.assert_array_equal(path(0.5), before)
