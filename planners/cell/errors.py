"""Where an error of the tool comes from: laser, inverse kinematics, path and servo, as vectors that add up to the whole."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import real_array
from optik.errors import InvalidInput
from optik.types import Array


class ErrorSplit(NamedTuple):
    """Executed tool minus true spot, e = e_laser + e_ik + e_path + e_servo, at one instant or at many, in the base frame.

    Attributes
    ----------
    laser : (3,) or (k, 3) array
        Target minus true spot: noise and calibration of the laser unit [m].
    ik : (3,) or (k, 3) array
        Tool at the IK method's own answer, before any polishing, minus target [m].
    path : (3,) or (k, 3) array
        Tool at the planned configuration minus tool at the IK method's answer [m].
    servo : (3,) or (k, 3) array
        Tool at the executed configuration minus tool at the planned one [m].
    total : (3,) or (k, 3) array
        Executed tool minus true spot [m]: the sum, to rounding.
    """

    laser: Array
    ik: Array
    path: Array
    servo: Array
    total: Array

    @property
    def norms(self) -> dict[str, Array]:
        """Lengths of the five vectors by name [m]."""
        return {name: np.linalg.norm(part, axis=-1) for name, part in self._asdict().items()}

    def at(self, k: int) -> Self:
        """Return the split at one of many instants.

        Parameters
        ----------
        k : int
            Number of the instant.

        Returns
        -------
        ErrorSplit
            Its vectors (3,) [m].
        """
        return type(self)(*(part[k] for part in self))

    def to_dict(self) -> dict[str, list[float]]:
        """Plain data for files: the vectors by name [m]."""
        return {name: part.tolist() for name, part in self._asdict().items()}


def split_errors(
    spot: ArrayLike, target: ArrayLike, answer: ArrayLike, planned: ArrayLike, executed: ArrayLike
) -> ErrorSplit:
    """Split the tool's error by points, at one instant or at many.

    Parameters
    ----------
    spot : (3,) or (k, 3) array
        Where the spot truly is, or the point of the line to it that belongs to the instant [m].
    target : (3,) or (k, 3) array
        Where the laser unit says that it is [m].
    answer : (3,) or (k, 3) array
        Tool at the configuration that the IK method returned [m].
    planned : (3,) or (k, 3) array
        Tool at the planned configuration of the instant [m].
    executed : (3,) or (k, 3) array
        Tool at the configuration that the arm really had then [m].

    Returns
    -------
    ErrorSplit
        Its parts, in the shape to which the points broadcast.

    Raises
    ------
    InvalidInput
        No points, or NaN or infinity in them.
    """
    given = {"spot": spot, "target": target, "answer": answer, "planned": planned, "executed": executed}
    points = [_points(value, name) for name, value in given.items()]
    try:
        a, b, c, d, e = np.broadcast_arrays(*points)
    except ValueError:
        got = ", ".join(f"{name} {p.shape}" for name, p in zip(given, points, strict=True))
        raise InvalidInput(
            "spot, target, answer, planned, executed", f"shapes {got}", "shapes that broadcast"
        ) from None
    return ErrorSplit(b - a, c - b, d - c, e - d, e - a)


def split_configurations(
    robot: Robot, spot: ArrayLike, target: ArrayLike, answer: ArrayLike, planned: ArrayLike, executed: ArrayLike
) -> ErrorSplit:
    """Split the tool's error by configurations: `split_errors` of the tool's positions at them.

    Parameters
    ----------
    robot : Robot
        The arm.
    spot, target : (3,) or (k, 3) array
        Where the spot truly is, and where the laser unit says that it is [m].
    answer, planned, executed : (n,) or (k, n) array
        The IK method's own answer, the planned and the executed configuration [rad, m].

    Returns
    -------
    ErrorSplit
        Its parts.

    Raises
    ------
    InvalidInput
        Wrong shapes, NaN or infinity.
    """
    tools = (robot.fk(q)[..., :3, 3] for q in (answer, planned, executed))
    return split_errors(spot, target, *tools)


def _points(value: ArrayLike, name: str) -> Array:
    """Points as an array, checked."""
    points = real_array(value, name, "a point (3,) or points (k, 3)")
    if points.ndim not in (1, 2) or points.shape[-1] != 3:
        raise InvalidInput(name, f"shape {points.shape}", "a point (3,) or points (k, 3)")
    if not np.isfinite(points).all():
        raise InvalidInput(name, "NaN or infinity in it", "finite numbers")
    return points
