"""Writer of URDF: an arm as text, from link ``base`` to link ``tool``."""

from __future__ import annotations

import math
import os
import re
from math import cos, sin
from xml.sax.saxutils import quoteattr

import numpy as np

from optik.arm.inertia import Body
from optik.arm.model import ArmModel
from optik.arm.motors import refuse_motors
from optik.arm.urdf import BY_POSITION, LIMIT_ATTRIBUTES, PRODUCTS
from optik.errors import RobotModelError
from optik.file_io import write_atomically
from optik.types import Array


def write_urdf(arm: ArmModel, path: str | os.PathLike[str] | None = None) -> str:
    """Return an arm as URDF text, and write it to a file if a path is given; see `Robot.to_urdf`."""
    check_xml_names(arm)
    refuse_motors(arm, "URDF")
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(arm.name)}>", '  <link name="base"/>']
    before = "base"
    links, joints, axes = _link_bodies(arm), {name: i for i, name in enumerate(arm.joint_names)}, arm.axes
    for name in set(joints).difference(axes.joint_names):  # a joint beside the chain that axes follow
        kind, limit = _type_and_limit(arm, joints[name])
        lines += [f"  <link name={quoteattr(name + '_link')}/>", f'  <joint name={quoteattr(name)} type="{kind}">']
        lines += [*_origin_lines("base", name + "_link", np.eye(4)), '    <axis xyz="0 0 1"/>', *limit, "  </joint>"]
    for i, name in enumerate(axes.joint_names):
        kind, limit = _type_and_limit(arm, joints[name]) if name in joints else _type_and_limit(axes, i)
        lines += [*_link_lines(f"link{i + 1}", links[i]), f'  <joint name={quoteattr(name)} type="{kind}">']
        lines += [*_origin_lines(before, f"link{i + 1}", arm.fixed[i]), *_mimic_lines(arm, i)]
        lines += ['    <axis xyz="0 0 1"/>', *limit, *_dynamics_lines(arm, i), "  </joint>"]
        before = f"link{i + 1}"
    flange = "flange"
    while flange in arm.joint_names:
        flange += "_"
    lines += [*_link_lines("tool", links[-1]), f'  <joint name="{flange}" type="fixed">']
    lines += [*_origin_lines(before, "tool", arm.tool), "  </joint>", "</robot>", ""]
    text = "\n".join(lines)
    if path is not None:
        write_atomically(path, lambda part: part.write_text(text, encoding="utf-8"))
    return text


def check_xml_names(arm: ArmModel) -> None:
    """Raise RobotModelError if XML cannot contain the name of an arm or of a joint."""
    for name in (arm.name, *arm.joint_names, *arm.axes.joint_names):
        if not name or re.search("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", name):
            raise RobotModelError(arm.name, f"{name!r} cannot be a name in XML")


def _link_bodies(arm: ArmModel) -> list[Body | None]:
    """Return the bodies of the links in their frames and, last, of the payload in the tool's; None for a mass of 0."""
    if arm.payload is not None and len(arm.payload.masses) > 1:
        raise RobotModelError(arm.name, f"a payload of {arm.payload}; URDF holds one mass: see with_payload")
    bodies = () if arm.inertia is None else arm.inertia.bodies
    links = [body if body[0] > 0.0 else None for body in bodies] or [None] * len(arm.fixed)
    return [*links, None if arm.payload is None else arm.payload.bodies[0]]


def _link_lines(name: str, body: Body | None) -> list[str]:
    if body is None:
        return [f'  <link name="{name}"/>']
    mass, com, tensor = body
    xyz = " ".join(repr(float(x)) for x in com)
    products = {PRODUCTS[i][j]: float(tensor[i, j]) for i in range(3) for j in range(i, 3)}
    inertia = " ".join(f'{attribute}="{x!r}"' for attribute, x in products.items())
    inside = [
        f'      <origin xyz="{xyz}" rpy="0 0 0"/>',
        f'      <mass value="{mass!r}"/>',
        f"      <inertia {inertia}/>",
    ]
    return [f'  <link name="{name}">', "    <inertial>", *inside, "    </inertial>", "  </link>"]


