"""Reader of URDF: the chain from a base link to a tip link."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, ParamSpec, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.limits import LARGEST_LIMIT, JointLimits
from optik.arm.model import ArmModel
from optik.arm.urdf_masses import read_masses, read_torques
from optik.arm.urdf_tree import Joint, Tree, join_names, joint_origin, read_number, read_tree, read_triple
from optik.errors import InvalidInput, RobotModelError
from optik.types import Array

if TYPE_CHECKING:
    from optik.arm.shapes.meshes import Folders, MeshFolders

P = ParamSpec("P")
"""Arguments of a function."""

R = TypeVar("R")
"""Result of a function."""

Placed: TypeAlias = list[tuple[Joint, Array]]
"""All joints of a chain, and the poses of their links in the frames of the arm's joints."""

MOVING = ("revolute", "continuous", "prismatic")
"""Types of movable joints; fixed joints are merged, other types are an error."""


def read_urdf(
    source: str | os.PathLike[str],
    tip: str | None = None,
    base: str | None = None,
    *,
    name: str | None = None,
    gravity: ArrayLike = (0.0, 0.0, -1.0),
    folders: MeshFolders | None = None,
    srdf: str | os.PathLike[str] | None = None,
) -> ArmModel:
    """Read the chain between two links; see `Robot.from_urdf`."""
    for argument, value in (("tip", tip), ("base", base), ("name", name)):
        if value is not None and not isinstance(value, str):
            raise InvalidInput(argument, repr(value)[:60], "a name")
    tree = read_tree(source, name)
    base = _check_link(tree, base, "base") if base is not None else tree.root
    tip = _check_link(tree, tip, "tip") if tip is not None else _find_leaf(tree, base)
    links = tree.path(tip)
    if base not in links:
        raise RobotModelError(
            tree.name, f"link {tip!r} is not below link {base!r}; above it are: {join_names(links[1:])}"
        )
    chain = [tree.above[link] for link in reversed(links[: links.index(base)])]
    arm, placed = _arm(tree, chain, gravity, f"URDF {tree.name!r}, from {base} to {tip}")
    if folders is None:
        return arm
    from optik.arm.shapes.urdf import read_shapes

    shapes = read_shapes(tree, base, placed, folders, partial(_axis, tree.name))
    return arm.with_shapes(shapes if srdf is None else shapes.with_srdf(srdf))


def check_folders(
    source: str | os.PathLike[str], shapes: bool, package_dirs: Folders, srdf: object
) -> MeshFolders | None:
    """Return the folders of meshes for shapes=True; without shapes, package_dirs and srdf must be None."""
    if not shapes:
        if package_dirs is not None or srdf is not None:
            raise InvalidInput("package_dirs" if srdf is None else "srdf", "one", "none without shapes=True")
        return None
    from optik.arm.shapes.meshes import find_mesh_folders

    return find_mesh_folders(source, package_dirs)


def _check_link(tree: Tree, link: str, argument: str) -> str:
    if link != tree.root and link not in tree.above:
        links = join_names([tree.root, *tree.above])
        raise RobotModelError(tree.name, f"{argument}: no link is named {link!r}; there are: {links}")
    return link


def _find_leaf(tree: Tree, base: str) -> str:
    leaves = sorted(link for link in tree.list_below(base) if link not in tree.below)
    if len(leaves) != 1:
        raise RobotModelError(tree.name, f"{len(leaves)} chains end below {base!r}; name its tip: {join_names(leaves)}")
    return leaves[0]


# ---------------------------------------------------------------- the chain as an arm


def _arm(tree: Tree, chain: list[Joint], gravity: ArrayLike, source: str) -> tuple[ArmModel, Placed]:
    """Build the arm: merge fixed joints, and rotate frames whose joint axis is not z."""
    name, fixed, limits, moving = tree.name, [], [], []
    placed: Placed = []
    T = np.eye(4)
    for joint in chain:
        T = T @ joint_origin(name, joint)
        if joint.kind != "fixed":
            _check_kind(name, joint)
            turn = se3.pose(_rotate_z_onto(_axis(name, joint)))
            fixed.append(T @ turn)
            T = turn.T.copy()
            limits.append(_limits(name, joint))
            moving.append(joint)
        placed.append((joint, T.copy()))
    if not moving:
        raise RobotModelError(name, "no joint between base and tip moves")
    lower, upper, velocity = np.array(limits).T
    known = JointLimits(lower, upper, velocity if np.isfinite(velocity).any() else None)
    arm = ArmModel(
        name,
        np.array(fixed),
        np.array([joint.kind == "prismatic" for joint in moving]),
        T,
        known.replace(torque=_read_or_warn(read_torques, name, moving)),
        tuple(joint.name for joint in moving),
        np.asarray(gravity),
        source,
        inertia=_read_or_warn(read_masses, tree, placed),
    )
    return arm, placed


def _read_or_warn(read: Callable[P, R], *arguments: P.args, **options: P.kwargs) -> R | None:
    """Read masses or torques; return None with a warning if they are invalid."""
    try:
        return read(*arguments, **options)
    except RobotModelError as error:
        warnings.warn(f"{error}; read without", stacklevel=5)
        return None


def _check_kind(robot: str, joint: Joint) -> None:
    if joint.kind not in MOVING:
        kinds = "fixed, revolute, continuous or prismatic"
        raise RobotModelError(robot, f"joint {joint.name!r}: type {joint.kind!r}, expected {kinds} on the chain")
    if "mimic" in joint.element:
        other = joint.element["mimic"].get("joint", "")
        problem = f"follows joint {other!r} (<mimic>); on the chain every joint is a variable of its own"
        raise RobotModelError(robot, f"joint {joint.name!r}: {problem}")


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
            raise RobotModelError(
                robot, f"joint {joint.name!r}: no <limit>, which URDF requires of a {joint.kind} joint"
            )
        if element.get("lower") is None and element.get("upper") is None:
            problem = "a <limit> without lower and upper, which are then 0 in URDF: the joint cannot move"
            raise RobotModelError(robot, f"joint {joint.name!r}: {problem}")
        lower = read_number(robot, where, element.get("lower", "0"), "lower limit")
        upper = read_number(robot, where, element.get("upper", "0"), "upper limit")
        lower = -np.inf if lower < -LARGEST_LIMIT else lower  # exporters write 1e16 for a joint without limits
        upper = np.inf if upper > LARGEST_LIMIT else upper
        if lower > upper:
            raise RobotModelError(robot, f"joint {joint.name!r}: lower limit {lower:.6g} above upper {upper:.6g}")
    velocity = 0.0 if element is None else read_number(robot, where, element.get("velocity", "0"), "velocity limit")
    if velocity < 0.0:
        raise RobotModelError(robot, f"joint {joint.name!r}: velocity limit {velocity:.6g}, expected one above 0")
    return lower, upper, velocity or np.inf
