from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from optik.errors import InvalidInput
from planners import Line
from planners.trajectory.curve import Curve
from tests import oracles
from tests.planners import cases
from tests.planners.cases import parts, pose_of, vectors

poses = st.builds(pose_of, vectors, vectors.map(lambda v: 3.0 * v))

CURVES = ["path", "joint path", "trajectory"]


def curve(kind: str) -> Curve:
    if kind == "path":
        return cases.default_line()
    if kind == "joint path":
        return cases.default_joint_path()
    return cases.random_trajectory(np.random.default_rng(1), n=6)


# ---------------------------------------------------------------- every curve
@pytest.mark.parametrize("kind", CURVES)
@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_a_scalar_gives_one_value_and_an_array_gives_them_stacked(kind: str, order: int) -> None:
    c = curve(kind)
    x = np.linspace(0.0, c.end, 7)
    stacked = c(x, order)
    value_shape = (4, 4) if kind == "path" and order == 0 else (6,)
    assert stacked.shape == (7, *value_shape)
    assert c(x[3], order).shape == value_shape
    for i in range(7):
        np.testing.assert_allclose(c(float(x[i]), order), stacked[i], rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(c(x, order=order), stacked)
    np.testing.assert_array_equal(c(x.tolist(), order), stacked)
    assert c(np.array([]), order).shape == (0, *value_shape)


@pytest.mark.parametrize("kind", CURVES)
def test_what_lies_outside_the_interval_is_refused_and_the_parameter_named(kind: str) -> None:
    c = curve(kind)
    name = "t" if kind == "trajectory" else "s"
    for wrong in (-1e-6, 1.000001 * c.end, np.nan, np.inf, -np.inf, [0.0, 2.0 * c.end], [0.0, np.nan], [[0.0]]):
        with pytest.raises(InvalidInput) as info:
            c(wrong)
        assert info.value.argument == name
        assert str(info.value).startswith(f"{name}: ")
    with pytest.raises(InvalidInput, match=r"123\.25"):
        c([0.0, 0.5 * c.end, 123.25, 0.25 * c.end])


@pytest.mark.parametrize("kind", CURVES)
@pytest.mark.parametrize("order", [-1, 4, 1.5, None, "1"])
def test_an_order_that_does_not_exist_is_refused(kind: str, order: Any) -> None:
    with pytest.raises(InvalidInput, match=r"^order: "):
        curve(kind)(0.0, order)


@pytest.mark.parametrize("kind", CURVES)
def test_rounding_beyond_the_ends_is_forgiven(kind: str) -> None:
    c = curve(kind)
    np.testing.assert_array_equal(c(c.end * (1.0 + 1e-12)), c(c.end))
    np.testing.assert_array_equal(c(-1e-12 * c.end), c(0.0))


@pytest.mark.parametrize("wrong", ["a", 1j, [[1.0], [1.0, 2.0]]])
def test_what_is_no_number_is_refused_by_name(wrong: Any) -> None:
    with pytest.raises(InvalidInput):
        cases.default_line()(wrong)


# ---------------------------------------------------------------- the line
@given(poses, poses, parts, parts)
def test_s_is_the_distance_travelled_in_metres(start: Any, goal: Any, u: float, w: float) -> None:
    chord = np.linalg.norm(goal[:3, 3] - start[:3, 3])
    assume(chord > 1e-6)
    line = Line(start, goal)
    assert line.unit == "m"
    assert line.end == pytest.approx(chord, rel=1e-12)
    a, b = line(u * line.end)[:3, 3], line(w * line.end)[:3, 3]
    assert np.linalg.norm(a - b) == pytest.approx(abs(u - w) * line.end, abs=1e-14)


@given(poses, vectors, parts, parts)
def test_s_is_the_angle_turned_in_radians_where_the_tool_only_turns(start: Any, axis: Any, u: float, w: float) -> None:
    angle = 2.9 * np.linalg.norm(axis) / np.sqrt(3.0)
    assume(angle > 1e-6)
    goal = oracles.moved(start, np.zeros(3), axis / np.linalg.norm(axis) * angle)
    line = Line(start, goal)
    assert line.unit == "rad"
    assert line.end == pytest.approx(angle, abs=1e-14)
    between = oracles.off_by(line(u * line.end), line(w * line.end))
    assert between[0] == 0.0
    assert between[1] == pytest.approx(abs(u - w) * line.end, abs=1e-13)


@given(poses, poses, parts)
def test_the_pose_is_on_the_chord_and_turned_the_shortest_way(start: Any, goal: Any, u: float) -> None:
    assume(np.linalg.norm(goal[:3, 3] - start[:3, 3]) > 1e-6)
    assume(oracles.off_by(start, goal)[1] < np.pi - 1e-6)
    line = Line(start, goal)
    np.testing.assert_allclose(line(u * line.end), oracles.line_pose(start, goal, u), rtol=0.0, atol=1e-13)


@given(poses, poses, parts, parts)
def test_the_twist_is_constant_and_of_unit_speed(start: Any, goal: Any, u: float, w: float) -> None:
    line = Line(start, goal)
    assume(line.end > 1e-6)
    np.testing.assert_array_equal(line(u * line.end, 1), line(w * line.end, 1))
    part = slice(3, 6) if line.turns_only else slice(0, 3)
    assert np.linalg.norm(line(0.0, 1)[part]) == pytest.approx(1.0, abs=1e-12)
    for order in (2, 3):
        assert not line(np.array([u, w]) * line.end, order).any()


def test_pose_and_twist_are_the_orders_of_the_curve() -> None:
    line = cases.default_line()
    s = np.linspace(0.0, line.end, 5)
    np.testing.assert_array_equal(line.pose(s), line(s))
    np.testing.assert_array_equal(line.twist(s), line(s, 1))
    np.testing.assert_array_equal(line.twist(s, 2), line(s, 2))


def test_the_default_line_keeps_its_orientation_and_moves_in_x_and_z_only() -> None:
    line = cases.default_line()
    poses_along = line(np.linspace(0.0, line.end, 151))
    assert line.end == pytest.approx(np.sqrt(0.12**2 + 0.20**2), abs=1e-15)
    np.testing.assert_allclose(poses_along[0, :3, 3], [0.1640, 0.3536, 0.1496], rtol=0.0, atol=5e-5)
    np.testing.assert_allclose(poses_along[:, :3, :3] - line.start[:3, :3], 0.0, rtol=0.0, atol=1e-15)
    assert np.ptp(poses_along[:, 1, 3]) == 0.0
    np.testing.assert_allclose(poses_along[-1, :3, 3] - poses_along[0, :3, 3], cases.MOVE, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(line(0.0, 1), [*(cases.MOVE / line.end), 0.0, 0.0, 0.0], rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("short", [1e-3, 1e-5, 2e-6])
def test_a_rotation_of_almost_180_degrees_keeps_its_axis_and_its_rate(short: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        start = oracles.random_pose(rng)
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        goal = oracles.moved(start, 0.1 * axis, (np.pi - short) * axis)
        line = Line(start, goal)
        for u in (0.0, 0.25, 0.5, 0.9, 1.0):
            wanted = Rotation.from_rotvec(u * (np.pi - short) * axis).as_matrix() @ start[:3, :3]
            np.testing.assert_allclose(line(u * line.end)[:3, :3], wanted, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("short", [0.0, 1e-12, -1e-9, 9e-7])
@pytest.mark.parametrize("move", [0.0, 0.1])
def test_a_half_turn_is_refused_with_what_would_work(short: float, move: float) -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        start = oracles.random_pose(rng)
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        with pytest.raises(InvalidInput, match=r"179\.999|180\.000") as info:
            Line(start, oracles.moved(start, move * axis, (np.pi - short) * axis))
        assert info.value.argument == "goal"
        for way_out in ("Polyline", "Arc.about", "0.001 rad"):
            assert way_out in info.value.expected


# ---------------------------------------------------------------- nearest
def test_the_nearest_place_to_the_goal_of_almost_a_half_turn_is_its_end() -> None:
    rng = np.random.default_rng(4)
    for _ in range(300):
        start = oracles.random_pose(rng)
        axis = rng.normal(size=3)
        line = Line(start, oracles.moved(start, np.zeros(3), (np.pi - 1e-5) * axis / np.linalg.norm(axis)))
        assert line.nearest(line(np.array([line.end])))[0] == pytest.approx(line.end, abs=1e-6)


# ---------------------------------------------------------------- edges and misuse
@given(poses)
def test_equal_poses_make_a_line_without_length(start: Any) -> None:
    line = Line(start, start)
    assert line.end == 0.0
    np.testing.assert_allclose(line(0.0), start, rtol=0.0, atol=1e-15)
    assert not line(0.0, 1).any()
    np.testing.assert_array_equal(line.nearest(np.stack([start, np.eye(4)])), [0.0, 0.0])
    with pytest.raises(InvalidInput, match="s: "):
        line(1e-3)


@pytest.mark.parametrize("small", [1e-3, 1e-6, 1e-9])
def test_a_line_has_length_where_its_poses_differ(small: float) -> None:
    start = oracles.random_pose(np.random.default_rng(7))
    assert Line(start, oracles.moved(start, [0.0, small, 0.0])).end == pytest.approx(small, rel=1e-6)
    assert Line(start, oracles.moved(start, np.zeros(3), np.array([0.0, 0.0, small]))).end == pytest.approx(
        small, rel=1e-6
    )


def bad_poses() -> dict[str, Any]:
    good = oracles.random_pose(np.random.default_rng(8))
    nan, infinite, row, loose = good.copy(), good.copy(), good.copy(), good.copy()
    nan[1, 3], infinite[0, 3] = np.nan, np.inf
    row[3, 0] = 0.1
    loose[:3, :3] *= 1.0 + 1e-5
    return {
        "a rotation": good[:3, :3], "nan": nan, "infinite": infinite, "last row": row, "not orthonormal": loose,
        "reflection": np.diag([1.0, 1.0, -1.0, 1.0]), "batch": np.stack([good, good]), "none": None, "words": "pose",
        "ragged": [[1.0], [1.0, 2.0]],
    }  # fmt: skip


@pytest.mark.parametrize("kind", sorted(bad_poses()))
def test_what_is_no_pose_is_refused_and_the_argument_named(kind: str) -> None:
    good = np.eye(4)
    for argument, pair in (("start", (bad_poses()[kind], good)), ("goal", (good, bad_poses()[kind]))):
        with pytest.raises(InvalidInput, match=rf"^{argument}: "):
            Line(*pair)


def test_a_measured_rotation_is_taken_to_the_nearest_exact_one() -> None:
    rng = np.random.default_rng(9)
    start, goal = oracles.random_pose(rng), oracles.random_pose(rng)
    start[:3, :3] += 1e-7 * rng.normal(size=(3, 3))
    line = Line(start, goal)
    R = line(np.linspace(0.0, line.end, 5))[:, :3, :3]
    np.testing.assert_allclose(np.swapaxes(R, 1, 2) @ R, np.tile(np.eye(3), (5, 1, 1)), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(line(0.0), start, rtol=0.0, atol=5e-7)
    np.testing.assert_allclose(line(line.end), goal, rtol=0.0, atol=1e-13)


def test_a_line_keeps_its_own_copy_of_its_poses() -> None:
    start, goal = np.eye(4), oracles.moved(np.eye(4), [0.1, 0.2, 0.3])
    line = Line(start, goal)
    before = line(0.5 * line.end)
    start[0, 3], goal[0, 3] = 9.0, 9.0
    np.testing.assert_array_equal(line(0.5 * line.end), before)
