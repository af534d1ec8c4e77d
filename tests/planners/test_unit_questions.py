"""Numbers that are probably in another unit are asked about."""

from pathlib import Path

import numpy as np
import pytest

import optik
from optik.errors import AssumptionWarning, InvalidInput
from planners import Line, MotionLimits, Polyline, certify, free, load_limits, plan, retarget
from planners.trajectory import make_rest


def test_limits_in_degrees_or_millimetres_are_asked_about(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    arm = optik.load("ur5e")
    MotionLimits.of(arm, velocity=3.0, tool_speed=2.0)
    assert not recwarn
    with pytest.warns(AssumptionWarning, match="180 rad/s is 57.3 times .* degrees"):
        MotionLimits.of(arm, velocity=180.0)
    with pytest.warns(AssumptionWarning, match="250 m/s: are these mm/s"):
        MotionLimits.of(arm, tool_speed=250.0)
    rows = [f"  {name}: {{has_velocity_limits: true, max_velocity: 180.0}}" for name in arm.joint_names]
    (tmp_path / "joint_limits.yaml").write_text("\n".join(["joint_limits:", *rows]))
    with pytest.warns(AssumptionWarning, match=r"57\.3 times .*are these degrees"):
        load_limits(tmp_path / "joint_limits.yaml", arm)
    with pytest.raises(InvalidInput, match="a Robot, such as"):
        MotionLimits.of("ur5e")  # type: ignore[arg-type]


def test_a_box_of_a_scene_in_metres_is_asked_about(tmp_path: Path) -> None:
    (tmp_path / "table.toml").write_text(
        "[[boxes]]\nname = 'table'\nxyz_mm = [0.6, 0.0, 0.1]\nedges_mm = [0.3, 0.6, 0.2]\n"
    )
    with pytest.warns(AssumptionWarning, match="table: edges below 2 mm: are these metres"):
        optik.Scene.load(tmp_path / "table.toml")


def test_a_blend_in_millimetres_and_a_turn_in_degrees_are_asked_about(recwarn: pytest.WarningsRecorder) -> None:
    poses = [optik.se3.pose(p=[0.1 * i, 0.1 * (i == 1), 0.3]) for i in range(3)]
    Polyline(poses, blend=0.5)
    free(Line(*poses[:2]), turn=6.5)
    assert not recwarn
    with pytest.warns(AssumptionWarning, match="blend: 2 m: are these millimetres"):
        Polyline(poses, blend=2.0)
    with pytest.warns(AssumptionWarning, match="turn: 180 rad is 28.6 full turns: are these degrees"):
        free(Line(*poses[:2]), turn=180.0)


def test_a_tolerance_in_degrees_and_a_period_as_rate_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"at most π; got 28.6 rad; are these degrees\?"):
        optik.ik.Tolerance(1e-3, 28.6)
    arm = optik.load("ur5e")
    motion = plan(arm, np.full(6, 0.1), np.zeros(6), limits=MotionLimits.of(arm, acceleration=10.0, jerk=100.0))
    with pytest.raises(InvalidInput, match=r"^rate: expected points per second; got 0.008; is this a period\?$"):
        motion.save(tmp_path / "x.yaml", rate=0.008)
    with pytest.raises(InvalidInput, match=r"^p: expected finite numbers"):
        optik.se3.pose(p=[np.nan, 0.0, 0.0])


def test_arguments_in_another_order_are_answered_with_their_order() -> None:
    robot, rest = optik.load("ur5e"), make_rest(np.zeros(6), 1.0)
    with pytest.raises(InvalidInput, match=r"or None: certify\(robot, None, trajectory, limits\); got Trajectory"):
        certify(robot, rest, MotionLimits.of(robot))  # type: ignore[arg-type]
    with pytest.raises(
        TypeError, match=r"^retarget\(\) got multiple values .*; the arguments begin with motion, at, onto, "
    ):
        retarget(rest, np.zeros(6), at=0.2)  # type: ignore[call-arg, misc]
