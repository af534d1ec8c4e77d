"""Couplings between the motors and the axes of an arm, q = C m + c: of joints 2 and 3, or of a differential wrist."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import LIMIT_TOLERANCE, ByContent, JointLimits, freeze
from optik.check import check_words, real_array
from optik.errors import InvalidInput, RobotModelError
from optik.types import Array, Flags, Indices

WORST_CONDITION = 1e6
"""Largest condition number of a matrix of couplings."""


@dataclass(frozen=True, eq=False)
class Motors(ByContent):
    """Motors that move the axes together: axes q = matrix m + offset. The maker's joints are the motors.

    Parameters
    ----------
    matrix : (n, n) array
        Axes over motors [1].
    offset : (n,) array
        Axes with all motors at 0 [rad, m].
    names : tuple of str
        Names of the motors.
    limits : JointLimits
        Ranges and limits of the motors.
    inertia, viscous, coulomb : (n,) array
        Inertia of the rotors [kg·m²], viscous [N·m·s/rad] and Coulomb friction [N·m], all at the motors.

    Raises
    ------
    InvalidInput
        A singular matrix, or wrong lengths.
    """

    matrix: Array
    offset: Array
    names: tuple[str, ...]
    limits: JointLimits
    inertia: Array
    viscous: Array
    coulomb: Array

    def __post_init__(self) -> None:
        n = self.limits.lower.size
        for name in ("deceleration", "velocity_by_position"):
            if getattr(self.limits, name) is not None:
                expected = f"none, because it limits axes: call with_motors first, then with_limits({name}=...)"
                raise InvalidInput("motors.limits", name, expected)
        matrix = freeze(real_array(self.matrix, "motors.matrix", f"{n} rows of {n} numbers"), "motors.matrix")
        if matrix.shape != (n, n) or not np.isfinite(matrix).all() or not np.linalg.cond(matrix) < WORST_CONDITION:
            expected = f"an invertible matrix of {n} rows and columns"
            raise InvalidInput("motors.matrix", f"{matrix.tolist()}"[:120], expected)
        names = check_words(self.names, "motors.names")
        if len(names) != n or len(set(names)) != n:
            raise InvalidInput("motors.names", ", ".join(names), f"{n} different names")
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "names", names)
        for field in ("offset", "inertia", "viscous", "coulomb"):
            given = freeze(getattr(self, field), f"motors.{field}")
            if given.shape != (n,) or not np.isfinite(given).all():
                raise InvalidInput(f"motors.{field}", repr(getattr(self, field))[:60], f"{n} numbers")
            object.__setattr__(self, field, given)

    @property
    def inverse(self) -> Array:
        """Motors over axes (n, n) [1]."""
        return np.asarray(np.linalg.inv(self.matrix))

    def of(self, q: ArrayLike, order: int = 0) -> Array:
        """Return the motors of configurations, or their derivatives.

        Parameters
        ----------
        q : (..., n) array
            Axes [rad, m], or one of their derivatives.
        order : int
            0 for positions.

        Returns
        -------
        (..., n) array
            Motors [rad, m], or their derivatives.
        """
        return np.asarray((self._read(q, "q") - (0.0 if order else self.offset)) @ self.inverse.T)

    def axes(self, m: ArrayLike, order: int = 0) -> Array:
        """Return the axes of motor positions, or their derivatives.

        Parameters
        ----------
        m : (..., n) array
            Motors [rad, m], or one of their derivatives.
        order : int
            0 for positions.

        Returns
        -------
        (..., n) array
            Axes [rad, m], or their derivatives.
        """
        return np.asarray(self._read(m, "m") @ self.matrix.T + (0.0 if order else self.offset))

    def _read(self, values: ArrayLike, argument: str) -> Array:
        """Return values (..., n) as an array."""
        n = len(self.names)
        return real_array(values, argument, f"values of {n} joints", (..., n))

    @property
    def content(self) -> bytes:
        """The numbers and names, as bytes."""
        values = [getattr(self.limits, name) for name in LIMIT_FIELDS]
        arrays = (self.matrix, self.offset, self.inertia, self.viscous, self.coulomb, *values)
        return repr(self.names).encode() + b"".join(b"-" if x is None else x.tobytes() for x in arrays)

    def limit_axes(self) -> AxisLimits:
        """Return the limits of the axes: the ranges and the greatest rates that the motors permit, of each axis alone.

        Returns
        -------
        AxisLimits
            A configuration is inside if all motors are inside their ranges.
        """
        own, E, C = self.limits, np.abs(self.inverse), np.abs(self.matrix)
        middle, half = self.axes(own.middle), _times(C, own.half)
        given = {name: getattr(own, name) for name in ("velocity", "acceleration", "jerk")}
        hull: dict[str, Any] = {name: None if x is None else _times(C, x) for name, x in given.items()}
        loads: dict[str, Any] = {
            name: None if (x := getattr(own, name)) is None else _times(E.T, x) for name in ("torque", "torque_rate")
        }
        return AxisLimits(middle - half, middle + half, **(hull | loads), motors=self)


@dataclass(frozen=True, eq=False)
class AxisLimits(JointLimits):
    """Limits of axes that motors move together: those of each axis alone, and the ranges of the motors.

    Parameters
    ----------
    motors : Motors
        The motors, which must be inside their ranges, too.
    """

    motors: Motors | None = None

    @property
    def _own(self) -> Motors:
        assert self.motors is not None
        return self.motors

    @cached_property
    def narrower(self) -> Indices:
        """Indices of the axes whose own ranges are narrower than those that the motors imply."""
        hull = self._own.limit_axes()
        return np.flatnonzero((self.lower > hull.lower) | (self.upper < hull.upper))

    @cached_property
    def middle(self) -> Array:
        """Axes (n,) with the motors in the middle of their ranges, or inside the ranges of axes and motors [rad, m]."""
        centre = self._own.axes(self._own.limits.middle)
        return freeze(self._find_inside(centre) if self.narrower.size else super().clip(centre), "middle")

    def _find_inside(self, q: Array) -> Array:
        """Return axes inside all ranges, as far from their ends as projections onto each range in turn find them."""
        motors, n = self._own, self.lower.size
        rows, offset = np.concatenate([np.eye(n), motors.inverse]), np.append(np.zeros(n), motors.of(np.zeros(n)))
        low, high = (np.append(getattr(self, end), getattr(motors.limits, end)) for end in ("lower", "upper"))
        half = np.where(np.isfinite(high - low), 0.5 * (high - low), 1.0)
        for away in (0.5, 0.2, 0.1, 0.03, 0.01, 0.001, 0.0):
            for _ in range(MOST_SWEEPS):
                for row, zero, a, b in zip(rows, offset, low + away * half, high - away * half, strict=True):
                    x = row @ q + zero
                    q = q + row * (np.clip(x, a, b) - x) / (row @ row)
                x = rows @ q + offset
                if (np.minimum(x - low, high - x) >= 0.9 * away * half - LIMIT_TOLERANCE).all():
                    return q
        expected = "ranges of axes with a configuration inside those of the motors"
        raise InvalidInput("limits", "none", expected)

    def contains(self, q: ArrayLike) -> Flags:
        """Return whether configurations satisfy the position limits of axes and motors, within 1e-9."""
        return super().contains(q) & self._own.limits.contains(self._own.of(q))

    def clip(self, q: ArrayLike) -> Array:
        """Return the configurations inside that are nearest on the straight way to the middle."""
        motors, to = self._own, super().clip(q)
        m, centre = motors.of(to), motors.of(self.middle)
        room = np.where(m > centre, motors.limits.upper, motors.limits.lower) - centre
        with np.errstate(divide="ignore", invalid="ignore"):
            part = np.where(m == centre, 1.0, np.fmin(room / (m - centre), 1.0)).min(axis=-1, keepdims=True)
        return np.asarray(np.where(part < 1.0, self.middle + part * (to - self.middle), to))

    def sample(
        self, rng: np.random.Generator, count: int, *, margin: float = 0.0, half_if_infinite: ArrayLike = np.pi
    ) -> Array:
        """Sample motors uniformly inside their ranges; return the axes (count, n)."""
        q, out = np.empty((count, self.lower.size)), np.ones(count, np.bool_)
        for _ in range(MOST_SWEEPS):
            drawn = self._own.limits.sample(rng, count, margin=margin, half_if_infinite=half_if_infinite)
            q[out] = self._own.axes(drawn)[out]
            out = ~self.contains(q)
            if not (self.narrower.size and out.any()):
                break
        return self.clip(q)


MOST_SWEEPS = 200
"""Most sweeps of a search for configurations inside ranges of axes and motors."""
LIMIT_FIELDS = ("lower", "upper", "velocity", "acceleration", "jerk", "torque", "torque_rate")
"""Fields of the motors' limits."""


