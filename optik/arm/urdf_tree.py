"""Readers of XML: the tree of links and joints in a URDF, and the disabled pairs of links in an SRDF."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import cos, sin
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from optik import se3
from optik.errors import InvalidInput, RobotModelError
from optik.file_io import read_bytes
from optik.types import Array

MOST_URDF_BYTES = 32 * 2**20
"""Largest description that is read [bytes]: a hundred times that of an arm."""


@dataclass(frozen=True)
class Joint:
    """One <joint> of a URDF: the links that it connects, its child elements by name, and the motion of a held joint."""

    name: str
    kind: str
    parent: str
    child: str
    element: Any
    shift: Array | None = None


@dataclass(frozen=True)
class Tree:
    """The links of a URDF, each with the joint above it and the links below it."""

    name: str
    root: str
    above: dict[str, Joint]
    below: dict[str, list[str]]
    links: dict[str, Any]
    prefix: str

    def list_below(self, base: str) -> list[str]:
        """List a link and all links below it."""
        found, todo = [], [base]
        while todo:
            found.append(todo.pop())
            todo.extend(self.below.get(found[-1], ()))
        return found

    def path(self, link: str) -> list[str]:
        """List the links from one up to the root."""
        found = [link]
        while found[-1] in self.above:
            found.append(self.above[found[-1]].parent)
        return found

    def parts(self, link: str, tag: str) -> list[Any]:
        """List the XML elements of one kind in a link."""
        return list(self.links[link].findall(self.prefix + tag))

    def list_carried(self, link: str, chain: set[str]) -> Iterator[tuple[str, Array]]:
        """List a link and those that branch off the chain there, with poses in the link's frame at joint values of 0."""
        todo = [(link, np.eye(4))]
        while todo:
            name, T = todo.pop()
            yield name, T
            for child in self.below.get(name, ()):
                if child not in chain:
                    todo.append((child, T @ joint_origin(self.name, self.above[child])))


def read_tree(source: str | os.PathLike[str], name: str | None) -> Tree:
    """Read the links and joints of a URDF."""
    return _build_tree(read_xml(source), name)


def read_xml(source: str | os.PathLike[str]) -> Any:
    """Read XML without DOCTYPE and entities."""
    return _parse_xml(_read_source(source))


def read_disabled_pairs(source: str | os.PathLike[str], links: Sequence[str]) -> list[tuple[str, str, str]]:
    """Read the pairs of given links that an SRDF excludes from collision checks, with the reasons.

    As in MoveIt, <disable_default_collisions> excludes all pairs of a link except those in <enable_collisions>;
    <disable_collisions> takes precedence.
    """
    try:
        root = read_xml(source)
    except InvalidInput as error:
        raise InvalidInput("srdf", error.got, error.expected.replace("URDF", "SRDF")) from None
    if root.tag != "robot":
        raise InvalidInput("srdf", f"the element <{str(root.tag)[:60]}>", "an SRDF, whose outermost element is <robot>")
    silent = [_read_links(e, ("link",))[0] for e in root.iter("disable_default_collisions")]
    enabled = {frozenset(_read_links(e, ("link1", "link2"))) for e in root.iter("enable_collisions")}
    pairs = {
        frozenset((link, other)): (link, other, "disabled by default in the SRDF")
        for link in silent for other in links if other != link and frozenset((link, other)) not in enabled
    }  # fmt: skip
    for element in root.iter("disable_collisions"):
        one, other = _read_links(element, ("link1", "link2"))
        pairs[frozenset((one, other))] = one, other, element.get("reason") or "disabled in the SRDF"
    return [pair for pair in pairs.values() if {pair[0], pair[1]} <= set(links)]


def _read_links(element: Any, names: tuple[str, ...]) -> list[str]:
    """Read the links that an element of an SRDF names."""
    if not all(element.get(name) for name in names):
        raise InvalidInput("srdf", f"a <{element.tag}> without {' or '.join(names)}", f"{len(names)} link names")
    return [check_plain(element.get(name)) for name in names]


def is_text(source: object) -> bool:
    """Return whether a source is XML itself, not the path of a file."""
    return isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<")


