"""Reader of URDF: the chain from a base link to a tip link, its limits and masses, and the tip where none is named."""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.branches import MOVING, find_linkage, hold_joints, read_range
from optik.arm.inertia import Body, Inertia, check_body, join_bodies, transform_body
from optik.arm.limits import LARGEST_LIMIT, JointLimits, VelocityByPosition, warn_of_degrees
from optik.arm.linkage import Linkage
from optik.arm.model import ArmModel
from optik.arm.placeholders import warn_of_placeholders
from optik.arm.urdf_tree import Joint, Tree, join_names, joint_origin, origin_pose, read_number, read_tree, read_triple
from optik.check import check_flag, check_words
from optik.errors import InvalidInput, MovingMountWarning, RobotModelError, RobotModelWarning, UnreadShapeWarning
from optik.types import Array

if TYPE_CHECKING:
    from optik.arm.shapes.urdf import Folders


# ---------------- the tip of a URDF where none is named


TOOL_NAMES = ("tool0", "flange")
"""Names of the end of an arm in ROS, with or without a prefix, in order of preference."""
FINGER = re.compile(r"finger|gripper|jaw|knuckle|thumb", re.IGNORECASE)
"""Names of the joints of a hand."""
NO_TOOL = re.compile(
    r"camera|optical|(^|_)(imu|range)(_|$)|accelero|sensor|laser|lidar|inertia|finger|_sc$", re.IGNORECASE
)
"""Names of links that are no tool: sensors, fingers, and shapes for self-collision."""
SIDE_JOINTS = 2
"""Bodies in a row with a joint that leads nowhere, such as one for a stiffness, behind which the same is no hand."""
CONTENT = ("inertial", "visual", "collision")
"""Elements of a link that is more than a frame."""
TIP_ADVICE = "; tip= selects another"
"""End of the sentence on a tip that was chosen by a rule."""


class Tip(NamedTuple):
    """A link at the end of an arm, its number of moving joints, and the reason to take it."""

    link: str
    joints: int
    reason: str


def find_tip(tree: Tree, base: str) -> tuple[str, str]:
    """Return the tip of the only or the longest chain below a link, and the reason if others were possible."""
    ends = _find_ends(tree, base)
    usable = [end for end in ends if _is_usable(tree, base, end.link)] or ends
    if len(usable) > 1:
        words = join_names([f"{end.link} ({end.joints} joint{'s' * (end.joints > 1)})" for end in usable])
        raise RobotModelError(tree.name, f"possible tips are {words}; for the first: tip={usable[0].link!r}")
    if not ends:
        return base, ""
    end = usable[0]
    chosen = sum(link not in tree.below for link in tree.list_below(base)) > 1 or end.link in tree.below
    return end.link, f", {end.reason}{TIP_ADVICE}" if chosen else ""


def _is_usable(tree: Tree, base: str, link: str) -> bool:
    """Return whether every joint between two links is fixed, or moves independently with one degree of freedom."""
    links = tree.path(link)
    joints = [tree.above[name] for name in links[: links.index(base)]]
    return all(j.kind == "fixed" or (j.kind in MOVING and "mimic" not in j.element) for j in joints)


def _find_ends(tree: Tree, base: str) -> list[Tip]:
    """Return the possible ends of the longest chains below a link."""
    below = dict.fromkeys(tree.list_below(base), 0)  # moving joints below each link
    for link in reversed(below):
        if link != base:
            joint = tree.above[link]
            below[joint.parent] = max(below[joint.parent], below[link] + (joint.kind != "fixed"))
    ends: list[Tip] = []
    todo = [(base, 0, 0)]
    while todo:
        link, joints, aside = todo.pop()
        body = _list_body(tree, link)
        branches = [tree.above[child] for name in body for child in tree.below.get(name, ())]
        branches = _drop_dummies(tree, [joint for joint in branches if joint.kind != "fixed"])
        branches.sort(key=lambda joint: -below[joint.child])
        lengths = [1 + below[joint.child] for joint in branches]
        similar = [joint for joint, length in zip(branches, lengths, strict=True) if 2 * length > lengths[0]]
        is_short = not branches or (lengths[0] <= joints and aside < SIDE_JOINTS)
        if joints and _is_end(tree, body, similar, is_short):
            ends += _choose_links(tree, body, branches, joints)
        else:
            others = zip(branches[1:], lengths[1:], strict=True)
            aside = aside + 1 if any(length == 1 and "mimic" not in j.element for j, length in others) else 0
            todo += [(joint.child, joints + 1, aside) for joint in reversed(similar)]
    return ends