def _times(matrix: Array, bound: Array) -> Array:
    """Return matrix @ bound, where 0 times infinity is 0."""
    return np.asarray(np.where(matrix > 0.0, matrix * np.where(matrix > 0.0, bound, 0.0), 0.0).sum(axis=1))


def couple(limits: JointLimits, motors: Motors | None) -> JointLimits:
    """Return the limits of axes that motors move together, or plain ones without motors."""
    given = {field.name: getattr(limits, field.name) for field in fields(JointLimits)}
    if motors is None:
        return JointLimits(**given)
    implied = motors.limit_axes()
    given["lower"], given["upper"] = np.maximum(limits.lower, implied.lower), np.minimum(limits.upper, implied.upper)
    coupled = AxisLimits(**given, motors=motors)
    _ = coupled.middle  # refuses ranges without a common configuration
    return coupled


class Ranges(NamedTuple):
    """What has a range: names, ends (k,), axis (of a motor the one of its place), and rows (k, n) and offsets over the axes.

    These are the motors, and the axes with narrower ranges than the motors imply; without motors the joints.
    """

    names: tuple[str, ...]
    lower: Array
    upper: Array
    axis: Indices
    rows: Array
    offset: Array

    def values(self, q: Array, order: int = 0) -> Array:
        """Return the values (..., k) of configurations (..., n), or their derivatives."""
        return q if len(self.rows) == 0 else q @ self.rows.T + (0.0 if order else self.offset)

    def find(self, axis: int) -> int:
        """Return the entry of an axis: its own, or that of the motor of its place."""
        return int(np.flatnonzero(self.axis == axis)[-1])


