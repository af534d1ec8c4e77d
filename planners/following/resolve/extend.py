"""The extended arm: a freedom whose screws are fixed in the tool is a joint behind the tool, so a path is one pose of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from optik import se3
from optik.arm.inertia import Inertia, join_bodies, transform_body
from optik.arm.limits import DYNAMIC_LIMITS
from optik.arm.robot import Robot
from optik.types import Array, Indices
from planners.freedom.base import Bounds, Freedom

NO_PITCH = 1e-9
"""Largest pitch of a screw that is a joint: a helical motion is none."""


def is_joint(kind: Freedom) -> bool:
    """Return whether each coordinate of a freedom is a turn about an axis or a shift."""
    screws = np.array(kind.screws).reshape(-1, 2, 3)
    return bool((np.abs(np.einsum("ki,ki->k", *np.swapaxes(screws, 0, 1))) <= NO_PITCH).all())


def extend(robot: Robot, freedoms: tuple[tuple[Freedom, Bounds], ...]) -> Robot:
    """Return the arm with a joint for each coordinate of freedoms; its tool is that of the given path.

    From tool = given · exp(f₁ξ₁) … exp(f_dξ_d) follows given = FK(q) · exp(−f_dξ_d) … exp(−f₁ξ₁), the last freedom first. The
    joints have the ranges of the freedoms, no limits on their rates, and links without mass and shape. An interval of payload
    masses leaves the masses unknown.
    """
    return add_joints(robot, [
        (f"{kind.name}{i + 1 if len(kind.screws) > 1 else ''}", screw, (-high if kind.round else low, high))
        for kind, (low, high) in reversed(freedoms) for i, screw in reversed(list(enumerate(np.array(kind.screws))))
    ])  # fmt: skip


def add_joints(robot: Robot, joints: Sequence[tuple[str, Array, Bounds]]) -> Robot:
    """Return the arm with joints behind the tool: the name, the screw (6,) that each undoes, and the range [rad, m]."""
    if not joints:
        return robot
    tool, fixed, prismatic = robot.tool, list[Array](), list[bool]()
    for _, screw, _ in joints:
        frame, slides = _joint_frame(screw)
        fixed.append(tool @ frame)
        tool = se3.inverse(frame)
        prismatic.append(slides)
    labels, (lower, upper) = [name for name, _, _ in joints], np.transpose([bounds for _, _, bounds in joints])
    limits, d = robot.limits, len(fixed)
    names = [label if label not in robot.joint_names else f"{label}_freedom" for label in labels]
    rates = {
        name: np.append(x, np.full(d, np.inf)) for name in DYNAMIC_LIMITS if (x := getattr(limits, name)) is not None
    }
    wide = limits.replace(lower=np.append(limits.lower, lower), upper=np.append(limits.upper, upper),
                          velocity_by_position=None, **rates)  # fmt: skip
    return replace(
        robot, motors=None, name="+".join([robot.name, *labels]), fixed=np.concatenate([robot.fixed, fixed]),
        prismatic=np.append(robot.prismatic, prismatic), tool=tool, limits=wide, payload=None,
        joint_names=(*robot.joint_names, *names), inertia=_carry(robot, d),
        linkage=robot.linkage and robot.linkage.append(prismatic, names),
    )  # fmt: skip


def columns_of(
    robot: Robot, freedoms: tuple[tuple[Freedom, Bounds], ...]
) -> tuple[Indices, tuple[tuple[int, float], ...]]:
    """Return the joints of the extended arm in the order of the coordinates, and the discs: first joint of two, and radius."""
    ends = np.cumsum([0, *(len(kind.screws) for kind, _ in freedoms)]).tolist()
    n = robot.n + ends[-1]
    discs = [(n - end, high) for (kind, (_, high)), end in zip(freedoms, ends[1:], strict=True) if kind.round]
    return n - 1 - np.arange(ends[-1]), tuple(discs)


def _joint_frame(screw: Array) -> tuple[Array, bool]:
    """Return the frame of a joint that undoes a screw: its axis z is opposite; and whether it slides."""
    v, w = screw[:3], screw[3:]
    slides = not w.any()
    z = -(v if slides else w)
    x = np.eye(3)[np.abs(z).argmin()]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    point = np.zeros(3) if slides else np.cross(w, v)
    return se3.pose(np.column_stack([x, np.cross(z, x), z]), point), slides


def _carry(robot: Robot, d: int) -> Inertia | None:
    """Return the masses of the links, the last one with the payload, and d links without mass."""
    inertia = robot.inertia
    if inertia is None or (robot.payload is not None and len(robot.payload.bodies) > 1):
        return None
    *links, last = inertia.bodies
    if robot.payload is not None:
        last = join_bodies([last, transform_body(robot.payload.bodies[0], robot.tool)])
    none = (0.0, np.zeros(3), np.zeros((3, 3)))
    mass, com, tensor = (np.array(part) for part in zip(*links, last, *[none] * d, strict=True))
    motor, viscous, coulomb = (np.append(x, np.zeros(d)) for x in (inertia.motor, inertia.viscous, inertia.coulomb))
    return Inertia(mass, com, tensor, motor, viscous, coulomb)
