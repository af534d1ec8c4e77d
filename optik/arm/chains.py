"""Chains through two mechanisms: one turned round and joined to another, and an arm mounted on another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, TypeVar

import numpy as np
import scipy

from optik import se3
from optik.arm.inertia import Inertia
from optik.arm.limits import DYNAMIC_LIMITS, JointLimits, VelocityByPosition
from optik.arm.linkage import Linkage
from optik.arm.model import ArmModel
from optik.arm.motors import LIMIT_FIELDS, Motors, maker_limits, maker_names
from optik.arm.shapes.model import NEIGHBOURS, Apart, Shapes
from optik.types import Array, Indices

HALF_TURN = np.diag([1.0, -1.0, -1.0, 1.0])
"""X: X R_z(q) X = R_z(−q) and X T_z(q) X = T_z(−q), so that a chain turned round keeps the signs of its joints."""
LinkPose = tuple[int, Array]
"""A link of a chain, and the pose (4, 4) of another frame in that of the link [1, m]."""
ONE_BODY = "one body, which its own links are checked with"
"""Reason why links are not checked with the other mechanism's copy of a body that carries both."""
Arm = TypeVar("Arm", bound=ArmModel)
"""The class of an arm."""


def join_chains(first: Arm, second: Arm, names: tuple[str, str]) -> Arm:
    """Return the chain from the tool of one arm to that of another: fk(q) = first.fk(q₁)⁻¹ second.fk(q₂).

    The arms are named, and placed in the world by their bases. Joints and links are those of the first arm in reverse order,
    then those of the second. The base of the chain moves in the world, so the chain has neither gravity nor masses.
    """
    X, inverse, N = HALF_TURN, [se3.inverse(T) for T in first.fixed], len(first.fixed)
    turned = [se3.inverse(first.tool) @ X, *(X @ T @ X for T in inverse[:0:-1])]
    fixed = np.array([*turned, X @ inverse[0] @ second.fixed[0], *second.fixed[1:]])
    behind = [*((N - k, X @ inverse[k]) for k in range(N)), (0, se3.inverse(first.tool))]
    ahead = [(N, X @ inverse[0]), *((N + k, np.eye(4)) for k in range(1, len(second.fixed) + 1))]
    shapes = None
    if first.shapes is not None and second.shapes is not None:
        parts = _place(first.shapes, behind, f"{names[0]}/"), _place(second.shapes, ahead, f"{names[1]}/")
        shapes = _join_shapes(parts, several=True).with_apart(_list_common(parts, N))
    orders = [np.arange(first.n)[::-1], np.arange(second.n)]
    joints = [
        f"{name}/{arm.joint_names[i]}"
        for arm, name, order in zip((first, second), names, orders, strict=True)
        for i in order
    ]
    return replace(
        second, name=f"{names[1]} in {names[0]}", fixed=fixed, shapes=shapes, inertia=None, payload=None, source="",
        **_join_joints((first, second), orders, [f"{name}/" for name in names], joints),
        gravity=np.array([0.0, 0.0, -1.0]), gravity_magnitude=0.0,
    )  # fmt: skip


def mount_arm(below: Arm, arm: Arm) -> Arm:
    """Return the chain of an arm that stands with its base in the tool's frame of another, such as a slide."""
    N, names = len(below.fixed), (below.name, f"{arm.name}_2" if arm.name == below.name else arm.name)
    fixed = np.concatenate([below.fixed, arm.fixed])
    fixed[N] = below.tool @ arm.fixed[0]
    clash = set(maker_names(below) + below.link_names[1:]) & set(maker_names(arm) + arm.link_names[1:])
    prefix = [f"{name}/" if clash else "" for name in names]
    orders = [np.arange(one.n) for one in (below, arm)]
    joints = [f"{add}{name}" for one, add in zip((below, arm), prefix, strict=True) for name in one.joint_names]
    shapes, inertia = None, None
    if below.shapes is not None and arm.shapes is not None:
        clash = set(below.shapes.names) & set(arm.shapes.names)
        places = [(N, below.tool), *((N + k, np.eye(4)) for k in range(1, len(arm.fixed) + 1))]
        lower = _place(below.shapes, [(k, np.eye(4)) for k in range(N + 1)], f"{names[0]}/" if clash else "")
        shapes = _join_shapes([lower, _place(arm.shapes, places, f"{names[1]}/" if clash else "")], several=False)
    if below.inertia is not None and arm.inertia is not None:
        keys = ("mass", "com", "tensor", "motor", "viscous", "coulomb")
        values: dict[str, Any] = {
            key: np.concatenate([getattr(one.inertia, key) for one in (below, arm)]) for key in keys
        }
        inertia = Inertia(**values, source=arm.inertia.source)
    return replace(
        below, name=f"{names[1]} on {names[0]}", fixed=fixed, tool=arm.tool, shapes=shapes, inertia=inertia,
        payload=arm.payload, source=arm.source, **_join_joints((below, arm), orders, prefix, joints),
    )  # fmt: skip


