"""Robots as plain data: through JSON and back to the last bit, and what is refused."""

import json
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import optik
from optik import JointLimits, Robot, se3
from optik.arm.plain import numbers_to_list, read_numbers, read_pose
from optik.errors import InvalidInput, OptikError

finite = st.floats(allow_nan=False, allow_infinity=False)


def same_bits(a: Any, b: Any) -> bool:
    return np.asarray(a).tobytes() == np.asarray(b).tobytes()


def through_json(robot: Robot) -> Robot:
    return Robot.from_dict(json.loads(json.dumps(robot.to_dict(), allow_nan=False)))


def assert_same(robot: Robot, back: Robot) -> None:
    assert back == robot
    assert back.fingerprint == robot.fingerprint
    assert (back.name, back.joint_names, back.source) == (robot.name, robot.joint_names, robot.source)
    for field in ("fixed", "prismatic", "tool", "gravity"):
        assert same_bits(getattr(back, field), getattr(robot, field))
    for field in ("lower", "upper", "velocity", "acceleration", "jerk"):
        a, b = getattr(robot.limits, field), getattr(back.limits, field)
        assert (a is None) == (b is None)
        assert a is None or same_bits(a, b)


@pytest.mark.parametrize("name", optik.robots())
def test_every_robot_comes_back_to_the_last_bit(name: str) -> None:
    assert_same(optik.load(name), through_json(optik.load(name)))


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_any_robot_comes_back_to_the_last_bit(seed: int, free: bool) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    noise = rng.normal(size=(n + 1, 3, 3)) * rng.choice([0.0, 1e-15, 1e-13, 1e-8])  # what a rounded table leaves
    T = np.array([se3.pose(se3.exp_so3(rng.normal(size=3)) + noise[i], rng.normal(size=3)) for i in range(n + 1)])
    lower = np.where(free, -np.inf, -rng.uniform(0.1, 3.0, n))
    limits = JointLimits(lower, -lower, velocity=rng.uniform(0.1, 9.0, n), jerk=np.where(free, np.inf, 3.0))
    robot = Robot("arm ü", T[:n], rng.random(n) < 0.3, T[n], limits, gravity=rng.normal(size=3), source='a "book"')
    assert_same(robot, through_json(robot))
    assert_same(robot, pickle.loads(pickle.dumps(robot)))
    assert_same(robot, robot.with_tool(robot.tool))


@given(st.lists(st.one_of(finite, st.sampled_from([np.inf, -np.inf])), min_size=1, max_size=9))
def test_numbers_come_back_to_the_last_bit(values: list[float]) -> None:
    back = read_numbers(json.loads(json.dumps(numbers_to_list(values), allow_nan=False)), (len(values),), "x")
    assert same_bits(back, np.array(values))


WRONG = {
    "no mapping": (lambda d: None, "robot"),
    "a key too few": (lambda d: {k: v for k, v in d.items() if k != "tool"}, "tool missing"),
    "a key too many": (lambda d: d | {"colour": "red"}, "colour unknown"),
    "a limit too few": (lambda d: d | {"limits": {"lower": [0.0]}}, "upper, velocity"),
    "no lower limits": (lambda d: d | {"limits": d["limits"] | {"lower": None}}, "robot.limits.lower"),
    "a short limit": (lambda d: d | {"limits": d["limits"] | {"jerk": [1.0]}}, "robot.limits.jerk"),
    "crossed limits": (lambda d: d | {"limits": d["limits"] | {"lower": [9.0] * 6}}, "lower ≤ upper"),
    "a name that is none": (lambda d: d | {"name": 3}, "robot.name"),
    "a joint name that is none": (lambda d: d | {"joint_names": [*d["joint_names"][:5], 6]}, "robot.joint_names"),
    "one joint name": (lambda d: d | {"joint_names": "joint1"}, "robot.joint_names"),
    "kinds of joint as figures": (lambda d: d | {"prismatic": [0] * 6}, "robot.prismatic"),
    "a ragged list": (lambda d: d | {"tool": [[1.0], [2.0, 3.0]]}, "robot.tool"),
    "a word among figures": (lambda d: d | {"gravity": [0.0, 0.0, "down"]}, "robot.gravity"),
    "true among figures": (lambda d: d | {"gravity": [0.0, 0.0, True]}, "robot.gravity"),
    "a figure beyond all": (lambda d: d | {"gravity": [0.0, 0.0, 10**400]}, "robot.gravity"),
    "infinity where none can be": (lambda d: d | {"gravity": [0.0, 0.0, "inf"]}, "gravity"),
    "no pose": (lambda d: d | {"tool": [[2.0] * 4] * 4}, "tool"),
    "no source": (lambda d: d | {"source": None}, "robot.source"),
}


@pytest.mark.parametrize(("damage", "named"), WRONG.values(), ids=WRONG.keys())
def test_what_describes_no_robot_is_refused_by_name(damage: Any, named: str) -> None:
    with pytest.raises(OptikError, match=named.replace(".", r"\.")) as caught:
        Robot.from_dict(damage(optik.load("paper6r").to_dict()))
    assert isinstance(caught.value, ValueError)


def test_numbers_of_another_shape_say_which_was_expected() -> None:
    with pytest.raises(InvalidInput, match=r"x: expected numbers of shape \(2, 3\).*got 2 of them"):
        read_numbers([[1.0, 2.0, 3.0], [1.0, 2.0]], (2, 3), "x")


@pytest.mark.parametrize("seed", range(10))
def test_a_pose_has_any_one_orientation(seed: int) -> None:
    turn = (
        Rotation.from_euler("ZYX", [-90.0, 0.0, 90.0], degrees=True)
        if seed == 0
        else Rotation.random(random_state=seed)
    )
    x, y, z, w = turn.as_quat()
    a, b, c = turn.as_euler("ZYX", degrees=True)
    given = {
        "quaternion_wxyz": [w, x, y, z], "quaternion_xyzw": [x, y, z, w], "rotation_vector_rad": turn.as_rotvec().tolist(),
        "rpy_deg": [c, b, a], "abc_deg": [a, b, c],
    }  # fmt: skip
    for kind, values in given.items():
        T = read_pose({"xyz_mm": [100.0, -20.0, 3.0], kind: values}, "pose")
        np.testing.assert_allclose(T[:3, :3], turn.as_matrix(), rtol=0, atol=1e-12)
        assert T[:3, 3].tolist() == [0.1, -0.02, 0.003]
    for wrong, words in (
        ({"quaternion": [w, x, y, z]}, r"quaternion unknown; did you mean quaternion_\w+ or quaternion_\w+\?"),
        ({"rpy_deg": [0.0] * 3, "abc_deg": [0.0] * 3}, "expected one orientation; got rpy_deg and abc_deg"),
        ({"quaternion_wxyz": [w, x, y]}, "4 finite numbers"), ({"quaternion_xyzw": [0.0] * 4}, "of length 0"),
        ({"rotation_vector_rad": [0.0, 180.0, 0.0]}, "at most a turn"),
    ):  # fmt: skip
        with pytest.raises(InvalidInput, match=words):
            read_pose(wrong, "pose")
