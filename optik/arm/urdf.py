"""Reader of URDF: the chain from a base link to a tip link becomes an arm's data."""

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
from optik.files import content_of
from optik.types import Array

MOST_URDF_BYTES = 32 * 2**20
"""Longest description that is read [bytes]: a hundred times that of any arm, and small enough to be parsed at once."""

MOVING = ("revolute", "continuous", "prismatic")
"""Types of joints that become joints of the arm; fixed ones are merged, others are refused."""


@dataclass(frozen=True)
class _Joint:
    """One <joint> of a URDF: the links that it connects, and its child elements by name."""

    name: str
    kind: str
    parent: str
    child: str
    element: Any


@dataclass(frozen=True)
class _Tree:
    """The links of a URDF and the joint above each of them, checked to be one tree."""

    name: str
    root: str
    above: dict[str, _Joint]
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


def read_urdf(
    source: str | os.PathLike[str],
    tip: str | None = None,
    base: str | None = None,
    *,
    name: str | None = None,
    gravity: ArrayLike = (0.0, 0.0, -1.0),
) -> ArmModel:
    """Read the chain between two links; see `Robot.from_urdf`.

    Parameters
    ----------
    source : str or path
        A file, or the XML itself (text that begins with <).
    tip : str, optional
        Link of the tool; by default the only link without children below the base.
    base : str, optional
        Link whose frame poses are given in; by default the root.
    name : str, optional
        Name of the arm; by default the file's.
    gravity : (3,) array, optional
        Direction of gravity in the base frame [1].

    Returns
    -------
    ArmModel
        The arm.

    Raises
    ------
    InvalidInput
        No such file, no XML, no URDF, xacro, a DOCTYPE or an entity.
    RobotModelError
        No tree of links, no such link, no tip below the base, or an unsupported joint on the chain.
    """
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
    return _arm(tree.name, chain, gravity, f"URDF {tree.name!r}, from {base} to {tip}")


def _content(source: object) -> bytes:
    """XML as bytes: the argument itself if it begins with <, else the content of the file that it names."""
    wanted = "the path of a URDF file, or its text (which begins with <)"
    if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<"):
        # A string is decoded already: an encoding that its XML declaration names does not apply.
        text = re.sub(r"\A\s*(<\?xml[^>]*?)\s+encoding\s*=\s*(\"[^\"]*\"|'[^']*')", r"\1", source.lstrip("\ufeff"))
        content = text.strip().encode("utf-8", errors="replace")
        if len(content) > MOST_URDF_BYTES:
            raise InvalidInput("source", f"more than {MOST_URDF_BYTES // 2**20} MB", wanted)
        return content
    if not isinstance(source, str | os.PathLike):
        raise InvalidInput("source", repr(source)[:60], wanted)
    if Path(source).suffix == ".xacro":
        _refuse_xacro(str(source))
    return content_of(Path(source), argument="source", expected=wanted, most=MOST_URDF_BYTES)


def _parsed(content: bytes) -> Any:
    """Root element of XML without DOCTYPE and entities."""
    import xml.etree.ElementTree as ElementTree

    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    try:
        return fromstring(content, forbid_dtd=True)
    except DefusedXmlException:
        raise InvalidInput("source", "a DOCTYPE or an entity", "URDF without them; nothing in it is expanded") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the last two: an unknown encoding
        if b"<xacro:" in content:
            _refuse_xacro("source")
        raise InvalidInput("source", f"no XML: {error}", "URDF, which is XML") from None


def _refuse_xacro(file: str) -> NoReturn:
    raise InvalidInput(
        "source", f"xacro in {file[:120]!r}", "URDF; expand it first, for example by: xacro in.xacro > out.urdf"
    )


def _tree(root: Any, name: str | None) -> _Tree:
    """Links and joints of a <robot>, without elements of other namespaces (Gazebo, controllers)."""
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


def _grown(robot: str, links: list[str], joints: list[_Joint]) -> _Tree:
    """Return the tree of links, or raise RobotModelError with the link or joint that makes it none."""
    if not links:
        raise RobotModelError(robot, "no links")
    known = set(links)
    for joint in joints:
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in known:
                raise RobotModelError(robot, f"joint {joint.name!r}: its {end} link {link!r} does not exist")
    above: dict[str, _Joint] = {}
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
    tree = _Tree(robot, roots[0] if roots else "", above, below)
    in_cycles = set(links).difference(tree.reached(tree.root))
    if in_cycles:
        raise RobotModelError(robot, f"a cycle of links: {_listed([x for x in links if x in in_cycles])}")
    return tree


def _joint(robot: str, element: Any, prefix: str) -> _Joint:
    name = _attribute(robot, element, "name", "a <joint>")
    ends = []
    for end in ("parent", "child"):
        found = element.find(prefix + end)
        if found is None:
            raise RobotModelError(robot, f"joint {name!r}: no <{end}>")
        ends.append(_attribute(robot, found, "link", f"joint {name!r}: its <{end}>"))
    inner = {child.tag.removeprefix(prefix): child for child in reversed(element) if isinstance(child.tag, str)}
    return _Joint(name, element.get("type", ""), ends[0], ends[1], inner)


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


