"""Joints beside the chain of an arm, such as those of a gripper: mimic relations, ranges and held values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from optik import se3
from optik.arm.linkage import Linkage
from optik.arm.urdf_tree import Joint, Tree, join_names, read_number
from optik.check import check_kind, check_number
from optik.errors import InvalidInput, RobotModelError
from optik.types import Array

Axis = Callable[[Joint], Array]
"""Unit axis (3,) of a joint in its own frame."""
MOVING = ("revolute", "continuous", "prismatic")
"""Types of joints with one value."""
VALUE_ROUNDING = 1e-9
"""Distance of a held value from the limits [rad, m] that counts as rounding."""


class Driver(NamedTuple):
    """The joint that another one follows (<mimic>), or itself: value = factor · value of the driver + offset."""

    joint: Joint
    factor: float
    offset: float


def find_driver(tree: Tree, joint: Joint) -> Driver:
    """Return the driver at the end of a joint's chain of <mimic> elements; the chain ends before a missing joint."""
    joints = {other.name: other for other in tree.above.values()}
    factor, offset, seen = 1.0, 0.0, {joint.name}
    while (mimic := joint.element.get("mimic")) is not None and joint.kind in MOVING:
        other = joints.get(mimic.get("joint", ""))
        if other is None or other.name in seen:
            break
        where = f"joint {joint.name!r}"
        offset += factor * read_number(tree.name, where, mimic.get("offset", "0"), "mimic offset")
        factor *= read_number(tree.name, where, mimic.get("multiplier", "1"), "mimic multiplier")
        joint = other
        seen.add(joint.name)
    return Driver(joint, factor, offset)


def find_linkage(tree: Tree, axes: list[Joint]) -> tuple[list[Joint], Linkage | None]:
    """Return the joints that drive the axes of a chain, in its order, and the relations between both if there are any."""
    drivers = [find_driver(tree, joint) for joint in axes]
    if not any("mimic" in joint.element for joint in axes):
        return axes, None
    for joint, (driver, times, _) in zip(axes, drivers, strict=True):
        where, other = f"joint {joint.name!r}", driver.element.get("mimic", {}).get("joint", "")
        if "mimic" in driver.element:
            problem = "follows itself (<mimic>)" if other in (x.name for x in tree.above.values()) else "does not exist"
            problem = f"{where}: follows joint {other!r}, which {problem}"
            raise RobotModelError(tree.name, problem)
        if driver.kind not in MOVING or times == 0.0:
            what = "whose multiplier is 0" if driver.kind in MOVING else f"whose type is {driver.kind!r}"
            raise RobotModelError(tree.name, f"{where}: follows joint {driver.name!r} (<mimic>), {what}")
    of = {joint.name: place for place, joint in reversed([*enumerate(axes)])}
    first = {d.joint.name: of.get(d.joint.name, place) for place, d in reversed([*enumerate(drivers)])}
    moving = sorted({d.joint.name: d.joint for d in drivers}.values(), key=lambda joint: first[joint.name])
    index = [moving.index(driver.joint) for driver in drivers]
    slides = np.array([joint.kind == "prismatic" for joint in axes])
    factor, offset = np.array([driver.factor for driver in drivers]), np.array([driver.offset for driver in drivers])
    return moving, Linkage(np.array(index), factor, offset, slides, tuple(joint.name for joint in axes))


def read_range(robot: str, joint: Joint) -> tuple[float, float]:
    """Read the limits of a joint beside the chain [rad, m], infinite if there are none; those of a fixed joint are 0."""
    if joint.kind == "fixed":
        return 0.0, 0.0
    where, limit = f"joint {joint.name!r}", joint.element.get("limit")
    if joint.kind not in MOVING:
        raise RobotModelError(robot, f"{where}: type {joint.kind!r}: the space of its links is unknown")
    if joint.kind == "continuous" or limit is None or not {"lower", "upper"} & set(limit.keys()):
        return -np.inf, np.inf
    lower, upper = (read_number(robot, where, limit.get(side, "0"), f"{side} limit") for side in ("lower", "upper"))
    if lower > upper:
        raise RobotModelError(robot, f"{where}: lower limit {lower:.6g} above upper {upper:.6g}")
    return lower, upper


def list_drivers(tree: Tree, link: str, chain: set[str]) -> list[Joint]:
    """List the joints beside the chain that move a link on the link that carries it; of a mimic, the joint that it follows."""
    found: dict[str, Joint] = {}
    while link in tree.above and link not in chain:
        joint = find_driver(tree, tree.above[link]).joint
        if joint.kind != "fixed" and joint.child not in chain:
            found[joint.name] = joint
        link = tree.above[link].parent
    return list(found.values())


def hold_joints(tree: Tree, chain: list[Joint], values: Mapping[str, float] | None, axis: Axis) -> Tree:
    """Return the tree with joints beside the chain held at values [rad, m], and with them all that follow them."""
    if values is None:
        return tree
    check_kind(values, "values", Mapping, '{joint: value}, such as {"gripper": 0.3}')
    joints, on_chain = {joint.name: joint for joint in tree.above.values()}, {joint.name for joint in chain}
    held = {name: _check_value(tree, joints, on_chain, (name, value)) for name, value in values.items()}
    above = dict(tree.above)
    for link, joint in tree.above.items():
        driver = find_driver(tree, joint)
        if driver.joint.name in held:
            value = driver.factor * held[driver.joint.name] + driver.offset
            u = axis(joint)
            shift = se3.pose(p=value * u) if joint.kind == "prismatic" else se3.pose(se3.exp_so3(value * u))
            above[link] = replace(joint, kind="fixed", shift=shift)
    return replace(tree, above=above)


def _check_value(tree: Tree, joints: Mapping[str, Joint], on_chain: set[str], entry: tuple[Any, Any]) -> float:
    """Check the name and the value of a joint to be held, and return the value."""
    name, value = entry
    free = [n for n, joint in joints.items() if joint.kind in MOVING and n not in on_chain]
    if name in on_chain:
        raise InvalidInput("values", f"{name!r}, a joint of the chain", f"joints beside the chain: {join_names(free)}")
    if name not in free:
        raise InvalidInput("values", repr(name)[:60], f"joints beside the chain: {join_names(free)}")
    driver = find_driver(tree, joints[name])
    if driver.joint.name != name:
        other = driver.joint.name
        advice = "" if other in on_chain else f"hold {other!r}"
        raise InvalidInput(
            "values", f"{name!r}, which follows {other!r} (<mimic>)", "joints that follow none", advice=advice
        )
    lower, upper = read_range(tree.name, joints[name])
    unit = "m" if joints[name].kind == "prismatic" else "rad"
    number = check_number(value, f"values[{name!r}]", f"a number [{unit}]")
    if not lower - VALUE_ROUNDING <= number <= upper + VALUE_ROUNDING:
        raise InvalidInput(
            "values", f"{name} = {number:.6g} {unit}", f"a value within its limits [{lower:.6g}, {upper:.6g}] {unit}"
        )
    return number
