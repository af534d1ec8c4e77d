"""Joint limits: position, and where known velocity, acceleration, jerk, torque and torque rate."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import pi
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from optik.check import check_count, real_array
from optik.errors import DegreesWarning, InvalidInput
from optik.types import Array, Flags

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

R = TypeVar("R", bound="DataclassInstance")
"""Type of a dataclass."""
DYNAMIC_LIMITS = ("velocity", "acceleration", "jerk", "torque", "torque_rate", "deceleration")
"""Fields of `JointLimits` that may be unknown."""
LIMIT_TOLERANCE = 1e-9
"""Slack of position limits [rad, m]: rounding errors are not limit violations."""

LARGEST_LIMIT = 1e5
"""Largest finite position limit [rad, m]: sines are accurate up to it, and no arm moves so far."""
DEGREES_FROM = 20.0 * pi
"""Position limit in a file [rad] from which degrees are suspected: ten turns."""


def freeze(value: ArrayLike, argument: str) -> Array:
    """Return a read-only copy as float64."""
    array = real_array(value, argument, "an array of numbers").copy()
    array.setflags(write=False)
    return array


class Frozen:
    """Base of dataclasses whose arrays are read-only, also in a copy by pickle."""

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, field.name) for field in fields(self))  # type: ignore[arg-type]


class ByContent(Frozen):
    """Base of records that are equal if their contents are."""

    @property
    def content(self) -> Any:
        """The numbers and names, as bytes."""
        raise NotImplementedError

    def __eq__(self, other: object) -> bool:
        return isinstance(other, type(self)) and self.content == other.content

    def __hash__(self) -> int:
        return hash(self.content)


def replace_fields(record: R, argument: str, values: Mapping[str, Any]) -> R:
    """Return a copy of a dataclass with some fields replaced."""
    known = [field.name for field in fields(record)]
    if unknown := [name for name in values if name not in known]:
        raise InvalidInput(argument, ", ".join(unknown), f"some of {', '.join(known)}")
    return replace(record, **values)


@dataclass(frozen=True, eq=False)
class VelocityByPosition(ByContent):
    """Velocity limits that fall towards the ends of the ranges: −offset + √(2 deceleration r) at a distance r from the end.

    Parameters
    ----------
    offset : (n,) array
        Offsets of the velocities [rad/s, m/s].
    deceleration : (n,) array
        Decelerations to the ends [rad/s², m/s²]; infinite for a joint without such a limit.

    Raises
    ------
    InvalidInput
        Different lengths, a deceleration that is not above 0, or an offset that is not a finite number ≥ 0.
    """

    offset: Array
    deceleration: Array

    def __post_init__(self) -> None:
        offset = freeze(self.offset, "velocity_by_position.offset")
        deceleration = check_positive(self.deceleration, offset.size, "velocity_by_position.deceleration")
        if offset.ndim != 1 or not (np.isfinite(offset) & (offset >= 0.0)).all():
            raise InvalidInput("velocity_by_position.offset", repr(self.offset)[:60], "a number ≥ 0 for each joint")
        object.__setattr__(self, "offset", offset)
        object.__setattr__(self, "deceleration", deceleration)

    @property
    def content(self) -> bytes:
        """The numbers, as bytes."""
        return self.offset.tobytes() + self.deceleration.tobytes()

    def to_plain(self) -> dict[str, Any]:
        """Return plain data for files, which `from_plain` reads back to the last bit.

        Returns
        -------
        dict
            Lists of numbers by name.
        """
        return {
            "offset": self.offset.tolist(),
            "deceleration": [x if np.isfinite(x) else str(x) for x in self.deceleration.tolist()],
        }

    @classmethod
    def from_plain(cls, data: Any, where: str = "velocity_by_position") -> VelocityByPosition:
        """Return the record from the data of `to_plain`.

        Parameters
        ----------
        data : mapping
            Lists of numbers by name.
        where : str
            Its name in errors.

        Returns
        -------
        VelocityByPosition

        Raises
        ------
        InvalidInput
            Other data.
        """
        if not isinstance(data, Mapping) or set(data) != {"offset", "deceleration"}:
            raise InvalidInput(where, repr(data)[:60], "a mapping with offset and deceleration")
        try:
            offset, deceleration = (
                [float(x) for x in np.atleast_1d(data[name])] for name in ("offset", "deceleration")
            )
        except (TypeError, ValueError):
            raise InvalidInput(where, repr(data)[:60], "offset and deceleration, a number for each joint") from None
        return cls(np.array(offset), np.array(deceleration))


@dataclass(frozen=True, eq=False)
class JointLimits(Frozen):
    """Limits of the joints: position, and optionally velocity, acceleration, jerk, torque and torque rate.

    Parameters
    ----------
    lower, upper : (n,) array
        Position limits [rad, or m for prismatic joints]; equal values lock a joint, infinite ones leave it free.
    velocity, acceleration, jerk : scalar or (n,) array, optional
        Symmetric limits [rad/s, rad/s², rad/s³, or metres]; None where unknown.
    torque, torque_rate : scalar or (n,) array, optional
        Symmetric limits of the joints' torques [N·m, N] and of their rates in time [N·m/s, N/s]; None where unknown,
        infinite for a joint whose limit is unknown.
    deceleration : scalar or (n,) array, optional
        Symmetric limits of the decelerations [rad/s², m/s²] where they differ from the accelerations.
    velocity_by_position : VelocityByPosition, optional
        Velocity limits near the ends of the ranges.

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
    torque: Array | None = None
    torque_rate: Array | None = None
    deceleration: Array | None = None
    velocity_by_position: VelocityByPosition | None = None

    def __post_init__(self) -> None:
        lower, upper = freeze(self.lower, "limits.lower"), freeze(self.upper, "limits.upper")
        if lower.ndim != 1 or lower.shape != upper.shape or lower.size == 0:
            got = f"shapes {lower.shape} and {upper.shape}"
            raise InvalidInput("limits", got, "lower and upper of one length n ≥ 1")
        if np.isnan(lower).any() or np.isnan(upper).any():
            raise InvalidInput("limits", "NaN", "numbers (infinity for a joint without a limit)")
        if (lower == np.inf).any() or (upper == -np.inf).any():
            got = "a lower limit of +∞ or an upper one of −∞"
            raise InvalidInput("limits", got, "limits that a joint value can satisfy")
        for i in np.flatnonzero(lower > upper)[:1]:
            got = f"lower {lower[i]:.6g} above upper {upper[i]:.6g} at joint {i + 1}"
            raise InvalidInput("limits", got, "lower ≤ upper")
        far = np.isfinite(lower) & (lower < -LARGEST_LIMIT) | np.isfinite(upper) & (upper > LARGEST_LIMIT)
        for i in np.flatnonzero(far)[:1]:
            most = f"at most {LARGEST_LIMIT:g} rad or m"
            expected = f"{most}; infinity for a joint without a limit (type continuous in a URDF)"
            raise InvalidInput("limits", f"{lower[i]:.6g} to {upper[i]:.6g} at joint {i + 1}", expected)
        by_position = self.velocity_by_position
        if by_position is not None and not (
            isinstance(by_position, VelocityByPosition) and by_position.offset.size == lower.size
        ):
            expected = f"a VelocityByPosition of {lower.size} joints"
            raise InvalidInput("limits.velocity_by_position", repr(by_position)[:60], expected)
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", upper)
        for field in DYNAMIC_LIMITS:
            value = getattr(self, field)
            if value is not None:
                object.__setattr__(self, field, check_positive(value, lower.size, field))

    @cached_property
    def middle(self) -> Array:
        """Middle (n,) of the position range [rad, m]; the value nearest to zero where a limit is infinite."""
        with np.errstate(invalid="ignore"):  # −∞ + ∞ is not used
            halfway = 0.5 * self.lower + 0.5 * self.upper
        return freeze(np.where(np.isfinite(self.half), halfway, self.clip(np.zeros(self.lower.size))), "middle")

    @cached_property
    def half(self) -> Array:
        """Half (n,) of the position range [rad, m], 0 for a locked joint, infinite where a limit is infinite."""
        return freeze(0.5 * self.upper - 0.5 * self.lower, "half")

    @cached_property
    def bounded(self) -> Flags:
        """Joints (n,) with two different finite limits."""
        flags = np.isfinite(self.half) & (self.half > 0.0)
        flags.setflags(write=False)
        return flags

    def contains(self, q: ArrayLike) -> Flags:
        """Return whether configurations satisfy the position limits, within 1e-9.

        Parameters
        ----------
        q : (n,) or (..., n) array
            Configurations [rad, m].

        Returns
        -------
        scalar or (...,) array of bool
            False for NaN.
        """
        q = self._read(q)
        inside = (q >= self.lower - LIMIT_TOLERANCE) & (q <= self.upper + LIMIT_TOLERANCE)
        return np.asarray(inside.all(axis=-1))

    def clip(self, q: ArrayLike) -> Array:
        """Clamp configurations to the position limits.

        Parameters
        ----------
        q : (n,) or (..., n) array
            Configurations [rad, m].

        Returns
        -------
        (n,) or (..., n) array
            The nearest configurations inside [rad, m].
        """
        return np.clip(self._read(q), self.lower, self.upper)

    def _read(self, q: ArrayLike) -> Array:
        """Return configurations (..., n) as an array."""
        return real_array(q, "q", f"configurations of {self.lower.size} joints", (..., self.lower.size))

    def normalise(self, q: ArrayLike) -> Array:
        """Return positions relative to the range, (q − middle) / half: 0 in the middle, −1 and 1 at the limits.

        Parameters
        ----------
        q : (n,) or (..., n) array
            Configurations [rad, m].

        Returns
        -------
        (n,) or (..., n) array
            Positions [1]; 0 for a joint that is locked or has an infinite limit.
        """
        offset = np.asarray(q, dtype=np.float64) - self.middle
        return np.asarray(np.where(self.bounded, offset, 0.0) / np.where(self.bounded, self.half, 1.0))

    def sample(
        self, rng: np.random.Generator, count: int, *, margin: float = 0.0, half_if_infinite: ArrayLike = pi
    ) -> Array:
        """Sample configurations uniformly inside the position limits.

        A joint with one infinite limit is sampled next to the finite one, a joint with two around zero. The values are one
        call of ``rng.uniform(low, high, (count, n))``.

        Parameters
        ----------
        rng : numpy.random.Generator
            Source of the random numbers.
        count : int
            Number of configurations.
        margin : float
            Least distance from every limit [rad, m].
        half_if_infinite : scalar or (n,) array
            Half the width of the sampled range where a limit is infinite [rad, m]; π by default, a whole turn.

        Returns
        -------
        (count, n) array
            Configurations [rad, m].

        Raises
        ------
        InvalidInput
            A count below 0, or a margin above half of a joint's range.
        """
        check_count(count, "count", 0)
        width = 2.0 * np.asarray(half_if_infinite, dtype=np.float64)
        free = np.where(np.isfinite(self.upper), self.upper - width, -width / 2)
        low = np.where(np.isfinite(self.lower), self.lower, free)
        high = np.where(np.isfinite(self.upper), self.upper, low + width)
        low, high = low + margin, high - margin
        if (low > high).any():
            least = 0.5 * (high - low).min() + margin
            raise InvalidInput("margin", f"{margin:.6g}", f"at most half of every range, {least:.6g}")
        return rng.uniform(low, high, (count, self.lower.size))

    def replace(self, **limits: ArrayLike | None) -> JointLimits:
        """Return a copy with some limits replaced.

        Parameters
        ----------
        **limits
            lower and upper, (n,) arrays [rad, m]; velocity, acceleration, jerk, torque and torque_rate, scalars or (n,)
            arrays [rad/s, rad/s², rad/s³, N·m, N·m/s, or metres]; None where unknown.

        Returns
        -------
        JointLimits

        Raises
        ------
        InvalidInput
            A limit that does not exist, or values that `JointLimits` refuses.
        """
        return replace_fields(self, "limits", limits)