def _known_link(tree: _Tree, link: str, argument: str) -> str:
    if link != tree.root and link not in tree.above:
        links = _listed([tree.root, *tree.above])
        raise RobotModelError(tree.name, f"{argument}: no link is named {link!r}; there are: {links}")
    return link


def _only_leaf(tree: _Tree, base: str) -> str:
    leaves = sorted(link for link in tree.reached(base) if link not in tree.below)
    if len(leaves) != 1:
        raise RobotModelError(tree.name, f"{len(leaves)} chains end below {base!r}; name its tip: {_listed(leaves)}")
    return leaves[0]


# ---------------------------------------------------------------- the chain as an arm


def _arm(name: str, chain: list[_Joint], gravity: ArrayLike, source: str) -> ArmModel:
    """Merge fixed joints; if an axis is not z, rotate z onto it before the joint and back after it."""
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


def _check_kind(robot: str, joint: _Joint) -> None:
    if joint.kind not in MOVING:
        kinds = "fixed, revolute, continuous or prismatic"
        raise RobotModelError(robot, f"joint {joint.name!r}: type {joint.kind!r}, expected {kinds} on the chain")
    if "mimic" in joint.element:
        other = joint.element["mimic"].get("joint", "")
        problem = f"follows joint {other!r} (<mimic>); on the chain every joint is a variable of its own"
        raise RobotModelError(robot, f"joint {joint.name!r}: {problem}")


def _origin(robot: str, joint: _Joint) -> Array:
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


def _axis(robot: str, joint: _Joint) -> Array:
    """Unit axis (3,) in the joint's frame; by default x, as URDF defines."""
    element = joint.element.get("axis")
    if element is None:
        return np.array([1.0, 0.0, 0.0])
    axis = _triple(robot, joint, element.get("xyz", ""), "axis xyz")
    if not axis.any():
        raise RobotModelError(robot, f"joint {joint.name!r}: axis 0 0 0 has no direction")
    axis = axis / np.abs(axis).max()  # else the squares of 1e200 would be infinite
    return np.asarray(axis / math.hypot(*axis))


def _onto(axis: Array) -> Array:
    """Rotation (3, 3) that takes z onto a unit axis, of least angle if z ≥ 0; exact if the axis is ±x, ±y or ±z."""
    x, y, z = axis
    if z < 0.0:  # first a rotation by π about x, which takes z to −z
        return _onto(-axis) @ np.diag([1.0, -1.0, -1.0])
    s = 1.0 / (1.0 + z)
    return np.array([[1.0 - s * x * x, -s * x * y, x], [-s * x * y, 1.0 - s * y * y, y], [-x, -y, z]])


def _limits(robot: str, joint: _Joint) -> tuple[float, float, float]:
    """Lower and upper limit and velocity of a joint; the velocity is infinite if the file has none (or 0)."""
    element = joint.element.get("limit")
    lower, upper = -np.inf, np.inf
    if joint.kind != "continuous":
        if element is None:
            raise RobotModelError(
                robot, f"joint {joint.name!r}: no <limit>, which URDF requires of a {joint.kind} joint"
            )
        if element.get("lower") is None and element.get("upper") is None:
            problem = "a <limit> without lower and upper, which are then 0 in URDF: the joint cannot move"
            raise RobotModelError(robot, f"joint {joint.name!r}: {problem}")
        lower = _number(robot, joint, element.get("lower", "0"), "lower limit")
        upper = _number(robot, joint, element.get("upper", "0"), "upper limit")
        if lower > upper:
            raise RobotModelError(robot, f"joint {joint.name!r}: lower limit {lower:.6g} above upper {upper:.6g}")
    velocity = 0.0 if element is None else _number(robot, joint, element.get("velocity", "0"), "velocity limit")
    if velocity < 0.0:
        raise RobotModelError(robot, f"joint {joint.name!r}: velocity limit {velocity:.6g}, expected one above 0")
    return lower, upper, velocity or np.inf


def _triple(robot: str, joint: _Joint, text: str, what: str) -> Array:
    words = text.split()
    if len(words) != 3:
        raise RobotModelError(robot, f"joint {joint.name!r}: {what} is {text[:60]!r}, expected three numbers")
    return np.array([_number(robot, joint, word, what) for word in words])


def _number(robot: str, joint: _Joint, text: str, what: str) -> float:
    if "${" in text or "$(" in text:
        _refuse_xacro(text)
    try:
        value = float(text) if "_" not in text else math.nan  # Python reads 1_000, URDF does not
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RobotModelError(robot, f"joint {joint.name!r}: {what} is {text[:60]!r}, expected a finite number")
    return value
