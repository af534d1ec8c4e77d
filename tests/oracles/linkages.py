"""Small URDFs of linkages, twelve kinds, and their plain evaluation: each axis by its own rotation or translation, in numpy."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from optik.types import Array


@dataclass
class Axis:
    """A joint of a URDF: frame, axis and limits; and of a follower the joint that it follows, multiplier and offset."""

    name: str
    xyz: tuple[float, ...] = (0.0, 0.0, 0.3)
    rpy: tuple[float, ...] = (0.0, 0.0, 0.0)
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    kind: str = "revolute"
    span: tuple[float, float] = (-2.0, 2.0)
    speed: float = 2.0
    effort: float = 80.0
    follows: tuple[str, float, float] | None = None

    def text(self, parent: str, child: str, k: int) -> str:
        """Return the joint and its link, whose mass is off the axis."""
        mimic = ""
        if self.follows:
            mimic = '<mimic joint="{}" multiplier="{!r}" offset="{!r}"/>'.format(*self.follows)
        numbers = (" ".join(map(repr, x)) for x in (self.xyz, self.rpy, self.axis))
        xyz, rpy, axis = numbers
        limit = f'lower="{self.span[0]!r}" upper="{self.span[1]!r}" effort="{self.effort!r}" velocity="{self.speed!r}"'
        return (
            f'<link name="{child}"><inertial><origin xyz="0.02 {0.01 * k!r} 0.1"/><mass value="{3.0 / (k + 1)!r}"/>'
            '<inertia ixx="0.05" iyy="0.04" izz="0.03" ixy="0.001" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{self.name}" type="{self.kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/><limit {limit}/>'
            f'<dynamics damping="{0.3 + 0.1 * k!r}" friction="{0.2 + 0.05 * k!r}"/>{mimic}</joint>'
        )


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass
class Linkage:
    """The axes of a chain, base first, and joints beside it that some of them follow."""

    axes: list[Axis]
    beside: list[Axis] = field(default_factory=list)

    def urdf(self, *, mimic: bool = True) -> str:
        """Return the description; without <mimic> every axis is a joint of its own."""
        parts, parent = ['<robot name="linkage"><link name="base"/>'], "base"
        for k, axis in enumerate(self.axes):
            one = Axis(**{**vars(axis), "follows": axis.follows if mimic else None})
            parts.append(one.text(parent, parent := f"l{k}", k))
        parts += [axis.text("base", f"beside{k}", k) for k, axis in enumerate(self.beside if mimic else ())]
        tool = '<origin xyz="0.1 0.02 0.05" rpy="0.1 0.2 0.3"/>'
        parts.append(
            f'<link name="tool0"/><joint name="end" type="fixed"><parent link="{parent}"/><child link="tool0"/>'
        )
        return "".join([*parts, tool, "</joint></robot>"])

    def relation(self, name: str) -> tuple[str, float, float]:
        """Return the joint that an axis follows in the end, and the multiplier and offset."""
        axis = next(axis for axis in (*self.axes, *self.beside) if axis.name == name)
        if axis.follows is None:
            return name, 1.0, 0.0
        driver, factor, offset = self.relation(axis.follows[0])
        return driver, axis.follows[1] * factor, axis.follows[1] * offset + axis.follows[2]

    @property
    def drivers(self) -> list[str]:
        """Names of the joints, in the order of the chain."""
        own = [axis.name for axis in self.axes if axis.follows is None]
        return [*own, *(axis.name for axis in self.beside)]

    def values(self, q: dict[str, float]) -> list[float]:
        """Return the values of the axes."""
        found = [self.relation(axis.name) for axis in self.axes]
        return [factor * q[driver] + offset for driver, factor, offset in found]

    def fk(self, q: dict[str, float]) -> Array:
        """Return the pose of the tool."""
        T = np.eye(4)
        for axis, x in zip(self.axes, self.values(q), strict=True):
            T = T @ _frame(axis.xyz, axis.rpy) @ _move(axis, x)
        return np.asarray(T @ _frame((0.1, 0.02, 0.05), (0.1, 0.2, 0.3)))

    def span(self, driver: str, order: int) -> tuple[float, float]:
        """Return the range of a joint that all axes respect which follow it, or for order 1 its velocities."""
        low, high = -np.inf, np.inf
        for axis in (*self.axes, *self.beside):
            name, factor, offset = self.relation(axis.name)
            if name == driver:
                ends = axis.span if order == 0 else (-axis.speed, axis.speed)
                a, b = sorted((end - (0.0 if order else offset)) / factor for end in ends)
                low, high = max(low, a), min(high, b)
        return low, high


def _frame(xyz: tuple[float, ...], rpy: tuple[float, ...]) -> Array:
    T = np.eye(4)
    for axis, angle in zip((Z, Y, X), reversed(rpy), strict=True):
        T = T @ _turn(np.array(axis), angle)
    T[:3, 3] = xyz
    return T


def _turn(u: Array, angle: float) -> Array:
    """Return Rodrigues' rotation."""
    K = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
    T = np.eye(4)
    T[:3, :3] += np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    return T


