"""URDF in and out: the chain from a base link to a tip link as a Robot, and a Robot as URDF text."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from math import cos, sin
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.limits import JointLimits
from optik.arm.model import ArmModel
from optik.errors import InvalidInput, RobotModelError
from optik.files import content_of, write_whole
from optik.types import Array

MOST_URDF_BYTES = 32 * 2**20
"""Longest description that is read [bytes]: a hundred times that of any arm, and small enough to be parsed at once."""

MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Joint:
    """One <joint> of a URDF: what it connects, and its XML element for the rest."""

    name: str
    kind: str
    parent: str
    child: str
    element: Any


@dataclass(frozen=True)
class Tree:
    """The links of a URDF and the joint above each of them, checked to be one tree."""

    name: str
    root: str
    above: dict[str, Joint]
    below: dict[str, list[str]]

    def reached(self, base: str) -> list[str]:
        """Links at and below a link."""
        found, todo = [], [base]
        while todo:
            found.append(todo.pop())
            todo.extend(self.below.get(found[-1], ()))
        return found

    def path(self, link: str) -> list[str]:
        """Links from one up to the root."""
        found = [link]
        while found[-1] in self.above:
            found.append(self.above[found[-1]].parent)
        return found


# ---------------------------------------------------------------- reading


def read_urdf(
    source: str | os.PathLike[str],
    tip: str | None = None,
    base: str | None = None,
    *,
    name: str | None = None,
    gravity: ArrayLike = (0.0, 0.0, -1.0),
) -> ArmModel:
    """Read the chain between two links; see `Robot.from_urdf`."""
    for argument, value in (("tip", tip), ("base", base), ("name", name)):
        if value is not None and not isinstance(value, str):
            raise InvalidInput(argument, repr(value)[:60], "a name")
    tree = _tree(_parsed(_content(source)), name)
    base = _known_link(tree, base, "base") if base is not None else tree.root
    tip = _known_link(tree, tip, "tip") if tip is not None else _only_leaf(tree, base)
    links = tree.path(tip)
    if base not in links:
        raise RobotModelError(tree.name, f"link {tip!r} is not below link {base!r}; above it are: {_listed(links[1:])}")
    chain = [tree.above[link] for link in reversed(links[: links.index(base)])]
    return _robot(tree.name, chain, gravity, f"URDF {tree.name!r}, from {base} to {tip}")


def _content(source: object) -> bytes:
    """XML text as bytes: the argument itself where it begins with <, else the file it names."""
    wanted = "the path of a URDF file, or its text (which begins with <)"
    if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<"):
        # In text the encoding is settled; what its first line says about one no longer holds.
        text = re.sub(r"\A\s*(<\?xml[^>]*?)\s+encoding\s*=\s*(\"[^\"]*\"|'[^']*')", r"\1", source.lstrip("\ufeff"))
        content = text.strip().encode("utf-8", errors="replace")
    elif isinstance(source, str | os.PathLike):
        if Path(source).suffix == ".xacro":
            _refuse_xacro(str(source))
        return content_of(Path(source), argument="source", expected=wanted, most=MOST_URDF_BYTES)
    else:
        raise InvalidInput("source", repr(source)[:60], wanted)
    if len(content) > MOST_URDF_BYTES:
        raise InvalidInput("source", f"more than {MOST_URDF_BYTES // 2**20} MB", wanted)
    return content


def _parsed(content: bytes) -> Any:
    """Root element of XML without DOCTYPE and entities."""
    import xml.etree.ElementTree as ElementTree

    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    try:
        return fromstring(content, forbid_dtd=True)
    except DefusedXmlException:
        raise InvalidInput("source", "a DOCTYPE or an entity", "URDF without them; nothing in it is expanded") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the last two: an encoding that is none
        if b"<xacro:" in content:
            _refuse_xacro("source")
        raise InvalidInput("source", f"no XML: {error}", "URDF, which is XML") from None


def _refuse_xacro(file: str) -> NoReturn:
    raise InvalidInput(
        "source", f"xacro in {file[:120]!r}", "URDF; expand it first, for example by: xacro in.xacro > out.urdf"
    )


def _tree(root: Any, name: str | None) -> Tree:
    """Links and joints of a <robot>; elements of other namespaces (Gazebo, controllers) are no part of it."""
    space, _, tag = root.tag.rpartition("}")
    prefix = f"{space}}}" if space else ""
    if tag != "robot":
        raise InvalidInput("source", f"the element <{tag[:60]}>", "a URDF, whose outermost element is <robot>")
    if any("xacro" in str(element.tag).partition("}")[0] and "}" in str(element.tag) for element in root.iter()):
        _refuse_xacro("source")
    robot = name or root.get("name") or "robot"
    links = [_attribute(robot, e, "name", "a <link>") for e in root.findall(f"{prefix}link")]
    joints = [_joint(robot, e, prefix) for e in root.findall(f"{prefix}joint")]
    for kind, found in (("links", links), ("joints", [j.name for j in joints])):
        twice = _repeated(found)
        if twice:
            raise RobotModelError(robot, f"two {kind} are named {twice!r}")
    return _grown(robot, links, joints)


def _grown(robot: str, links: list[str], joints: list[Joint]) -> Tree:
    """The tree of links, or what keeps it from being one."""
    if not links:
        raise RobotModelError(robot, "no links")
    known = set(links)
    for joint in joints:
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in known:
                raise RobotModelError(robot, f"joint {joint.name!r}: its {end} link {link!r} does not exist")
    above: dict[str, Joint] = {}
    for joint in joints:
        if joint.child in above:
            both = f"{above[joint.child].name!r} and {joint.name!r}"
            raise RobotModelError(robot, f"link {joint.child!r} has two parents, by the joints {both}")
        above[joint.child] = joint
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        raise RobotModelError(robot, f"{len(roots)} links have no parent, a tree has one: {_listed(roots)}")
    below: dict[str, list[str]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint.child)
    tree = Tree(robot, roots[0] if roots else "", above, below)
    in_cycles = set(links).difference(tree.reached(tree.root))
    if in_cycles:
        raise RobotModelError(robot, f"a cycle of links: {_listed([x for x in links if x in in_cycles])}")
    return tree


def _joint(robot: str, element: Any, prefix: str) -> Joint:
    name = _attribute(robot, element, "name", "a <joint>")
    ends = []
    for end in ("parent", "child"):
        found = element.find(prefix + end)
        if found is None:
            raise RobotModelError(robot, f"joint {name!r}: no <{end}>")
        ends.append(_attribute(robot, found, "link", f"joint {name!r}: its <{end}>"))
    inner = {child.tag.removeprefix(prefix): child for child in reversed(element) if isinstance(child.tag, str)}
    return Joint(name, element.get("type", ""), ends[0], ends[1], inner)


def _attribute(robot: str, element: Any, name: str, what: str) -> str:
    value = element.get(name)
    if not value:
        raise RobotModelError(robot, f"{what} has no {name}")
    return str(value)


def _repeated(names: Iterable[str]) -> str | None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


def _listed(names: list[str]) -> str:
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "") if names else "none"


def _known_link(tree: Tree, link: str, argument: str) -> str:
    if link != tree.root and link not in tree.above:
        links = _listed([tree.root, *tree.above])
        raise RobotModelError(tree.name, f"{argument}: no link is named {link!r}; there are: {links}")
    return link


def _only_leaf(tree: Tree, base: str) -> str:
    leaves = sorted(link for link in tree.reached(base) if link not in tree.below)
    if len(leaves) != 1:
        raise RobotModelError(tree.name, f"{len(leaves)} chains end below {base!r}; name its tip: {_listed(leaves)}")
    return leaves[0]


# ---------------------------------------------------------------- the chain as a Robot


def _robot(name: str, chain: list[Joint], gravity: ArrayLike, source: str) -> ArmModel:
    """Merge fixed joints; where an axis is not z, turn z onto it before the joint and back after it."""
    fixed, limits = [], []
    T = np.eye(4)
    moving = []
    for joint in chain:
        T = T @ _origin(name, joint)
        if joint.kind == "fixed":
            continue
        _check_kind(name, joint)
        turn = se3.pose(_onto(_axis(name, joint)))
        fixed.append(T @ turn)
        T = turn.T.copy()
        limits.append(_limits(name, joint))
        moving.append(joint)
    if not moving:
        raise RobotModelError(name, "no joint between base and tip moves")
    lower, upper, velocity = np.array(limits).T
    return ArmModel(
        name,
        np.array(fixed),
        np.array([joint.kind == "prismatic" for joint in moving]),
        T,
        JointLimits(lower, upper, velocity if np.isfinite(velocity).any() else None),
        tuple(joint.name for joint in moving),
        np.asarray(gravity),
        source,
    )


def _check_kind(robot: str, joint: Joint) -> None:
    if joint.kind not in MOVING:
        kinds = "fixed, revolute, continuous or prismatic"
        raise RobotModelError(robot, f"joint {joint.name!r}: type {joint.kind!r}, expected {kinds} on the chain")
    if "mimic" in joint.element:
        other = joint.element["mimic"].get("joint", "")
        problem = f"follows joint {other!r} (<mimic>); on the chain every joint is a variable of its own"
        raise RobotModelError(robot, f"joint {joint.name!r}: {problem}")


def _origin(robot: str, joint: Joint) -> Array:
    """Pose of a joint in its parent link: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    element = joint.element.get("origin")
    if element is None:
        return np.eye(4)
    roll, pitch, yaw = _triple(robot, joint, element.get("rpy", "0 0 0"), "origin rpy")
    Rx = [[1.0, 0.0, 0.0], [0.0, cos(roll), -sin(roll)], [0.0, sin(roll), cos(roll)]]
    Ry = [[cos(pitch), 0.0, sin(pitch)], [0.0, 1.0, 0.0], [-sin(pitch), 0.0, cos(pitch)]]
    Rz = [[cos(yaw), -sin(yaw), 0.0], [sin(yaw), cos(yaw), 0.0], [0.0, 0.0, 1.0]]
    xyz = _triple(robot, joint, element.get("xyz", "0 0 0"), "origin xyz")
    if np.abs(xyz).max() > se3.FARTHEST:
        raise RobotModelError(robot, f"joint {joint.name!r}: origin {np.abs(xyz).max():.3g} m away")
    return se3.pose(np.array(Rz) @ Ry @ Rx, xyz)