def _drop_dummies(tree: Tree, branches: list[Joint]) -> list[Joint]:
    """Return branches without those that move frames only, such as joints for a stiffness, if others move more."""
    full = [
        joint for joint in branches
        if any(tree.parts(link, tag) for link in tree.list_below(joint.child) for tag in CONTENT)
    ]  # fmt: skip
    return full or branches


def _list_body(tree: Tree, link: str) -> list[str]:
    """List a link and those that fixed joints connect to it, each after its parent."""
    body = [link]
    for name in body:  # grows while it is read
        body += [child for child in tree.below.get(name, ()) if tree.above[child].kind == "fixed"]
    return body


def _is_end(tree: Tree, body: list[str], branches: list[Joint], short: bool) -> bool:
    """Return whether the arm ends at a body: nothing moves behind it, or only a hand, whose branches are short."""
    if not branches:
        return True
    in_hand = FINGER.search(tree.above[body[0]].name)
    if not in_hand and len(branches) == 1 and FINGER.search(branches[0].name):
        return True
    return short and (len(branches) > 1 or any(_is_named(link, name) for link in body for name in TOOL_NAMES))


def _is_named(link: str, name: str) -> bool:
    """Return whether a link that is no camera has a name, or this name behind a prefix."""
    return "camera" not in link.lower() and re.fullmatch(rf"(.*[_/\-.])?{name}", link) is not None


def _choose_links(tree: Tree, body: list[str], branches: list[Joint], joints: int) -> list[Tip]:
    """Return the link of a body that is the tip, or all candidates if no rule decides."""
    for name in TOOL_NAMES:
        if found := [link for link in body if _is_named(link, name)]:
            return [Tip(link, joints, "chosen by its name") for link in ([name] if name in found else found)]
    carrying, leaves = {joint.parent for joint in branches}, []
    for link in reversed(body):
        if link == body[0] or link in carrying or not NO_TOOL.search(link):
            leaves += [link] if link not in carrying else []
            carrying.add(tree.above[link].parent)
    if branches and len(leaves) != 1:
        paths = [set(tree.path(joint.parent)) for joint in branches]
        common = [link for link in body if all(link in path for path in paths)]
        return [Tip(common[-1], joints, "the last link before the hand")]
    reason = "the only end before the hand" if branches else "the end of the longest chain"
    return [Tip(link, joints, reason) for link in reversed(leaves)]


# ---------------- reader of URDF


P = ParamSpec("P")
"""Arguments of a function."""
R = TypeVar("R")
"""Result of a function."""
Placed: TypeAlias = list[tuple[Joint, Array]]
"""All joints of a chain, and the poses of their links in the frames of the arm's joints."""
PRODUCTS = (("ixx", "ixy", "ixz"), ("ixy", "iyy", "iyz"), ("ixz", "iyz", "izz"))
"""Attributes of an <inertia>, arranged as in the tensor."""
LIMIT_ATTRIBUTES = ("acceleration", "deceleration", "jerk")
"""Attributes of <limit> that few files have, and fields of `JointLimits`; 0 means unknown."""
BY_POSITION = "position_based_velocity_limits"
"""Element of a joint that libfranka reads: velocities near the ends of its range."""
INFINITE_TEXTS = ("inf", "+inf", "infinity", "+infinity")
"""Texts for infinity, in lower case."""


