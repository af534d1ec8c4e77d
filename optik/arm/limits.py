"""Limits of joints: position always, velocity, acceleration and jerk where known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optik.check import real_array
from optik.errors import InvalidInput
from optik.types import Array

LIMIT_TOLERANCE = 1e-9
"""How far past a position limit a joint may stand and still count as inside [rad or m]: rounding, not room."""


def frozen(value: ArrayLike, argument: str) -> Array:
    """Return a read-only copy as float64."""
    array = real_array(value, argument, "an array of numbers").copy()
    array.setflags(write=False)
    return array


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of every joint; position always, the rest where known.

    Parameters
    ----------
    lower, upper : (n,) array
        Position limits [rad, or m for prismatic joints]; equal values lock a joint, infinite ones leave it free.
    velocity, acceleration, jerk : scalar or (n,) array, optional
        Symmetric limits [rad/s, rad/s², rad/s³, or metres].

    Raises
    ------
    InvalidInput
        NaN, lower above upper, wrong lengths, or a dynamic limit that is not positive.
    """

    lower: Array
    upper: Array
    velocity: Array | None = None
    acceleration: Array | None = None
    jerk: Array | None = None

    def __post_init__(self) -> None:
        lower, upper = frozen(self.lower, "limits.lower"), frozen(self.upper, "limits.upper")
        if lower.ndim != 1 or lower.shape != upper.shape or lower.size == 0:
            raise InvalidInput(
                "limits", f"shapes {lower.shape} and {upper.shape}", "lower and upper of one length n ≥ 1"
            )
        if np.isnan(lower).any() or np.isnan(upper).any():
            raise InvalidInput("limits", "NaN", "numbers (infinity where a joint is free)")
        if (lower == np.inf).any() or (upper == -np.inf).any():
            raise InvalidInput(
                "limits", "a lower limit of +∞ or an upper one of −∞", "limits that some joint value meets"
            )
        if (lower > upper).any():
            i = int(np.argmax(lower > upper))
            raise InvalidInput(
                "limits", f"lower {lower[i]:.6g} above upper {upper[i]:.6g} at joint {i + 1}", "lower ≤ upper"
            )
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", upper)
        for field in ("velocity", "acceleration", "jerk"):
            value = getattr(self, field)
            if value is not None:
                object.__setattr__(self, field, positive(value, lower.size, field))

    def __reduce__(self) -> tuple[Any, ...]:
        return JointLimits, (self.lower, self.upper, self.velocity, self.acceleration, self.jerk)

    def contains(self, q: ArrayLike) -> NDArray[np.bool_]:
        """Whether configurations (..., n) stand inside, within 1e-9."""
        q = np.asarray(q, dtype=np.float64)
        inside = (q >= self.lower - LIMIT_TOLERANCE) & (q <= self.upper + LIMIT_TOLERANCE)
        return np.asarray(inside.all(axis=-1))

    def clip(self, q: ArrayLike) -> Array:
        """Nearest configurations inside."""
        return np.clip(np.asarray(q, dtype=np.float64), self.lower, self.upper)


def positive(value: ArrayLike, n: int, argument: str) -> Array:
    """Return a limit as a read-only (n,) array.

    Raises
    ------
    InvalidInput
        Not a scalar or (n,), or not above zero (infinity is allowed).
    """
    array = real_array(value, argument, f"a positive number or {n} of them")
    if array.ndim == 0:
        array = np.full(n, float(array))
    if array.shape != (n,):
        raise InvalidInput(argument, f"shape {array.shape}", f"a positive number or {n} of them")
    if not (array > 0.0).all():
        raise InvalidInput(argument, np.array2string(array, precision=6), "limits above 0")
    return frozen(array, argument)