def _axis(robot: str, joint: Joint) -> Array:
    """Unit axis (3,) in the joint's frame; x where none is written, as URDF has it."""
    element = joint.element.get("axis")
    if element is None:
        return np.array([1.0, 0.0, 0.0])
    axis = _triple(robot, joint, element.get("xyz", ""), "axis xyz")
    if not axis.any():
        raise RobotModelError(robot, f"joint {joint.name!r}: axis 0 0 0 has no direction")
    axis = axis / np.abs(axis).max()  # or the squares of 1e200 would be infinite
    return np.asarray(axis / math.hypot(*axis))


def _onto(axis: Array) -> Array:
    """Rotation (3, 3) that takes z onto a unit axis, without a turn about it; exact where the axis is ±x, ±y or ±z."""
    x, y, z = axis
    if z < 0.0:  # first half a turn about x, which takes z to −z
        return _onto(-axis) @ np.diag([1.0, -1.0, -1.0])
    s = 1.0 / (1.0 + z)
    return np.array([[1.0 - s * x * x, -s * x * y, x], [-s * x * y, 1.0 - s * y * y, y], [-x, -y, z]])


def _limits(robot: str, joint: Joint) -> tuple[float, float, float]:
    """Lower and upper limit and velocity; the velocity is infinite where the file does not say it (or says 0)."""
    element = joint.element.get("limit")
    lower, upper = -np.inf, np.inf
    if joint.kind != "continuous":
        if element is None:
            raise RobotModelError(
                robot, f"joint {joint.name!r}: no <limit>, which URDF requires of a {joint.kind} joint"
            )
        if element.get("lower") is None and element.get("upper") is None:
            problem = "a <limit> without lower and upper, which URDF reads as 0: a joint that cannot move"
            raise RobotModelError(robot, f"joint {joint.name!r}: {problem}")
        lower = _number(robot, joint, element.get("lower", "0"), "lower limit")
        upper = _number(robot, joint, element.get("upper", "0"), "upper limit")
        if lower > upper:
            raise RobotModelError(robot, f"joint {joint.name!r}: lower limit {lower:.6g} above upper {upper:.6g}")
    velocity = 0.0 if element is None else _number(robot, joint, element.get("velocity", "0"), "velocity limit")
    if velocity < 0.0:
        raise RobotModelError(robot, f"joint {joint.name!r}: velocity limit {velocity:.6g}, expected one above 0")
    return lower, upper, velocity or np.inf