def read_urdf(
    source: str | os.PathLike[str], tip: str | None = None, base: str | None = None, *, name: str | None = None,
    gravity: ArrayLike | None = None, shapes: bool = False, package_dirs: Folders = None,
    srdf: str | os.PathLike[str] | None = None, values: Mapping[str, float] | None = None,
    without_shape: Iterable[str] = (),
) -> ArmModel:  # fmt: skip
    """Read the chain between two links; see `Robot.from_urdf`."""
    folders = None
    if check_flag(shapes, "shapes"):
        from optik.arm.shapes.urdf import find_mesh_folders

        folders = find_mesh_folders(source, package_dirs)
    for argument, option in (("package_dirs", package_dirs), ("srdf", srdf), ("without_shape", without_shape or None)):
        if folders is None and option is not None:
            raise InvalidInput(argument, "one", "none without shapes=True")
    for argument, value in (("tip", tip), ("base", base), ("name", name)):
        if value is not None and not isinstance(value, str):
            raise InvalidInput(argument, repr(value)[:60], "a name")
    tree = read_tree(source, name)
    base = _check_link(tree, base, "base") if base is not None else tree.root
    tip, reason = find_tip(tree, base) if tip is None else (_check_link(tree, tip, "tip"), "")
    links = tree.path(tip)
    if base not in links:
        problem = f"link {tip!r} is not below link {base!r}; above it are: {join_names(links[1:])}"
        raise RobotModelError(tree.name, problem)
    chain = [tree.above[link] for link in reversed(links[: links.index(base)])]
    tree = hold_joints(tree, chain, values, partial(_axis, tree.name))
    chain = [tree.above[joint.child] for joint in chain]
    down = _find_gravity(tree, base) if gravity is None else np.asarray(gravity)
    arm, placed = _arm(tree, chain, down, f"URDF {tree.name!r}, from {base} to {tip}{reason}")
    warn_of_placeholders(arm, [joint for joint in chain if joint.kind != "fixed"])
    if gravity is None:
        _warn_of_moving_mount(tree, base)
    if folders is None:
        return arm
    from optik.arm.shapes.contact import leave_out_contact
    from optik.arm.shapes.urdf import place_links, read_shapes

    for link in check_words(without_shape, "without_shape"):
        for element in tree.parts(_check_link(tree, link, "without_shape"), "collision"):
            tree.links[link].remove(element)
    enclosed = read_shapes(tree, base, placed, folders, partial(_axis, tree.name))
    if enclosed.unread:
        warnings.warn(UnreadShapeWarning(tree.name, enclosed.describe_unread(), enclosed.unread), stacklevel=3)
    arm = arm.with_shapes(enclosed if srdf is None else enclosed.with_srdf(srdf))
    return leave_out_contact(arm, tree, place_links(base, placed), folders)


def _check_link(tree: Tree, link: str, argument: str) -> str:
    if link != tree.root and link not in tree.above:
        links = join_names([tree.root, *tree.above])
        raise RobotModelError(tree.name, f"{argument}={link!r} names no link; there are: {links}")
    return link


def _find_gravity(tree: Tree, base: str) -> Array:
    """Return the direction (3,) of −z of the root link in the frame of a base link; joints between them are at 0."""
    R = np.eye(3)
    for joint in _list_mount(tree, base):
        R = R @ joint_origin(tree.name, joint)[:3, :3]
    return np.asarray(0.0 - R[2])


def _list_mount(tree: Tree, base: str) -> list[Joint]:
    """List the joints from the root link to a base link."""
    return [tree.above[link] for link in reversed(tree.path(base)[:-1])]


def _warn_of_moving_mount(tree: Tree, base: str) -> None:
    if moving := [joint.name for joint in _list_mount(tree, base) if joint.kind != "fixed"]:
        problem = (
            f"joint {join_names(moving)} moves the base {base!r}; gravity is computed at its position 0; "
            "gravity=(x, y, z) in the frame of the base sets another"
        )
        warnings.warn(MovingMountWarning(tree.name, problem), stacklevel=4)


# ---------------------------------------------------------------- the chain as an arm


def _arm(tree: Tree, chain: list[Joint], gravity: Array, source: str) -> tuple[ArmModel, Placed]:
    """Build the arm: merge fixed joints, and rotate frames whose joint axis is not z."""
    name, fixed, axes = tree.name, list[Array](), list[Joint]()
    placed: Placed = []
    T = np.eye(4)
    for joint in chain:
        T = T @ joint_origin(name, joint)
        if joint.kind != "fixed":
            _check_kind(name, joint)
            turn = se3.pose(_rotate_z_onto(_axis(name, joint)))
            fixed.append(T @ turn)
            T = turn.T.copy()
            axes.append(joint)
        placed.append((joint, T.copy()))
    if not axes:
        raise RobotModelError(name, "no joint between base and tip moves")
    moving, linkage = find_linkage(tree, axes)
    lower, upper, velocity = np.array([_limits(name, joint) for joint in moving]).T
    _check_ranges(name, moving, lower, upper)
    known = JointLimits(lower, upper, velocity if np.isfinite(velocity).any() else None)
    known = known.replace(torque=_read_or_warn(_read_torques, name, moving), **_read_dynamic_limits(name, moving))
    arm = ArmModel(
        name,
        np.array(fixed),
        np.array([joint.kind == "prismatic" for joint in moving]),
        T,
        known if linkage is None else _join_limits(name, known, axes, linkage),
        tuple(joint.name for joint in moving),
        gravity,
        source,
        inertia=_read_or_warn(_read_masses, tree, placed),
        linkage=linkage,
    )
    return arm, placed