def _mimic_lines(arm: ArmModel, i: int) -> list[str]:
    """Return the <mimic> of an axis that follows a joint of another name."""
    if (follow := arm.linkage) is None or (name := arm.joint_names[follow.joint[i]]) == follow.names[i]:
        return []
    numbers = f'multiplier="{float(follow.factor[i])!r}" offset="{float(follow.offset[i])!r}"'
    return [f"    <mimic joint={quoteattr(name)} {numbers}/>"]


def _dynamics_lines(arm: ArmModel, i: int) -> list[str]:
    """Return the <dynamics> of a joint, if it has any; the motor's inertia (armature) is an extension of URDF."""
    if arm.inertia is None:
        return []
    found = {"damping": arm.inertia.viscous, "friction": arm.inertia.coulomb, "armature": arm.inertia.motor}
    known = [f'{name}="{float(values[i])!r}"' for name, values in found.items() if values[i] > 0.0]
    return [f"    <dynamics {' '.join(known)}/>"] if known else []


def _origin_lines(parent: str, child: str, T: Array) -> list[str]:
    xyz = " ".join(repr(float(x)) for x in T[:3, 3])
    rpy = " ".join(repr(x) for x in roll_pitch_yaw(T[:3, :3]))
    return [f'    <parent link="{parent}"/>', f'    <child link="{child}"/>', f'    <origin xyz="{xyz}" rpy="{rpy}"/>']


def _type_and_limit(arm: ArmModel, i: int) -> tuple[str, list[str]]:
    """Return the type and <limit> of a joint; a velocity or effort of 0 means unknown."""
    lower, upper = float(arm.limits.lower[i]), float(arm.limits.upper[i])
    speed = np.inf if arm.limits.velocity is None else float(arm.limits.velocity[i])
    torque = np.inf if arm.limits.torque is None else float(arm.limits.torque[i])
    effort, velocity = (repr(limit) if np.isfinite(limit) else "0" for limit in (torque, speed))
    known = f'effort="{effort}" velocity="{velocity}"'
    for name in LIMIT_ATTRIBUTES:
        values = getattr(arm.limits, name)
        known += f' {name}="{float(values[i])!r}"' if values is not None and np.isfinite(values[i]) else ""
    if lower == upper:
        problem = f"lower = upper = {lower:.6g}; a URDF holds no joint that cannot move"
        raise RobotModelError(arm.name, f"joint {arm.joint_names[i]!r}: {problem}")
    if np.isfinite([lower, upper]).all():
        kind = "prismatic" if arm.prismatic[i] else "revolute"
        return kind, [f'    <limit lower="{lower!r}" upper="{upper!r}" {known}/>', *_by_position_lines(arm, i)]
    if arm.prismatic[i] or np.isfinite([lower, upper]).any():
        problem = f"limits {lower:.6g} to {upper:.6g}; URDF has finite ones, or none for a revolute joint"
        raise RobotModelError(arm.name, f"joint {arm.joint_names[i]!r}: {problem}")
    return "continuous", [f"    <limit {known}/>"] if np.isfinite([speed, torque]).any() else []


def _by_position_lines(arm: ArmModel, i: int) -> list[str]:
    """Return the <position_based_velocity_limits> of a joint, if it has any."""
    by_position = arm.limits.velocity_by_position
    if by_position is None or not np.isfinite(by_position.deceleration[i]):
        return []
    o, d = float(by_position.offset[i]), float(by_position.deceleration[i])
    return [f'    <{BY_POSITION} velocity_offset="{o!r}" deceleration_limit="{d!r}"/>']


def roll_pitch_yaw(R: Array) -> tuple[float, float, float]:
    """Return the angles with R = Rz(yaw) Ry(pitch) Rx(roll), exact to rounding for every rotation.

    Near pitch = ±90° rounding errors determine the yaw; every yaw is correct there, because roll is computed from
    Rz(−yaw) R.
    """
    yaw = math.atan2(R[1, 0], R[0, 0])
    c, s = cos(yaw), sin(yaw)
    pitch = math.atan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = math.atan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return roll, pitch, yaw