def _triple(robot: str, joint: Joint, text: str, what: str) -> Array:
    words = text.split()
    if len(words) != 3:
        raise RobotModelError(robot, f"joint {joint.name!r}: {what} is {text[:60]!r}, expected three numbers")
    return np.array([_number(robot, joint, word, what) for word in words])


def _number(robot: str, joint: Joint, text: str, what: str) -> float:
    if "${" in text or "$(" in text:
        _refuse_xacro(text)
    try:
        value = float(text) if "_" not in text else math.nan  # Python reads 1_000, URDF does not
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RobotModelError(robot, f"joint {joint.name!r}: {what} is {text[:60]!r}, expected a finite number")
    return value


# ---------------------------------------------------------------- writing


def write_urdf(arm: ArmModel, path: str | os.PathLike[str] | None = None) -> str:
    """Write a robot as URDF; see `Robot.to_urdf`."""
    from xml.sax.saxutils import quoteattr

    for name in (arm.name, *arm.joint_names):
        if not name or re.search("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", name):
            raise RobotModelError(arm.name, f"{name!r} is no name that XML can hold")
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(arm.name)}>", '  <link name="base"/>']
    before = "base"
    for i, name in enumerate(arm.joint_names):
        kind, limit = _kind_and_limit(arm, i)
        lines += [f'  <link name="link{i + 1}"/>', f'  <joint name={quoteattr(name)} type="{kind}">']
        lines += _placement(before, f"link{i + 1}", arm.fixed[i])
        lines += ['    <axis xyz="0 0 1"/>', *limit, "  </joint>"]
        before = f"link{i + 1}"
    flange = "flange"
    while flange in arm.joint_names:
        flange += "_"
    lines += ['  <link name="tool"/>', f'  <joint name="{flange}" type="fixed">']
    lines += [*_placement(before, "tool", arm.tool), "  </joint>", "</robot>", ""]
    text = "\n".join(lines)
    if path is not None:
        write_whole(path, lambda part: part.write_text(text, encoding="utf-8"))
    return text