def join_members(arms: Mapping[str, Arm], tool: str) -> Arm:
    """Return arms in one world as one robot, whose chain leads through each of them and back, and last to the arm of the tool.

    Its joints are those of the arms in their order. The axes that lead back follow them with the opposite sign.
    """
    each, at, fixed = list(arms.values()), np.eye(4), list[Array]()
    axes, signs, shapes = np.empty(0, np.int64), np.empty(0), dict[str, Shapes]()
    begins = dict(zip(arms, np.cumsum([0, *(len(arm.fixed) for arm in each)]).tolist(), strict=False))
    for name in (*(one for one in arms if one != tool), tool):
        arm, N = arms[name], len(arms[name].fixed)
        if arm.shapes is not None:
            links = [(0, np.eye(4)), *((len(fixed) + k, np.eye(4)) for k in range(1, N + 1))]
            part = shapes[name] = _place(arm.shapes, links, f"{name}/")
            near = ([part.names[i] for i in arm.shapes.find_capsules(k)] for k in (0, 1))
            # Base and first link of a further arm have no consecutive numbers.
            shapes[name] = part.with_apart({(*pair, NEIGHBOURS) for pair in product(*near)})
        fixed += [at @ arm.fixed[0], *arm.fixed[1:]]
        axes, signs = np.append(axes, begins[name] + np.arange(N)), np.append(signs, np.ones(N))
        if name != tool:
            at, *back = [se3.inverse(T) for T in arm.fixed]
            fixed += [np.eye(4), *back[::-1]]
            axes, signs = np.append(axes, axes[: -N - 1 : -1]), np.append(signs, -np.ones(N))
    prefix, orders = [f"{name}/" for name in arms], [np.arange(arm.n) for arm in each]
    joints = [f"{name}/{joint}" for name, arm in arms.items() for joint in arm.joint_names]
    ahead = _join_linkages(each, orders, prefix)
    names = tuple(f"{ahead.names[i]}{'' if sign > 0.0 else ' back'}" for i, sign in zip(axes, signs, strict=True))
    follow = Linkage(
        ahead.joint[axes], signs * ahead.factor[axes], signs * ahead.offset[axes], ahead.prismatic[axes], names
    )
    return replace(
        arms[tool], name=" and ".join(arms), fixed=np.array(fixed), inertia=None, payload=None, source="",
        shapes=_join_shapes([shapes[name] for name in arms], several=True) if len(shapes) == len(arms) else None,
        **_join_joints(each, orders, prefix, joints) | {"motors": None, "linkage": follow},
    )  # fmt: skip


def _place(shapes: Shapes, places: Sequence[LinkPose], prefix: str) -> Shapes:
    """Return shapes moved to links and poses: those of link k to places[k].

    Names get the prefix. A name of parts of several links gets the number of the link.
    """
    link = shapes.capsules[0].tolist()
    several = {name for name in shapes.names if len({link[i] for i in shapes.find_capsules(name)}) > 1}
    names = [
        f"{prefix}{name}" + (f" {k}" if name in several else "") for name, k in zip(shapes.names, link, strict=True)
    ]
    apart = {
        pair: reason for one, other, reason in shapes.apart
        for pair in product(*(dict.fromkeys(names[i] for i in shapes.find_capsules(part)) for part in (one, other)))
    }  # fmt: skip
    for k, (_, T) in enumerate(places):
        shapes = shapes.transform_part(k, T)
    capsules = np.array([places[k][0] for k in link]), *shapes.capsules[1:]
    return replace(
        shapes, capsules=capsules, names=tuple(names), apart=tuple((*pair, why) for pair, why in apart.items())
    )


def _list_common(each: Sequence[Shapes], base: int) -> Iterator[Apart]:
    """Yield the pairs of a part and the other mechanism's copy of a body that carries both, such as the torso of two arms."""
    bodies = [
        {(name.partition("/")[2], *np.round((*a, *b, r), 9)) for k, a, b, r, name in rows if k == base}
        for rows in (zip(*one.capsules, one.names, strict=True) for one in each)
    ]
    common = {body[0] for body in bodies[0] & bodies[1]} - {body[0] for body in bodies[0] ^ bodies[1]}
    for one, other in (each, each[::-1]):
        copies = [name for name in dict.fromkeys(other.names) if name.partition("/")[2] in common]
        yield from ((part, copy, ONE_BODY) for part, copy in product(dict.fromkeys(one.names), copies))