def _move(axis: Axis, x: float) -> Array:
    u = np.array(axis.axis) / np.linalg.norm(axis.axis)
    if axis.kind == "revolute":
        return _turn(u, x)
    T = np.eye(4)
    T[:3, 3] = x * u
    return T


def arm(*between: Axis, beside: tuple[Axis, ...] = (), short: bool = False) -> Linkage:
    """Return an arm of three joints, further axes, and unless it is short three joints of a wrist."""
    first = [Axis("j1"), Axis("j2", (0.05, 0.0, 0.2), axis=Y), Axis("j3", (0.0, 0.0, 0.4), axis=Y, effort=60.0)]
    last = [
        Axis("j4", (0.3, 0.0, 0.05), axis=X, span=(-3.0, 3.0)),
        Axis("j5", (0.1, 0.0, 0.0), axis=Y),
        Axis("j6", (0.1, 0.0, 0.0), axis=X, span=(-3.0, 3.0)),
    ]
    return Linkage([*first, *between, *([] if short else last)], list(beside))


def _slide(name: str, span: tuple[float, float] = (0.0, 0.4), **others: object) -> Axis:
    return Axis(name, (0.05, 0.0, 0.0), axis=X, kind="prismatic", span=span, speed=0.5, effort=400.0, **others)  # type: ignore[arg-type]


KINDS: dict[str, Linkage] = {
    "level palletiser": Linkage([
        Axis("j1"), Axis("j2", (0.1, 0.0, 0.1), axis=Y, span=(-0.9, 1.2)),
        Axis("j2m", (0.0, 0.0, 0.5), axis=Y, follows=("j2", -1.0, 0.0)), Axis("j3", (0.0, 0.0, 0.0), axis=Y, span=(-1.0, 1.3)),
        Axis("j3m", (0.5, 0.0, 0.0), axis=Y, follows=("j3", -1.0, 0.0)), Axis("j4", (0.1, 0.0, -0.1), span=(-3.0, 3.0)),
    ]),
    "inclined wrist": Linkage([
        *arm(short=True).axes, Axis("j4", (0.3, 0.0, 0.05), axis=X, span=(-3.0, 3.0)),
        Axis("j5", (0.07, 0.0, 0.0), (0.0, 0.61, 0.0), X, span=(-3.0, 3.0)),
        Axis("j5b", (0.1, 0.0, 0.07), (0.0, -1.22, 0.0), X, span=(-3.0, 3.0), follows=("j5", -1.0, 0.0)),
        Axis("j6", (0.07, 0.0, -0.05), (0.0, 0.61, 0.0), X, span=(-3.0, 3.0)),
    ]),
    "half": arm(Axis("h", (0.05, 0.02, 0.0), (0.2, 0.0, 0.1), Z, follows=("j3", 0.5, 0.0))),
    "telescope": arm(_slide("s1"), _slide("s2", follows=("s1", 1.0, 0.0))),
    "rack": arm(_slide("rack", (-0.2, 0.2), follows=("j3", 0.06, 0.0))),
    "screw": arm(_slide("s1"), Axis("nut", (0.02, 0.0, 0.0), axis=X, span=(-9.0, 9.0), speed=20.0, follows=("s1", 7.0, 0.0))),
    "mimic of a mimic": arm(
        Axis("a", axis=Y, follows=("j2", 0.5, 0.1)), Axis("b", (0.1, 0.0, 0.0), axis=X, follows=("a", -2.0, 0.05)),
    ),
    "offset": arm(Axis("o", (0.1, 0.0, 0.0), axis=Y, follows=("j3", 1.0, -0.4))),
    "negative and narrow": arm(Axis("m", (0.1, 0.0, 0.0), axis=Y, span=(-0.5, 0.8), follows=("j3", -1.5, 0.2))),
    "before its driver": arm(Axis("early", (0.1, 0.0, 0.0), axis=Y, follows=("j5", -0.7, 0.0))),
    "driver beside": arm(
        Axis("on", (0.1, 0.0, 0.0), axis=Y, follows=("off", 0.8, 0.1)), beside=(Axis("off", axis=X, span=(-1.5, 1.4)),),
    ),
    "two slow followers": arm(
        Axis("u", (0.1, 0.0, 0.0), axis=Y, speed=0.6, follows=("j2", -1.0, 0.0)),
        Axis("v", (0.0, 0.05, 0.1), (0.3, 0.0, 0.0), Z, speed=0.5, follows=("j3", 2.0, 0.0), span=(-2.5, 2.5)),
    ),
}  # fmt: skip
"""Linkages by kind."""