@contextmanager
def name_file(source: object) -> Iterator[None]:
    """Add the file of a robot description to its errors."""
    try:
        yield
    except RobotModelError as error:
        raise RobotModelError(error.robot, error.problem, "" if is_text(source) else str(source)) from None


def _read_source(source: object) -> bytes:
    """Return XML as bytes: the argument if it begins with <, else the content of the file."""
    wanted = "the path of a URDF file, or its text (which begins with <)"
    if isinstance(source, str) and is_text(source):
        # A string is already decoded, so the encoding of its XML declaration is removed.
        text = re.sub(r"\A\s*(<\?xml[^>]*?)\s+encoding\s*=\s*(\"[^\"]*\"|'[^']*')", r"\1", source.lstrip("\ufeff"))
        content = text.strip().encode("utf-8", errors="replace")
        if len(content) > MOST_URDF_BYTES:
            raise InvalidInput("source", f"more than {MOST_URDF_BYTES // 2**20} MB", wanted)
        return content
    if not isinstance(source, str | os.PathLike):
        raise InvalidInput("source", repr(source)[:60], wanted)
    if Path(source).suffix == ".xacro":
        _refuse_xacro(str(source))
    return read_bytes(Path(source), argument="source", expected=wanted, most=MOST_URDF_BYTES)


def _parse_xml(content: bytes) -> Any:
    """Parse XML without DOCTYPE and entities; return the root element."""
    import xml.etree.ElementTree as ElementTree

    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    try:
        return fromstring(content, forbid_dtd=True)
    except DefusedXmlException:
        raise InvalidInput("source", "a DOCTYPE or an entity", "URDF without them") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the last two for an unknown encoding
        _check_encoding(content)
        if elements := re.findall(rb"<(xacro:\w+)", content):
            _refuse_xacro(next((e for e in elements if e != b"xacro:property"), elements[0]).decode())
        raise InvalidInput("source", f"invalid XML: {error}", "URDF (XML)") from None


def _check_encoding(content: bytes) -> None:
    """Refuse bytes that are not UTF-8 where no encoding is declared."""
    if re.match(rb"\s*<\?xml[^>]*\bencoding\b|\xff\xfe|\xfe\xff", content):
        return
    try:
        content.decode()
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        expected = 'UTF-8, or a first line that declares the encoding: <?xml version="1.0" encoding="NAME"?>'
        got = f"bytes that are not UTF-8 in line {line}, and no encoding is declared"
        raise InvalidInput("source", got, expected) from None


def _refuse_xacro(words: str) -> NoReturn:
    raise InvalidInput(
        "source", f"xacro in {words[:120]!r}", "URDF; expand it first, for example by: xacro in.xacro > out.urdf"
    )


def _build_tree(root: Any, name: str | None) -> Tree:
    """Read the links and joints of a <robot>, without elements of other namespaces (Gazebo, controllers)."""
    space, _, tag = root.tag.rpartition("}")
    prefix = f"{space}}}" if space else ""
    if tag != "robot":
        raise InvalidInput("source", f"the element <{tag[:60]}>", "a URDF, whose outermost element is <robot>")
    for element in root.iter():
        place, _, word = str(element.tag).rpartition("}")
        if "xacro" in place and word != "property":  # a property has no effect without ${…}, which is refused
            _refuse_xacro(f"<xacro:{word}>")
    robot = name or root.get("name") or "robot"
    elements = root.findall(f"{prefix}link")
    links = [_attribute(robot, e, "name", "a <link>") for e in elements]
    joints = [_joint(robot, e, prefix) for e in root.findall(f"{prefix}joint")]
    for kind, names in (("links", links), ("joints", [j.name for j in joints])):
        twice = _find_repeated(names)
        if twice:
            raise RobotModelError(robot, f"two {kind} are named {twice!r}")
    above, below = _connections(robot, links, joints)
    grown = Tree(robot, _root(robot, links, above), above, below, dict(zip(links, elements, strict=True)), prefix)
    in_cycles = set(links).difference(grown.list_below(grown.root))
    if in_cycles:
        raise RobotModelError(robot, f"a cycle of links: {join_names([x for x in links if x in in_cycles])}")
    return grown


