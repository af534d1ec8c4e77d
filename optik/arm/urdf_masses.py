"""Reader of masses, friction and torque limits in a URDF."""

from __future__ import annotations

from typing import Any

import numpy as np

from optik.arm.body import Body, check_body, join_bodies, transform_body
from optik.arm.inertia import Inertia
from optik.arm.urdf_tree import Joint, Tree, origin_pose, read_number
from optik.errors import InvalidInput, RobotModelError
from optik.types import Array

PRODUCTS = (("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz"))
"""Attributes of an <inertia>, arranged as in the tensor."""


def read_masses(tree: Tree, placed: list[tuple[Joint, Array]]) -> Inertia | None:
    """Read the masses and friction of a chain, merged over fixed joints; None without masses."""
    chain = {joint.child for joint, _T in placed}
    groups: list[list[Body]] = []
    for joint, T in placed:
        if joint.kind != "fixed":
            groups.append([])
        if groups:  # links before the first movable joint do not move
            carried = list(tree.list_carried(joint.child, chain))
            groups[-1] += [transform_body(body, T @ pose) for link, pose in carried for body in _bodies(tree, link)]
    if not any(body[0] for group in groups for body in group):
        return None
    mass, com, tensor = (np.array(part) for part in zip(*map(join_bodies, groups), strict=True))
    moving = [joint for joint, _T in placed if joint.kind != "fixed"]
    motor, viscous, coulomb = (_dynamics(tree.name, moving, name) for name in ("armature", "damping", "friction"))
    try:
        return Inertia(mass, com, tensor, motor, viscous, coulomb, f"URDF {tree.name!r}")
    except InvalidInput as error:  # of merged links
        raise RobotModelError(tree.name, str(error)) from None


INFINITE_TEXTS = ("inf", "+inf", "infinity", "+infinity")
"""Texts for infinity, in lower case."""


def read_torques(robot: str, joints: list[Joint]) -> Array | None:
    """Read the torque limits of joints; None if all are unknown."""
    efforts = np.array([_effort(robot, joint) for joint in joints])
    return efforts if np.isfinite(efforts).any() else None


def _effort(robot: str, joint: Joint) -> float:
    """Return the torque limit of a joint; infinite without an effort, or with an effort of 0 or inf."""
    element = joint.element.get("limit")
    if element is not None and element.get("effort", "").strip().lower() in INFINITE_TEXTS:
        return np.inf
    return _positive(robot, joint, "limit", "effort") or np.inf


def _dynamics(robot: str, joints: list[Joint], name: str) -> Array:
    return np.array([_positive(robot, joint, "dynamics", name) for joint in joints])


def _positive(robot: str, joint: Joint, tag: str, name: str) -> float:
    """Read a number ≥ 0 from an attribute of a joint's element; a missing one is 0."""
    element, where = joint.element.get(tag), f"joint {joint.name!r}"
    value = 0.0 if element is None else read_number(robot, where, element.get(name, "0"), name)
    if value < 0.0:
        raise RobotModelError(robot, f"{where}: {name} {value:.6g}, expected a number ≥ 0")
    return value


def _bodies(tree: Tree, link: str) -> list[Body]:
    """Read the rigid body of a link in its frame; an empty list without an <inertial>."""
    found = tree.parts(link, "inertial")
    if not found:
        return []
    where, inertial = f"link {link!r}", found[0]

    def value(tag: str, attribute: str) -> float:
        element: Any = inertial.find(tree.prefix + tag)
        if element is None:
            raise RobotModelError(tree.name, f"{where}: an <inertial> without <{tag}>")
        return read_number(tree.name, where, element.get(attribute, "0"), attribute if tag == "inertia" else tag)

    tensor = np.array([[value("inertia", name) for name in row] for row in PRODUCTS])
    body = (value("mass", "value"), np.zeros(3), tensor)
    T = origin_pose(tree.name, where, inertial.find(tree.prefix + "origin"))
    try:
        return [check_body(transform_body(body, T), where)]
    except InvalidInput as error:
        raise RobotModelError(tree.name, str(error)) from None
