"""An arm and its objects as peers read them: as URDF, as a model of Pinocchio, as solids, and quaternions."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from optik.arm.limits import JointLimits
from optik.arm.robot import Robot
from optik.arm.shapes.enclosure import complete_frame
from optik.arm.urdf_writer import roll_pitch_yaw
from optik.errors import NoSolution
from optik.scene import Scene
from optik.se3 import log_so3, pose
from optik.types import Array

Solid: TypeAlias = tuple[str, list[float], Array]
"""Name of a shape in coal, its edges, or its radius and length [m], and the pose of its centre (4, 4)."""


def pinocchio_model(pin: Any, robot: Robot) -> Any:
    """Return Pinocchio's model of an arm with position limits, without other limits, with the frame ``tool``."""
    model, last, infinite = pin.Model(), 0, np.array([np.inf])
    for i in range(robot.n):
        joint = pin.JointModelPZ() if robot.prismatic[i] else pin.JointModelRZ()
        lower, upper = robot.limits.lower[i : i + 1].copy(), robot.limits.upper[i : i + 1].copy()
        placement = pin.SE3(np.array(robot.fixed[i]))
        last = model.addJoint(last, joint, placement, robot.joint_names[i], infinite, infinite, lower, upper)
    model.addFrame(pin.Frame("tool", last, 0, pin.SE3(np.array(robot.tool)), pin.FrameType.OP_FRAME))
    return model


def urdf(robot: Robot, limits: JointLimits | None = None) -> str:
    """Return the URDF of an arm with base ``link0`` and last link ``tool``, with all digits of its numbers."""
    limits = limits or robot.limits
    parts = ['<robot name="arm">', '<link name="link0"/>']
    for i in range(robot.n):
        kind = "prismatic" if robot.prismatic[i] else "revolute"
        lower, upper = float(limits.lower[i]), float(limits.upper[i])
        limit = f'<axis xyz="0 0 1"/><limit lower="{lower!r}" upper="{upper!r}" effort="1" velocity="1"/>'
        parts.append(_joint(f"joint{i + 1}", kind, f"link{i}", f"link{i + 1}", robot.fixed[i], limit))
    parts.append(_joint("flange", "fixed", f"link{robot.n}", "tool", robot.tool, ""))
    return "\n".join([*parts, "</robot>"])


def _joint(name: str, kind: str, parent: str, child: str, T: Array, more: str) -> str:
    xyz = " ".join(repr(float(x)) for x in T[:3, 3])
    rpy = " ".join(repr(x) for x in roll_pitch_yaw(T[:3, :3]))
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/>{more}</joint>'
    )


def list_solids(scene: Scene) -> list[Solid]:
    """Return the boxes, spheres, capsules and cylinders of a scene in the order of its names; other objects are refused."""
    solids = [("Box", list(map(float, edges)), np.array(T)) for T, edges in scene.boxes]
    solids += [("Sphere", [float(radius)], pose(p=centre)) for centre, radius in scene.spheres]
    solids += [make_solid("Capsule", *one) for one in scene.capsules]
    solids += [make_solid("Cylinder", *one) for one in scene.cylinders]
    if len(solids) != len(scene.names):
        raise NoSolution("it takes only boxes, spheres, capsules and cylinders")
    return solids


def make_solid(kind: str, a: Array, b: Array, radius: float) -> Solid:
    """Return a capsule or a cylinder along z of its pose; a capsule of length 0 is a sphere."""
    length = float(np.linalg.norm(b - a))
    if not length > 0.0:
        return "Sphere", [float(radius)], pose(p=a)
    u = (b - a) / length
    return kind, [float(radius), length], pose(np.column_stack([*complete_frame(u), u]), 0.5 * (a + b))


def quaternion_of(R: Array) -> Array:
    """Return the unit quaternion (4,) of a rotation, scalar first."""
    w = log_so3(R)
    half = 0.5 * float(np.linalg.norm(w))
    return np.concatenate([[np.cos(half)], 0.5 * np.sinc(half / np.pi) * w])
