"""Poses: logarithm, exponential, error, interpolation and the check, against SciPy's rotations."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation, Slerp

from optik import se3
from optik.errors import InvalidInput, OptikError
from tests import oracles

unit = arrays(float, 3, elements=st.floats(-1, 1)).filter(lambda v: np.linalg.norm(v) > 1e-3)
axes = unit.map(lambda v: v / np.linalg.norm(v))
positions = arrays(float, 3, elements=st.floats(-5, 5))
angles = st.one_of(
    st.floats(0, np.pi - 1e-6),
    st.floats(-16, 0).map(lambda x: 10.0**x),  # near 0, down to where rounding lives
    st.floats(-12, -3).map(lambda x: np.pi - 10.0**x),  # near π
)
rotvecs = st.builds(lambda a, angle: a * angle, axes, angles)
poses = st.builds(oracles.pose, rotvecs, positions)
AXES = np.random.default_rng(3).normal(size=(200, 3))
AXES /= np.linalg.norm(AXES, axis=1)[:, None]
AXES = np.vstack([np.eye(3), -np.eye(3), [[1, 1, 0], [0, 1, -1], [-1, 0, 1]] / np.sqrt(2.0), AXES])


def pose_of(rotvec=(0, 0, 0), position=(0, 0, 0)):
    return oracles.pose(rotvec, position)


# ---------------------------------------------------------------- exponential and logarithm
@given(rotvecs)
def test_exponential_is_scipys(w):
    assert np.abs(se3.exp_so3(w) - Rotation.from_rotvec(w).as_matrix()).max() < 8e-15


@given(rotvecs)
def test_logarithm_is_scipys(w):
    R = Rotation.from_rotvec(w).as_matrix()
    assert np.abs(se3.log_so3(R) - Rotation.from_matrix(R).as_rotvec()).max() < 1e-13


@pytest.mark.parametrize("angle", [1e-150, 1e-17, 1e-12, 1e-9, 1e-8, 0.99e-4, 1.01e-4, 1e-3])
def test_small_rotations_keep_every_digit(angle):
    w = AXES * angle
    assert np.abs(se3.log_so3(se3.exp_so3(w)) - w).max() <= 4e-16 * angle
    assert np.abs(se3.exp_so3(w) - Rotation.from_rotvec(w).as_matrix()).max() < 4e-16


def test_no_rotation_has_logarithm_zero():
    assert (se3.log_so3(np.eye(3)) == 0.0).all()
    assert (se3.exp_so3(np.zeros(3)) == np.eye(3)).all()


@pytest.mark.parametrize("below_pi", [1e-3, 1e-6, 1e-9, 1e-12])
def test_logarithm_keeps_its_sign_just_below_a_half_turn(below_pi):
    w = AXES * (np.pi - below_pi)
    assert np.abs(se3.log_so3(se3.exp_so3(w)) - w).max() < 1e-13


def test_half_turn_about_any_axis_gives_the_axis_or_its_opposite():
    R = 2.0 * AXES[:, :, None] * AXES[:, None, :] - np.eye(3)  # exactly π, without sines
    w = se3.log_so3(R)
    assert np.abs(np.linalg.norm(w, axis=1) - np.pi).max() < 1e-14
    off = np.minimum(np.abs(w - np.pi * AXES).max(axis=1), np.abs(w + np.pi * AXES).max(axis=1))
    assert off.max() < 1e-13


@given(rotvecs.filter(lambda w: np.linalg.norm(w) > 1e-3), st.floats(1.0, 1.99))
def test_angle_of_a_logarithm_is_at_most_pi(w, longer):
    turned = w / np.linalg.norm(w) * np.pi * longer
    v = se3.log_so3(se3.exp_so3(turned))
    assert np.linalg.norm(v) <= np.pi + 1e-15
    assert np.abs(se3.exp_so3(v) - Rotation.from_rotvec(turned).as_matrix()).max() < 1e-13


@pytest.mark.parametrize("shape", [(), (1,), (5,), (2, 3), (0,)])
def test_batches_have_the_shape_of_their_parts(shape):
    w = np.random.default_rng(1).uniform(-1.5, 1.5, (*shape, 3))
    R = se3.exp_so3(w)
    assert R.shape == (*shape, 3, 3)
    assert se3.log_so3(R).shape == (*shape, 3)
    for i in np.ndindex(shape):
        assert (R[i] == se3.exp_so3(w[i])).all()
        assert (se3.log_so3(R)[i] == se3.log_so3(R[i])).all()


def test_slices_and_transposes_are_read_as_what_they_are():
    R = np.random.default_rng(1).permutation(se3.exp_so3(AXES))
    assert (se3.log_so3(np.swapaxes(R, -1, -2)) == -se3.log_so3(R)).all()
    assert (se3.log_so3(R[::3]) == se3.log_so3(R)[::3]).all()


# ---------------------------------------------------------------- error, inverse, interpolation
@given(poses, poses)
def test_error_is_the_way_from_the_pose_to_the_target_in_the_base_frame(T, target):
    e = se3.error(T, target)
    assert (e[:3] == target[:3, 3] - T[:3, 3]).all()
    turned = Rotation.from_rotvec(e[3:]).as_matrix() @ T[:3, :3]
    assert np.abs(turned - target[:3, :3]).max() < 1e-13  # not T R: the error stands in the base frame
    assert np.linalg.norm(e[3:]) <= np.pi + 1e-15


@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
def test_errors_of_batches_are_those_of_their_parts(shape):
    rng = np.random.default_rng(5)
    T, target = np.empty((2, *shape, 4, 4))
    for i in np.ndindex(shape):
        T[i], target[i] = (pose_of(rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)) for _ in range(2))
    e = se3.error(T, target)
    assert e.shape == (*shape, 6)
    for i in np.ndindex(shape):
        assert np.abs(e[i] - oracles.error(T[i], target[i])).max() < 1e-14


@given(st.lists(poses, min_size=1, max_size=3))
def test_the_inverse_of_one_or_many_is_numpys(T):
    assert np.abs(se3.inverse(np.array(T)) - np.linalg.inv(T)).max() < 1e-13
    assert np.abs(se3.inverse(T[0]) @ T[0] - np.eye(4)).max() < 1e-14


@given(poses, poses)
def test_interpolation_begins_at_the_start_and_ends_at_the_goal(start, goal):
    assert (se3.interpolate(start, goal, 0.0) == start).all()
    assert np.abs(se3.interpolate(start, goal, 1.0) - goal).max() < 1e-13


@given(poses, poses, st.lists(st.floats(0, 1), min_size=1, max_size=5))
def test_interpolation_is_straight_in_position_and_scipys_slerp_in_rotation(start, goal, u):
    between = Rotation.from_matrix(np.array([start[:3, :3], goal[:3, :3]]))
    turn = (between[1] * between[0].inv()).magnitude()
    if turn > np.pi - 1e-6:
        return  # both ways round are right
    T = se3.interpolate(start, goal, u)
    assert T.shape == (len(u), 4, 4)
    assert np.abs(T[:, :3, :3] - Slerp([0, 1], between)(u).as_matrix()).max() < 1e-12
    line = start[:3, 3] + np.array(u)[:, None] * (goal[:3, 3] - start[:3, 3])
    assert np.abs(T[:, :3, 3] - line).max() < 1e-14
    assert (T[:, 3] == [0, 0, 0, 1]).all()


@given(poses, poses)
def test_interpolation_turns_at_a_constant_rate_past_its_ends_too(start, goal):
    T = se3.interpolate(start, goal, np.linspace(-0.5, 1.5, 9))
    steps = se3.error(T[:-1], T[1:])
    assert np.abs(steps - se3.error(start, goal) / 4.0).max() < 1e-13


def test_pose_is_made_of_its_rotation_and_position():
    R = se3.exp_so3([0.1, 0.2, 0.3])
    T = se3.pose(R, (1, 2, 3))
    assert (T[:3, :3] == R).all()
    assert (T[:3, 3] == (1, 2, 3)).all()
    assert (T[3] == (0, 0, 0, 1)).all()
    assert (se3.pose(p=(0, 0, 1))[:3, :3] == np.eye(3)).all()


@given(st.tuples(*[st.floats(-180, 180)] * 3))
def test_roll_pitch_yaw_turn_about_fixed_axes_as_in_urdf(rpy):
    T = se3.from_xyz_rpy((1, 2, 3), rpy)
    assert np.abs(T[:3, :3] - Rotation.from_euler("xyz", rpy, degrees=True).as_matrix()).max() < 1e-14
    assert (T[:3, 3] == (1, 2, 3)).all()


# ---------------------------------------------------------------- the check
NOT_A_NUMBER = pose_of()
NOT_A_NUMBER[1, 3] = np.nan
NAN_ROTATION = pose_of()
NAN_ROTATION[0, 1] = np.nan
INFINITE = pose_of()
INFINITE[0, 3] = -np.inf
LAST_ROW = pose_of()
LAST_ROW[3, 0] = 1e-3
LAST_CORNER = pose_of()
LAST_CORNER[3, 3] = 2.0
SHEARED = pose_of()
SHEARED[0, 1] = 1e-4

BAD_POSES = {
    "NaN in the position": (NOT_A_NUMBER, "finite"), "NaN in the rotation": (NAN_ROTATION, "finite"),
    "infinite position": (INFINITE, "finite"), "all NaN": (np.full((4, 4), np.nan), "finite"),
    "a rotation alone": (np.eye(3), "optik.se3.pose"), "three rows": (np.eye(4)[:3], "(4, 4)"),
    "three columns": (np.eye(4)[:, :3], "(4, 4)"), "a batch": (np.eye(4)[None], "(4, 4)"),
    "flat": (np.eye(4).ravel(), "(4, 4)"), "a number": (1.0, "(4, 4)"), "None": (None, "(4, 4)"),
    "ragged": ([[1, 2], [3]], "(4, 4)"), "a word": ("tool0", "(4, 4)"), "words": ([["a"] * 4] * 4, "(4, 4)"),
    "a dict": ({"p": 1}, "(4, 4)"), "sheared": (SHEARED, "rotation"),
    "scaled": (np.diag([2.0, 2.0, 2.0, 1.0]), "rotation"),
    "no rotation at all": (np.diag([0.0, 0.0, 0.0, 1.0]), "rotation"),
    "a reflection": (np.diag([1.0, 1.0, -1.0, 1.0]), "reflection"),
    "point reflection": (np.diag([-1.0, -1.0, -1.0, 1.0]), "reflection"), "last row": (LAST_ROW, "last row"),
    "last corner": (LAST_CORNER, "last row"), "transposed": (pose_of(position=(1, 2, 3)).T, "last row"),
}  # fmt: skip


@pytest.mark.parametrize(("T", "word"), BAD_POSES.values(), ids=BAD_POSES.keys())
def test_what_is_no_pose_is_refused_by_name(T, word):
    with pytest.raises(InvalidInput) as caught:
        se3.check_pose(T, "goal")
    assert caught.value.argument == "goal"
    assert str(caught.value).startswith("goal: ")
    assert word in str(caught.value)
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, OptikError)


@given(poses)
def test_every_pose_passes_the_check_unchanged(T):
    assert (se3.check_pose(T, "T") == T).all()
    assert (se3.check_pose(T.tolist(), "T") == T).all()
    assert (se3.check_pose(np.asfortranarray(T), "T") == T).all()


def test_a_position_is_within_a_thousand_kilometres():
    for x in (1e6, -1e6):
        se3.check_pose(oracles.trans(y=x), "T")
        with pytest.raises(InvalidInput, match=r"^T: .*1e6 m"):
            se3.check_pose(oracles.trans(y=1.001 * x), "T")


@pytest.mark.parametrize("rotvec", AXES[:20])
def test_noise_of_a_measured_pose_passes_and_a_thousandth_does_not(rotvec):
    rng = np.random.default_rng(2)
    T = pose_of(rotvec)
    noisy = T.copy()
    noisy[:3, :3] += rng.uniform(-1e-7, 1e-7, (3, 3))
    se3.check_pose(noisy, "T")
    noisy = T.copy()
    noisy[:3, :3] *= 1.001
    with pytest.raises(InvalidInput, match=r"RᵀR"):
        se3.check_pose(noisy, "T")


@given(st.integers(0, 2), st.integers(0, 2), st.floats(-9, -3), poses)
def test_the_check_draws_its_line_where_it_says(i, j, exponent, T):
    noisy = T.copy()
    noisy[i, j] += 10.0**exponent
    off = np.abs(noisy[:3, :3].T @ noisy[:3, :3] - np.eye(3)).max()
    if off < 0.999e-6:
        se3.check_pose(noisy, "T")
    elif off > 1.001e-6:
        with pytest.raises(InvalidInput, match=r"RᵀR"):
            se3.check_pose(noisy, "T")


def test_a_complex_pose_is_refused():
    with pytest.raises(InvalidInput):
        se3.check_pose(np.eye(4) * (1 + 1j), "T")


def test_numbers_too_large_to_square_are_refused_without_a_warning():
    with pytest.raises(InvalidInput):
        se3.check_pose(np.diag([1e300, 1.0, 1.0, 1.0]), "T")


def test_the_pose_error_writes_nothing_beyond_its_arrays() -> None:
    """Compiled code does not look; the same lines as plain Python do."""
    T = se3.pose(se3.exp_so3(np.array([0.3, -0.2, 0.5])), np.array([0.1, 0.2, 0.3]))
    target = se3.pose(se3.exp_so3(np.array([-0.4, 0.1, 0.2])), np.array([0.3, -0.1, 0.2]))
    plain, fast = np.empty(6), np.empty(6)
    se3.pose_error.py_func(T, target, plain)
    se3.pose_error(T, target, fast)
    np.testing.assert_allclose(plain, fast, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(("R", "p"), [("x", [0, 0, 0]), (np.eye(4), [0, 0, 0]), (None, [1, 2]), (None, ["a"] * 3)])
def test_a_pose_of_other_shapes_is_refused(R: Any, p: Any) -> None:
    with pytest.raises(InvalidInput, match=r"^(R|p): expected finite numbers of shape"):
        se3.pose(R, p)