def _join_limits(robot: str, limits: JointLimits, axes: list[Joint], linkage: Linkage) -> JointLimits:
    """Return the limits of joints, lowered to those of the axes that follow them; torques are the joints' alone."""
    if by_position := [joint.name for joint in axes if {"mimic", BY_POSITION} <= set(joint.element)]:
        raise RobotModelError(robot, f"joint {by_position[0]!r}: follows another one (<mimic>), with {BY_POSITION}")
    rates = {
        name: np.array([_positive(robot, joint, "limit", name) or np.inf for joint in axes])
        for name in ("velocity", *LIMIT_ATTRIBUTES)
    }
    return linkage.join_limits(robot, limits, np.array([read_range(robot, joint) for joint in axes]), rates)


def _read_or_warn(read: Callable[P, R], *arguments: P.args, **options: P.kwargs) -> R | None:
    """Read masses or torques; return None with a warning if they are invalid."""
    try:
        return read(*arguments, **options)
    except RobotModelError as error:
        warnings.warn(RobotModelWarning(error.robot, f"{error.problem}; read without"), stacklevel=5)
        return None


def _check_kind(robot: str, joint: Joint) -> None:
    if joint.kind not in MOVING:
        kinds = "fixed, revolute, continuous or prismatic"
        raise RobotModelError(robot, f"joint {joint.name!r}: type {joint.kind!r}, expected {kinds} on the chain")


def _axis(robot: str, joint: Joint) -> Array:
    """Return the unit axis (3,) in the joint's frame; URDF's default is x."""
    element = joint.element.get("axis")
    if element is None:
        return np.array([1.0, 0.0, 0.0])
    axis = read_triple(robot, f"joint {joint.name!r}", element.get("xyz", ""), "axis xyz")
    if not axis.any():
        raise RobotModelError(robot, f"joint {joint.name!r}: axis 0 0 0 has no direction")
    axis = axis / np.abs(axis).max()  # avoids overflow of the squares
    return np.asarray(axis / math.hypot(*axis))


def _rotate_z_onto(axis: Array) -> Array:
    """Return the rotation (3, 3) from z onto a unit axis, of least angle if z ≥ 0; exact if the axis is ±x, ±y or ±z."""
    x, y, z = axis
    if z < 0.0:  # first a rotation by π about x, which takes z to −z
        return _rotate_z_onto(-axis) @ np.diag([1.0, -1.0, -1.0])
    s = 1.0 / (1.0 + z)
    return np.array([[1.0 - s * x * x, -s * x * y, x], [-s * x * y, 1.0 - s * y * y, y], [-x, -y, z]])


def _limits(robot: str, joint: Joint) -> tuple[float, float, float]:
    """Read the lower and upper limit and the velocity of a joint; a missing or zero velocity is infinite."""
    element = joint.element.get("limit")
    lower, upper, where = -np.inf, np.inf, f"joint {joint.name!r}"
    if joint.kind != "continuous":
        if element is None:
            raise RobotModelError(robot, f"{where}: no <limit>, which URDF requires of a {joint.kind} joint")
        lower, upper = (read_number(robot, where, element.get(s, "0"), f"{s} limit") for s in ("lower", "upper"))
        lower = -np.inf if lower < -LARGEST_LIMIT else lower  # exporters write 1e16 for a joint without limits
        upper = np.inf if upper > LARGEST_LIMIT else upper
        if lower > upper:
            raise RobotModelError(robot, f"{where}: lower limit {lower:.6g} above upper {upper:.6g}")
    return lower, upper, _positive(robot, joint, "limit", "velocity") or np.inf


