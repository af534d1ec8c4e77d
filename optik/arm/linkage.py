"""Linkages: chains whose axes follow joints, axis = factor · joint + offset, such as parallelograms (<mimic> of a URDF)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.inertia import Load
from optik.arm.limits import ByContent, JointLimits, freeze
from optik.check import check_words
from optik.errors import InvalidInput, RobotModelError
from optik.types import Array, Flags, Indices


@dataclass(frozen=True, eq=False)
class Linkage(ByContent):
    """Axes of a chain that follow its joints: axis i has the value factor_i q_k + offset_i, where k is joint_i.

    Parameters
    ----------
    joint : (N,) array of int
        Index of the joint that each axis follows.
    factor, offset : (N,) array
        Motion of each axis for that of its joint [1], and its value at 0 of it [rad, m].
    prismatic : (N,) array of bool
        Which axes slide.
    names : tuple of str
        Names of the axes.

    Raises
    ------
    InvalidInput
        Wrong lengths, a factor of 0, or a joint without an axis.
    """

    joint: Indices
    factor: Array
    offset: Array
    prismatic: Flags
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        joint, names = np.array(self.joint), check_words(self.names, "linkage.names")
        factor, offset = freeze(self.factor, "linkage.factor"), freeze(self.offset, "linkage.offset")
        shapes = {np.shape(x) for x in (joint, factor, offset, self.prismatic)}
        if shapes != {(len(names),)} or not np.isfinite(offset).all() or not np.isfinite(1.0 / factor).all():
            raise InvalidInput("linkage", f"{factor}, {offset}"[:80], "a joint, a factor and an offset for each axis")
        if joint.dtype.kind != "i" or set(joint.tolist()) != set(range(int(joint.max()) + 1)):
            raise InvalidInput("linkage.joint", str(joint)[:60], "every joint from 0 on")
        slides = np.array(self.prismatic)
        for array in (joint, slides):
            array.setflags(write=False)
        given = {"joint": joint, "factor": factor, "offset": offset, "prismatic": slides, "names": names}
        for name, value in given.items():
            object.__setattr__(self, name, value)

    @cached_property
    def matrix(self) -> Array:
        """Axes over joints (N, n) [1]."""
        matrix = np.zeros((self.joint.size, int(self.joint.max()) + 1))
        matrix[np.arange(self.joint.size), self.joint] = self.factor
        return freeze(matrix, "linkage.matrix")

    @cached_property
    def turning(self) -> Flags:
        """Joints (n,) whose whole turns leave all links in place [1]."""
        stays = ~self.prismatic & (self.factor == np.round(self.factor))
        return np.array([stays[self.joint == i].all() for i in range(self.matrix.shape[1])])

    @property
    def content(self) -> bytes:
        """The numbers and names, as bytes."""
        return repr((self.names, self.joint.tolist(), self.prismatic.tolist())).encode() + (
            self.factor.tobytes() + self.offset.tobytes()
        )

    def spread(self, q: ArrayLike, order: int = 0) -> Array:
        """Return the values (..., N) of the axes, or their derivatives, from those of the joints (..., n)."""
        return np.asarray(np.asarray(q)[..., self.joint] * self.factor + (0.0 if order else self.offset))

    def append(self, prismatic: Sequence[bool], names: Sequence[str]) -> Linkage:
        """Return the linkage with further joints at its end, each with an axis of its own."""
        d = len(names)
        return Linkage(
            np.append(self.joint, self.joint.max() + 1 + np.arange(d)), np.append(self.factor, np.ones(d)),
            np.append(self.offset, np.zeros(d)), np.append(self.prismatic, prismatic), (*self.names, *names),
        )  # fmt: skip

    def spread_bounds(self, most: Array) -> Array:
        """Return bounds on the axes and their derivatives (..., k, N) from those of the joints (..., k, n), order 0 first."""
        out = most[..., self.joint] * np.abs(self.factor)
        out[..., 0, :] += np.abs(self.offset)
        return np.asarray(out)

    def join_friction(self, load: Load) -> Load:
        """Return a load with the friction (n,) at the joints, from that at the axes (N,)."""
        M = np.abs(self.matrix)
        return load._replace(
            viscous=freeze(load.viscous @ M**2, "viscous"), coulomb=freeze(load.coulomb @ M, "coulomb")
        )

    def join_limits(self, robot: str, limits: JointLimits, ranges: Array, rates: dict[str, Array]) -> JointLimits:
        """Return limits of the joints, lowered to ranges (N, 2) of the axes and to their largest rates (N,) by name."""
        ends = np.sort((ranges - self.offset[:, None]) / self.factor[:, None], axis=1)
        lower, upper = limits.lower.copy(), limits.upper.copy()
        np.maximum.at(lower, self.joint, ends[:, 0])
        np.minimum.at(upper, self.joint, ends[:, 1])
        for i in np.flatnonzero(~(lower < upper))[:1]:
            names = ", ".join(name for name, k in zip(self.names, self.joint, strict=True) if k == i)
            raise RobotModelError(
                robot, f"joints {names} move together (<mimic>), and their ranges have nothing in common"
            )
        known: dict[str, Any] = {}
        for name, values in rates.items():
            own = getattr(limits, name)
            least = np.full(lower.size, np.inf) if own is None else own.copy()
            np.minimum.at(least, self.joint, values / np.abs(self.factor))
            known |= {name: least} if np.isfinite(least).any() else {}
        return limits.replace(lower=lower, upper=upper, **known)

    def limit_axes(self, limits: JointLimits) -> JointLimits:
        """Return the limits of the axes that those of the joints imply."""
        ends = np.sort([self.spread(limits.lower), self.spread(limits.upper)], axis=0)
        names = ("velocity", "acceleration", "jerk")
        rates: dict[str, Any] = {
            name: None if (x := getattr(limits, name)) is None else x[self.joint] * np.abs(self.factor)
            for name in names
        }
        return JointLimits(*ends, **rates)