FAR_OUTSIDE = np.pi
"""Excess over a range [rad] above which degrees are suspected, because no encoder is off by half a turn."""
NEARLY_INSIDE = 0.1
"""Excess over a range [rad] of degrees that are meant."""


def warn_of_degrees(
    robot: str, names: Sequence[str], ranges: tuple[Array, Array], turns: Sequence[bool], *, stacklevel: int
) -> None:
    """Warn of position limits (n,), (n,) of a file [rad, m] that seem to be degrees; infinite ones are none."""
    size = np.abs(np.where(np.isfinite(ranges), ranges, 0.0)).max(axis=0) * np.asarray(turns)
    if (far := np.flatnonzero(size >= DEGREES_FROM)).size:
        found = ", ".join(f"{names[i]!r} ({size[i]:.6g})" for i in far.tolist())
        problem = f"position limits of ten turns and more are read as radians, at joint {found}; were degrees meant?"
        warnings.warn(DegreesWarning(robot, problem), stacklevel=stacklevel)


def ask_for_degrees(limits: JointLimits, turns: Flags, q: Array) -> str:
    """Return "are these degrees?" for angles (..., n) [rad] far outside their ranges that would be inside in degrees, or ""."""
    excess, other = (np.maximum(limits.lower - x, x - limits.upper)[..., turns] for x in (q, np.deg2rad(q)))
    return "are these degrees?" if (excess > FAR_OUTSIDE).any() and (other <= NEARLY_INSIDE).all() else ""


def check_positive(value: ArrayLike, n: int, argument: str) -> Array:
    """Check a positive limit; return it as a read-only array (n,)."""
    array = real_array(value, argument, f"a positive number{f' or {n} of them' if n > 1 else ''}")
    if array.ndim == 0:
        array = np.full(n, float(array))
    if array.shape != (n,):
        raise InvalidInput(argument, f"shape {array.shape}", f"a positive number or {n} of them")
    if not (array > 0.0).all():
        raise InvalidInput(argument, np.array2string(array, precision=6), "limits above 0")
    return freeze(array, argument)