def _read_dynamic_limits(robot: str, joints: list[Joint]) -> dict[str, Any]:
    """Read the limits that few files have: further attributes of <limit>, and libfranka's <position_based_velocity_limits>."""
    given = {name: [_positive(robot, joint, "limit", name) or np.inf for joint in joints] for name in LIMIT_ATTRIBUTES}
    found: dict[str, Any] = {name: np.array(values) for name, values in given.items() if np.isfinite(values).any()}
    if any(BY_POSITION in joint.element for joint in joints):
        keys = "velocity_offset", "deceleration_limit"
        offset, deceleration = np.array([[_positive(robot, x, BY_POSITION, key) for x in joints] for key in keys])
        for joint, d in zip(joints, deceleration, strict=True):
            if BY_POSITION in joint.element and not d > 0.0:
                problem = f"deceleration_limit {d:g}, expected a number above 0"
                raise RobotModelError(robot, f"joint {joint.name!r}: {problem}")
        found["velocity_by_position"] = VelocityByPosition(offset, np.where(deceleration > 0.0, deceleration, np.inf))
    return found


def _check_ranges(robot: str, joints: list[Joint], lower: Array, upper: Array) -> None:
    """Refuse joints that cannot move, and warn of limits (n,) that seem to be degrees."""
    if locked := [f"{joint.name!r} ({_describe_lock(joint, lower[i])})" for i, joint in enumerate(joints)
                  if lower[i] == upper[i]]:  # fmt: skip
        advice = "give its range, or the type fixed"
        raise RobotModelError(robot, f"joint {join_names(locked)} cannot move: {advice}")
    narrower = []
    for joint, low, high in zip(joints, lower, upper, strict=True):
        where, soft = f"joint {joint.name!r}", joint.element.get("safety_controller", {})
        texts = (soft.get(f"soft_{side}_limit", "0") for side in ("lower", "upper"))
        a, b = (read_number(robot, where, text, "soft limit") for text in texts)
        unit = "m" if joint.kind == "prismatic" else "rad"
        narrower += [f"{joint.name!r} [{a:g}, {b:g}] {unit}"] if a < b and (a > low or b < high) else []
    if narrower:
        problem = (
            f"narrower soft limits of <safety_controller> are not used: {join_names(narrower)}; with_limits sets them"
        )
        warnings.warn(RobotModelWarning(robot, problem), stacklevel=5)
    turns = [joint.kind != "prismatic" for joint in joints]
    warn_of_degrees(robot, [joint.name for joint in joints], (lower, upper), turns, stacklevel=6)


def _describe_lock(joint: Joint, value: float) -> str:
    limit = joint.element["limit"]
    absent = limit.get("lower") is None and limit.get("upper") is None
    return "a <limit> without lower and upper, which are then 0" if absent else f"lower = upper = {value:.6g}"


# ---------------------------------------------------------------- masses and torque limits


def _read_masses(tree: Tree, placed: list[tuple[Joint, Array]]) -> Inertia | None:
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
    motor, viscous, coulomb = (
        np.array([_positive(tree.name, joint, "dynamics", name) for joint, _T in placed if joint.kind != "fixed"])
        for name in ("armature", "damping", "friction")
    )
    try:
        return Inertia(mass, com, tensor, motor, viscous, coulomb, f"URDF {tree.name!r}")
    except InvalidInput as error:  # of merged links
        raise RobotModelError(tree.name, str(error)) from None


def _read_torques(robot: str, joints: list[Joint]) -> Array | None:
    """Read the torque limits of joints; None if all are unknown."""
    efforts = np.array([_positive(robot, joint, "limit", "effort") or np.inf for joint in joints])
    return efforts if np.isfinite(efforts).any() else None


def _positive(robot: str, joint: Joint, tag: str, name: str) -> float:
    """Read a number ≥ 0 from an attribute of a joint's element; a missing one is 0, and a limit may be infinite."""
    text, where = joint.element.get(tag, {}).get(name, "0"), f"joint {joint.name!r}"
    infinite = tag == "limit" and text.strip().lower() in INFINITE_TEXTS
    value = np.inf if infinite else read_number(robot, where, text, name)
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
