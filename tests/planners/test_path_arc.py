from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from optik.errors import InvalidInput
from optik.types import Array
from planners import Arc
from tests.planners.cases import parts, pose_of, vectors

angles = st.floats(0.05, 12.0).flatmap(lambda a: st.sampled_from([a, -a]))


poses = st.builds(pose_of, vectors, vectors)


def circumscribed(a: Array, b: Array, c: Array) -> tuple[Array, float]:
    """Centre and radius of the circle through three points, by the equations of its centre."""
    normal = np.cross(b - a, c - a)
    A = np.stack([b - a, c - a, normal])
    centre = np.linalg.solve(A, [(b - a) @ (b + a) / 2, (c - a) @ (c + a) / 2, normal @ a])
    return centre, float(np.linalg.norm(a - centre))


# ---------------------------------------------------------------- three points
@given(poses, vectors, poses, parts)
def test_through_three_points_it_is_their_circle_and_s_its_length(
    start: Array, via: Array, goal: Array, u: float
) -> None:
    a, c = start[:3, 3], goal[:3, 3]
    sine = np.linalg.norm(np.cross(via - a, c - via)) / max(np.linalg.norm(via - a) * np.linalg.norm(c - via), 1e-12)
    assume(sine > 0.05 and min(np.linalg.norm(x) for x in (via - a, c - via, c - a)) > 0.05)
    arc = Arc.through(start, via, goal)
    centre, radius = circumscribed(a, via, c)
    s = np.linspace(0.0, arc.end, 201)
    p = arc(s)[:, :3, 3]
    np.testing.assert_allclose(np.linalg.norm(p - centre, axis=1), radius, rtol=1e-9)
    np.testing.assert_allclose(p @ np.cross(via - a, c - a), a @ np.cross(via - a, c - a), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(p[-1], c, rtol=0.0, atol=1e-12)
    assert np.linalg.norm(p[1:] - p[:-1], axis=1).sum() == pytest.approx(arc.end, rel=2e-4)
    assert np.linalg.norm(arc(arc.nearest(pose_of(via, np.zeros(3))[None]))[0, :3, 3] - via) <= 1e-12
    turn = Slerp([0, 1], Rotation.from_matrix([start[:3, :3], goal[:3, :3]]))(u).as_matrix()
    np.testing.assert_allclose(arc(u * arc.end)[:3, :3], turn, rtol=0.0, atol=1e-12)


def test_an_example_by_hand() -> None:
    arc = Arc.through(pose_of([1, 0, 0], [0, 0, 0]), [0, 1, 0], pose_of([-1, 0, 0], [0, 0, 1.0]))
    assert (arc.unit, arc.end) == ("m", pytest.approx(np.pi))
    np.testing.assert_allclose(arc(np.pi / 2)[:3, 3], [0, 1, 0], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(arc(0.0, 1), [0, 1, 0, 0, 0, 1 / np.pi], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(arc(np.pi / 2, 1), [-1, 0, 0, 0, 0, 1 / np.pi], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(arc(0.0, 2), [-1, 0, 0, 0, 0, 0], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(arc(0.0, 3), [0, -1, 0, 0, 0, 0], rtol=0.0, atol=1e-15)


def test_of_a_pose_between_only_the_position_counts() -> None:
    start, goal, via = pose_of([1, 0, 0], [0, 0, 0]), pose_of([-1, 0, 0], [0, 0, 1]), pose_of([0, 1, 0], [1, 1, 1])
    np.testing.assert_array_equal(Arc.through(start, via, goal)(1.0), Arc.through(start, via[:3, 3], goal)(1.0))


def test_the_way_round_is_that_of_the_point_between() -> None:
    start, goal = pose_of([1, 0, 0], [0, 0, 0]), pose_of([0, 1, 0], [0, 0, 1])
    short, long = (Arc.through(start, [sign * np.sqrt(0.5)] * 2 + [0.0], goal) for sign in (1.0, -1.0))
    assert short.end == pytest.approx(np.pi / 2)
    assert long.end == pytest.approx(3 * np.pi / 2)


@pytest.mark.parametrize("height", [1e-3, 1e-5, 1e-6])
def test_an_arc_that_is_nearly_straight_loses_no_digits(height: float) -> None:
    radius = (0.25 + height**2) / (2.0 * height)
    arc = Arc.through(pose_of([0, 0, 0], [0, 0, 0]), [0.5, height, 0.0], pose_of([1, 0, 0], [0, 0, 0.1]))
    assert arc.circle.radius == pytest.approx(radius, rel=1e-9)
    u = np.linspace(0.0, 1.0, 11)
    p = arc(u * arc.end)[:, :3, 3]
    # to first order in the height it is a parabola; the next term is height³
    np.testing.assert_allclose(p[:, 1], 4.0 * height * u * (1.0 - u), rtol=0.0, atol=1e-15 + 20.0 * height**3)
    np.testing.assert_allclose(arc(arc.end)[:3, 3], [1.0, 0.0, 0.0], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(arc.nearest(arc(u * arc.end)), u * arc.end, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("via", [[0.5, 0, 0], [2.0, 0, 0], [-1.0, 0, 0], [0.5, 1e-7, 0], [2.0, 0, 1e-7]])
def test_points_on_a_straight_line_are_refused(via: Any) -> None:
    with pytest.raises(InvalidInput, match="straight line") as info:
        Arc.through(pose_of([0, 0, 0], [0, 0, 0]), via, pose_of([1, 0, 0], [0, 0, 0]))
    assert info.value.argument == "via"
    assert "Line" in info.value.expected


@pytest.mark.parametrize(
    ("via", "goal", "argument"),
    [([0, 0, 0], [1, 0, 0], "via"), ([1, 1e-8, 0], [1, 0, 0], "via"), ([1, 0, 0], [0, 1e-10, 0], "goal")],
)
def test_points_at_one_place_are_refused(via: Any, goal: Any, argument: str) -> None:
    with pytest.raises(InvalidInput, match="three") as info:
        Arc.through(pose_of([0, 0, 0], [0, 0, 0]), via, pose_of(goal, [0, 0, 0]))
    assert info.value.argument == argument
    assert ("Arc.about" in str(info.value)) == (argument == "goal")


# ---------------------------------------------------------------- about an axis
@given(poses, vectors, vectors, angles, parts, st.booleans())
def test_about_an_axis_it_is_the_turn_about_that_axis(
    start: Array, centre: Array, axis: Array, angle: float, u: float, held: bool
) -> None:
    assume(np.linalg.norm(axis) > 0.1)
    n = axis / np.linalg.norm(axis)
    r = np.linalg.norm(np.cross(n, start[:3, 3] - centre))
    assume(r > 1e-2)
    arc = Arc.about(start, centre, axis, angle, orientation="arc" if held else "fixed")
    assert arc.end == pytest.approx(r * abs(angle), rel=1e-12)
    turn = Rotation.from_rotvec(u * angle * n).as_matrix()
    T = arc(u * arc.end)
    np.testing.assert_allclose(T[:3, 3], centre + turn @ (start[:3, 3] - centre), rtol=0.0, atol=1e-13)
    R = turn @ start[:3, :3] if held else start[:3, :3]
    np.testing.assert_allclose(T[:3, :3], R, rtol=0.0, atol=1e-13)


@given(poses, poses, angles, parts)
def test_about_an_axis_to_an_orientation_it_turns_the_shortest_way(
    start: Array, goal: Array, angle: float, u: float
) -> None:
    assume(np.linalg.norm(start[:2, 3]) > 1e-2)
    arc = Arc.about(start, np.zeros(3), [0, 0, 1], angle, orientation=goal[:3, :3])
    turn = Slerp([0, 1], Rotation.from_matrix([start[:3, :3], goal[:3, :3]]))(u).as_matrix()
    np.testing.assert_allclose(arc(u * arc.end)[:3, :3], turn, rtol=0.0, atol=1e-12)


def test_nearest_on_several_turns_looks_at_the_rotation() -> None:
    start = pose_of([1, 0, 0], [0, 0, 0])
    arc = Arc.about(start, np.zeros(3), [0, 0, 1], 5.5 * np.pi, orientation=pose_of([0, 0, 0], [0, 2.0, 0])[:3, :3])
    s = np.linspace(0.0, arc.end, 57)
    np.testing.assert_allclose(arc.nearest(arc(s)), s, rtol=0.0, atol=1e-9)


def test_nearest_on_several_turns_that_are_alike_is_on_the_first() -> None:
    arc = Arc.about(pose_of([1, 0, 0], [0, 0, 0]), np.zeros(3), [0, 0, 1], 6.0 * np.pi)
    s = np.linspace(0.1, arc.end - 0.1, 57)
    np.testing.assert_allclose(arc.nearest(arc(s)), s % (2.0 * np.pi), rtol=0.0, atol=1e-9)
    assert arc.nearest(arc(np.array([0.0])))[0] == 0.0


# ---------------------------------------------------------------- misuse
GOOD: dict[str, Any] = {"start": pose_of([1, 0, 0], [0, 0, 0]), "centre": [0, 0, 0], "axis": [0, 0, 1], "angle": 1.0}


@pytest.mark.parametrize(
    ("argument", "wrong"),
    [
        ("start", np.eye(3)), ("start", pose_of([0, 0, 0.3], [0, 0, 0])), ("start", None),
        ("centre", [0, 0]), ("centre", [0, 0, np.nan]), ("centre", "origin"), ("centre", [np.inf, 0, 0]),
        ("axis", [0, 0, 0]), ("axis", 3), ("axis", [np.nan, 0, 1]),
        ("angle", 0.0), ("angle", np.nan), ("angle", 90), ("angle", -360.0), ("angle", "half"), ("angle", None),
        ("orientation", "free"), ("orientation", np.eye(4)), ("orientation", 2.0 * np.eye(3)),
        ("orientation", np.diag([1.0, -1.0, -1.0])), ("orientation", None),
    ],
)  # fmt: skip
def test_what_describes_no_arc_is_refused_by_name(argument: str, wrong: Any) -> None:
    with pytest.raises(InvalidInput, match=rf"^{argument}: "):
        Arc.about(**(GOOD | {argument: wrong}))


@pytest.mark.parametrize(
    ("argument", "wrong"),
    [("start", None), ("goal", np.eye(3)), ("via", [1, 2]), ("via", [0, np.nan, 1]), ("via", np.ones((4, 4)))],
)
def test_what_is_no_pose_or_point_is_refused_by_name(argument: str, wrong: Any) -> None:
    good = {"start": pose_of([1, 0, 0], [0, 0, 0]), "via": [0, 1, 0], "goal": pose_of([-1, 0, 0], [0, 0, 0])}
    with pytest.raises(InvalidInput, match=rf"^{argument}: "):
        Arc.through(**(good | {argument: wrong}))


def test_a_tiny_or_a_long_axis_is_a_direction() -> None:
    for size in (1e-200, 1e5):
        arc = Arc.about(**(GOOD | {"axis": [0, 0, size]}))
        np.testing.assert_allclose(arc(arc.end)[:3, 3], [np.cos(1.0), np.sin(1.0), 0], rtol=0.0, atol=1e-15)
