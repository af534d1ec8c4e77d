"""The tip of a URDF where none is named: the end of the longest chain of moving joints, before a hand.

Links that fixed joints connect are one body. A hand begins at a body with several branches of similar length, none longer than
the arm before it, or at a joint with the name of a finger.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from optik.arm.branches import MOVING
from optik.arm.urdf_tree import Joint, Tree, join_names
from optik.errors import RobotModelError

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