def ranges_of(robot: Any) -> Ranges:
    """Return what has a range."""
    limits, own, every = robot.limits, robot.motors, np.arange(robot.n)
    if own is None:
        return Ranges(robot.joint_names, limits.lower, limits.upper, every, np.empty((0, robot.n)), np.empty(0))
    which = limits.narrower
    return Ranges(
        (*own.names, *(robot.joint_names[i] for i in which)),
        np.append(own.limits.lower, limits.lower[which]),
        np.append(own.limits.upper, limits.upper[which]),
        np.append(every, which),
        np.concatenate([own.inverse, np.eye(robot.n)[which]]),
        np.append(own.of(np.zeros(robot.n)), np.zeros(which.size)),
    )


def find_outside(robot: Any, q: Array) -> tuple[str, float, float, float, int]:
    """Return the joint, or the motor, that is farthest outside its range: its name, value, range and index."""
    limits, names = robot.limits, robot.joint_names
    if robot.motors is not None and JointLimits.contains(limits, q):
        limits, names, q = robot.motors.limits, robot.motors.names, robot.motors.of(q)
    i = int(np.argmax(np.maximum(limits.lower - q, q - limits.upper)))
    return names[i], float(q[i]), float(limits.lower[i]), float(limits.upper[i]), i


def refuse_motors(arm: Any, format: str) -> None:
    """Raise RobotModelError for an arm with motors, which a format cannot describe."""
    if arm.motors is not None:
        names = ", ".join(arm.motors.names)
        raise RobotModelError(arm.name, f"its motors {names} are coupled, which {format} cannot describe")


def have_same_matrix(one: Motors | None, other: Motors | None) -> bool:
    """Return whether two arms have motors with the same names, matrix and offsets, or none."""
    first, second = (m and (m.names, m.matrix.tolist(), m.offset.tolist()) for m in (one, other))
    return first == second


def maker_names(robot: Any) -> tuple[str, ...]:
    """Return the names of the maker's joints: the motors', or the robot's."""
    return tuple(robot.joint_names if robot.motors is None else robot.motors.names)


def maker_limits(robot: Any) -> JointLimits:
    """Return the limits of the maker's joints: the motors', or the robot's."""
    limits: JointLimits = robot.limits if robot.motors is None else robot.motors.limits
    return limits


def maker_joints(robot: Any, q: ArrayLike, order: int = 0) -> Array:
    """Return the maker's joints (..., n) of configurations, or their derivatives: the motors, or the axes themselves."""
    return np.asarray(q if robot.motors is None else robot.motors.of(q, order))


def from_maker(robot: Any, m: ArrayLike, order: int = 0) -> Array:
    """Return the axes (..., n) of the maker's joints, or their derivatives."""
    return np.asarray(m if robot.motors is None else robot.motors.axes(m, order))


def with_motors(robot: Any, matrix: ArrayLike, offset: ArrayLike | None, names: Sequence[str] | None) -> Any:
    """Return the robot with motors, which take over its limits, rotor inertias and frictions."""
    n, inertia, limits = robot.n, robot.inertia, robot.limits
    if robot.linkage is not None:
        raise InvalidInput("robot", f"{robot.name}, a linkage", "an arm whose axes are its joints, for coupled motors")
    known = tuple(f"motor{i + 1}" for i in range(n)) if names is None else names
    none: Any = np.zeros(n)
    moved = (none, none, none) if inertia is None else (inertia.motor, inertia.viscous, inertia.coulomb)
    given: Any = (matrix, none if offset is None else offset, known, limits, *moved)
    motors = Motors(*given)
    if inertia is not None:
        inertia = replace(inertia, motor=none, viscous=none, coulomb=none)
    return replace(robot, limits=motors.limit_axes(), inertia=inertia, motors=motors)