def _join_shapes(each: Sequence[Shapes], *, several: bool) -> Shapes:
    """Return the shapes of two parts of a chain, which are one mechanism or several."""
    columns: Any = tuple(map(np.concatenate, zip(*(one.capsules for one in each), strict=True)))
    hulls = [one.hulls or ((),) * one.m for one in each]
    return Shapes(
        columns, sum((one.names for one in each), ()), sum((one.apart for one in each), ()),
        np.concatenate([one.excess for one in each]), "; ".join(dict.fromkeys(one.source for one in each if one.source)),
        sum((one.unread for one in each), ()), sum(hulls, ()) if any(one.hulls for one in each) else (),
        tuple(k for k, one in enumerate(each) for _ in range(one.m)) if several else (),
    )  # fmt: skip


def _join_joints(
    arms: Sequence[ArmModel], orders: Sequence[Indices], prefix: Sequence[str], names: Sequence[str]
) -> dict[str, Any]:
    """Return prismatic, joint names, limits, motors and linkage of the joints of arms, each in an order."""
    limits = join_limits([arm.limits for arm in arms], orders)
    by_position = [arm.limits.velocity_by_position for arm in arms]
    if any(one is not None for one in by_position):
        rows = [
            (np.zeros(len(o)), np.full(len(o), np.inf)) if one is None else (one.offset[o], one.deceleration[o])
            for one, o in zip(by_position, orders, strict=True)
        ]
        limits["velocity_by_position"] = VelocityByPosition(*map(np.concatenate, zip(*rows, strict=True)))
    axes, motors, linkage = JointLimits(**limits), None, None
    if any(arm.motors is not None for arm in arms):
        motors = _join_motors(arms, orders, prefix)
    if any(arm.linkage is not None for arm in arms):
        linkage = _join_linkages(arms, orders, prefix)
    slides = np.concatenate([arm.prismatic[o] for arm, o in zip(arms, orders, strict=True)])
    return {"prismatic": slides, "joint_names": tuple(names), "limits": axes, "motors": motors, "linkage": linkage}


def join_limits(limits: Sequence[JointLimits], orders: Sequence[Indices]) -> dict[str, Any]:
    """Return the ends of ranges and the rates of joints; a rate is infinite where only the other arm's is known."""
    out: dict[str, Any] = {}
    for name in ("lower", "upper", *DYNAMIC_LIMITS):
        values = [getattr(one, name) for one in limits]
        if any(value is not None for value in values):
            out[name] = np.concatenate(
                [np.full(len(o), np.inf) if x is None else x[o] for x, o in zip(values, orders, strict=True)]
            )
    return out


def _join_motors(arms: Sequence[ArmModel], orders: Sequence[Indices], prefix: Sequence[str]) -> Motors:
    """Return the motors of the joints of arms; an arm without motors has one for each joint, with the ratio 1."""
    known = [(arm.motors, order) for arm, order in zip(arms, orders, strict=True)]
    blocks = [np.eye(len(o)) if one is None else one.matrix[np.ix_(o, o)] for one, o in known]
    columns = [
        np.concatenate([np.zeros(len(o)) if one is None else getattr(one, key)[o] for one, o in known])
        for key in ("offset", "inertia", "viscous", "coulomb")
    ]
    limits = join_limits([maker_limits(arm) for arm in arms], orders)
    names = [f"{add}{maker_names(arm)[i]}" for arm, order, add in zip(arms, orders, prefix, strict=True) for i in order]
    own = JointLimits(**{key: value for key, value in limits.items() if key in LIMIT_FIELDS})
    return Motors(scipy.linalg.block_diag(*blocks), columns[0], tuple(names), own, *columns[1:])


def _join_linkages(arms: Sequence[ArmModel], orders: Sequence[Indices], prefix: Sequence[str]) -> Linkage:
    """Return the relations of the axes of a chain to its joints; an arm without relations has the identity."""
    parts, n = [], 0
    for arm, order, add in zip(arms, orders, prefix, strict=True):
        own = arm.linkage or Linkage(np.arange(arm.n), np.ones(arm.n), np.zeros(arm.n), arm.prismatic, arm.joint_names)
        way = slice(None, None, -1 if len(order) > 1 and order[0] > order[1] else 1)
        joint = n + np.argsort(order)[own.joint][way]
        names = tuple(f"{add}{name}" for name in own.names[way])
        parts.append((joint, own.factor[way], own.offset[way], own.prismatic[way], names))
        n += arm.n
    *columns, names = zip(*parts, strict=True)
    joined: Any = [np.concatenate(column) for column in columns]
    joint, factor, offset, prismatic = joined
    return Linkage(joint, factor, offset, prismatic, tuple(name for own in names for name in own))
