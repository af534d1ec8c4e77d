"""Couplings between the motors and the axes of an arm, q = C m + c: of joints 2 and 3, or of a differential wrist."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from optik.arm.limits import JointLimits, freeze
from optik.check import check_words, real_array
from optik.errors import InvalidInput, RobotModelError
from optik.types import Array

WORST_CONDITION = 1e6
"""Largest condition number of a matrix of couplings."""


@dataclass(frozen=True, eq=False)
class Motors:
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
        matrix = freeze(real_array(self.matrix, "motors.matrix", f"{n} rows of {n} numbers"), "motors.matrix")
        if matrix.shape != (n, n) or not np.isfinite(matrix).all() or not np.linalg.cond(matrix) < WORST_CONDITION:
            raise InvalidInput(
                "motors.matrix", f"{matrix.tolist()}"[:120], f"an invertible matrix of {n} rows and columns"
            )
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
        return np.asarray((np.asarray(q, dtype=np.float64) - (0.0 if order else self.offset)) @ self.inverse.T)

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
        return np.asarray(np.asarray(m, dtype=np.float64) @ self.matrix.T + (0.0 if order else self.offset))

    @property
    def content(self) -> bytes:
        """The numbers and names, as bytes."""
        values = [getattr(self.limits, name) for name in LIMIT_FIELDS]
        arrays = (self.matrix, self.offset, self.inertia, self.viscous, self.coulomb, *values)
        return repr(self.names).encode() + b"".join(b"-" if x is None else x.tobytes() for x in arrays)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Motors) and self.content == other.content

    def __hash__(self) -> int:
        return hash(self.content)

    def limit_axes(self) -> JointLimits:
        """Return the limits of the axes: a box inside the motors' ranges, and the greatest rates that the motors permit.

        Returns
        -------
        JointLimits
            The box has the largest volume; the rates are reached by one axis alone.
        """
        own, E, C = self.limits, np.abs(self.inverse), np.abs(self.matrix)
        middle, half = self.axes(own.middle), _find_box(E, own.half)
        given = {name: getattr(own, name) for name in ("velocity", "acceleration", "jerk")}
        hull: dict[str, Any] = {name: None if x is None else _times(C, x) for name, x in given.items()}
        loads: dict[str, Any] = {
            name: None if (x := getattr(own, name)) is None else _times(E.T, x) for name in ("torque", "torque_rate")
        }
        return JointLimits(middle - half, middle + half, **(hull | loads))


LIMIT_FIELDS = ("lower", "upper", "velocity", "acceleration", "jerk", "torque", "torque_rate")
"""Fields of the motors' limits."""


def _times(matrix: Array, bound: Array) -> Array:
    """Return matrix @ bound, where 0 times infinity is 0."""
    return np.asarray(np.where(matrix > 0.0, matrix * np.where(matrix > 0.0, bound, 0.0), 0.0).sum(axis=1))


def _find_box(E: Array, half: Array) -> Array:
    """Return half the widths (n,) of the largest box of axes whose motors E h stay within half their ranges."""
    bounded = np.isfinite(half)
    if not bounded.any():
        return np.full(half.size, np.inf)
    E, half = E[bounded], half[bounded]
    free = ~(E > 0.0).any(axis=0)
    h = np.full(E.shape[1], float((half / E.sum(axis=1)).min()))
    found = scipy.optimize.minimize(
        lambda x: -float(np.log(x[~free]).sum()), h, jac=lambda x: np.where(free, 0.0, -1.0 / x), method="SLSQP",
        bounds=[(1e-6 * h[0], None)] * h.size, constraints={"type": "ineq", "fun": lambda x: half - E @ x, "jac": lambda x: -E},
    )  # fmt: skip
    inside = np.maximum(found.x, 0.0) if found.success else h
    inside *= min(1.0, float((half / (E @ inside)).min()))
    return np.where(free, np.inf, inside)


def refuse_motors(arm: Any, format: str) -> None:
    """Raise RobotModelError for an arm with motors that a format has no place for."""
    if arm.motors is not None:
        raise RobotModelError(
            arm.name, f"its motors {', '.join(arm.motors.names)} are coupled, for which {format} has no place"
        )


def maker_names(robot: Any) -> tuple[str, ...]:
    """Return the names of the maker's joints: the motors', or the robot's."""
    return tuple(robot.joint_names if robot.motors is None else robot.motors.names)


def maker_joints(robot: Any, q: ArrayLike, order: int = 0) -> Array:
    """Return the maker's joints (..., n) of configurations, or their derivatives: the motors, or the axes themselves."""
    return np.asarray(q if robot.motors is None else robot.motors.of(q, order))


def from_maker(robot: Any, m: ArrayLike, order: int = 0) -> Array:
    """Return the axes (..., n) of the maker's joints, or their derivatives."""
    return np.asarray(m if robot.motors is None else robot.motors.axes(m, order))


def with_motors(robot: Any, matrix: ArrayLike, offset: ArrayLike | None, names: Sequence[str] | None) -> Any:
    """Return the robot with motors, which take over its limits, rotor inertias and frictions."""
    n, inertia, limits = robot.n, robot.inertia, robot.limits
    known = tuple(f"motor{i + 1}" for i in range(n)) if names is None else names
    none: Any = np.zeros(n)
    moved = (none, none, none) if inertia is None else (inertia.motor, inertia.viscous, inertia.coulomb)
    given: Any = (matrix, none if offset is None else offset, known, limits, *moved)
    motors = Motors(*given)
    if inertia is not None:
        inertia = replace(inertia, motor=none, viscous=none, coulomb=none)
    return replace(robot, limits=motors.limit_axes(), inertia=inertia, motors=motors)