def _placement(parent: str, child: str, T: Array) -> list[str]:
    xyz = " ".join(repr(float(x)) for x in T[:3, 3])
    rpy = " ".join(repr(x) for x in roll_pitch_yaw(T[:3, :3]))
    return [f'    <parent link="{parent}"/>', f'    <child link="{child}"/>', f'    <origin xyz="{xyz}" rpy="{rpy}"/>']


def _kind_and_limit(arm: ArmModel, i: int) -> tuple[str, list[str]]:
    """Type and <limit> of a joint; a velocity of 0 (and every effort) is one that is not known."""
    lower, upper = float(arm.limits.lower[i]), float(arm.limits.upper[i])
    speed = np.inf if arm.limits.velocity is None else float(arm.limits.velocity[i])
    known = f'effort="0" velocity="{repr(speed) if np.isfinite(speed) else 0}"'
    if np.isfinite([lower, upper]).all():
        kind = "prismatic" if arm.prismatic[i] else "revolute"
        return kind, [f'    <limit lower="{lower!r}" upper="{upper!r}" {known}/>']
    if arm.prismatic[i] or np.isfinite([lower, upper]).any():
        problem = f"limits {lower:.6g} to {upper:.6g}; URDF knows finite ones, or none for a joint that turns"
        raise RobotModelError(arm.name, f"joint {arm.joint_names[i]!r}: {problem}")
    return "continuous", [f"    <limit {known}/>"] if np.isfinite(speed) else []


def roll_pitch_yaw(R: Array) -> tuple[float, float, float]:
    """Angles with R = Rz(yaw) Ry(pitch) Rx(roll), to rounding for every R.

    Near pitch = ±90° yaw is read off noise. Any yaw will do there if roll is then read off Rz(−yaw) R, so it is.
    """
    yaw = math.atan2(R[1, 0], R[0, 0])
    c, s = cos(yaw), sin(yaw)
    pitch = math.atan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = math.atan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return roll, pitch, yaw