def _connections(robot: str, links: list[str], joints: list[Joint]) -> tuple[dict[str, Joint], dict[str, list[str]]]:
    """Return the joint above each link and the links below it; raise RobotModelError if they are not a tree."""
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
            problem = f"link {joint.child!r} has two parents, by the joints {both}"
            raise RobotModelError(robot, f"{problem}: a closed loop; only linear relations (<mimic>) are read")
        above[joint.child] = joint
    below: dict[str, list[str]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint.child)
    return above, below


def _root(robot: str, links: list[str], above: dict[str, Joint]) -> str:
    """Return the only link without a parent; "" if every link has one."""
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        raise RobotModelError(robot, f"{len(roots)} links have no parent, expected one: {join_names(roots)}")
    return roots[0] if roots else ""


def _joint(robot: str, element: Any, prefix: str) -> Joint:
    name = _attribute(robot, element, "name", "a <joint>")
    ends = []
    for end in ("parent", "child"):
        found = element.find(prefix + end)
        if found is None:
            raise RobotModelError(robot, f"joint {name!r}: no <{end}>")
        ends.append(_attribute(robot, found, "link", f"joint {name!r}: its <{end}>"))
    inner = {child.tag.removeprefix(prefix): child for child in reversed(element) if isinstance(child.tag, str)}
    return Joint(name, check_plain(element.get("type", "")), ends[0], ends[1], inner)


def _attribute(robot: str, element: Any, name: str, what: str) -> str:
    value = element.get(name)
    if not value:
        raise RobotModelError(robot, f"{what} has no {name}")
    return check_plain(str(value))


def _find_repeated(names: Iterable[str]) -> str | None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


def join_names(names: list[str]) -> str:
    """Join at most twelve names for an error."""
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "") if names else "none"


# ---------------------------------------------------------------- numbers and poses


def joint_origin(robot: str, joint: Joint) -> Array:
    """Read the pose of a joint in its parent link; of a held joint, that of its child link."""
    T = origin_pose(robot, f"joint {joint.name!r}", joint.element.get("origin"))
    return T if joint.shift is None else T @ joint.shift


def origin_pose(robot: str, where: str, element: Any) -> Array:
    """Read the pose of an <origin>: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    if element is None:
        return np.eye(4)
    roll, pitch, yaw = read_triple(robot, where, element.get("rpy", "0 0 0"), "origin rpy")
    Rx = [[1.0, 0.0, 0.0], [0.0, cos(roll), -sin(roll)], [0.0, sin(roll), cos(roll)]]
    Ry = [[cos(pitch), 0.0, sin(pitch)], [0.0, 1.0, 0.0], [-sin(pitch), 0.0, cos(pitch)]]
    Rz = [[cos(yaw), -sin(yaw), 0.0], [sin(yaw), cos(yaw), 0.0], [0.0, 0.0, 1.0]]
    xyz = read_triple(robot, where, element.get("xyz", "0 0 0"), "origin xyz")
    if np.abs(xyz).max() > se3.FARTHEST:
        raise RobotModelError(robot, f"{where}: origin {np.abs(xyz).max():.3g} m away")
    return se3.pose(np.array(Rz) @ Ry @ Rx, xyz)


def read_triple(robot: str, where: str, text: str, what: str) -> Array:
    """Read three numbers."""
    words = text.split()
    if len(words) != 3:
        raise RobotModelError(robot, f"{where}: {what} is {text[:60]!r}, expected three numbers")
    return np.array([read_number(robot, where, word, what) for word in words])


def check_plain(text: str) -> str:
    """Refuse an expression of xacro, and return any other text."""
    if "${" in text or "$(" in text:
        _refuse_xacro(text)
    return text


def read_number(robot: str, where: str, text: str, what: str) -> float:
    """Read a number."""
    check_plain(text)
    try:
        value = float(text) if "_" not in text else math.nan  # 1_000 is a number in Python only
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RobotModelError(robot, f"{where}: {what} is {text[:60]!r}, expected a finite number")
    return value
