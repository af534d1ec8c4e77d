"""Limits that are frozen records, such as the friction and the force of a grip."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields
from typing import Any, ClassVar, Self

import numpy as np

from optik.arm.plain import read_record
from optik.check import check_number, finite_array
from optik.errors import InvalidInput
from optik.types import Array, Flags
from planners.limits.base import Limit
from planners.limits.inputs import LimitedMotion

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
"""Names of axes of the tool's frame; a minus sign in front of one turns it."""


class Record:
    """Base of frozen dataclasses of numbers and tuples of numbers; each field's metadata has its ``unit``."""

    def to_plain(self) -> dict[str, Any]:
        """Return plain data for files, without what is not given; infinity as a string."""
        given = {name: value for name, value in asdict(self).items() if value is not None}  # type: ignore[call-overload]
        return {name: _to_plain(value) for name, value in given.items()}

    @classmethod
    def from_plain(cls, data: Any, where: str) -> Self:
        """Return the record from the data of `to_plain`, or from its first field alone."""
        known = {field.name: field.default is MISSING for field in fields(cls)}  # type: ignore[arg-type]
        if isinstance(data, int | float):
            data = {next(iter(known)): data}
        required = tuple(name for name, needed in known.items() if needed)
        optional = tuple(name for name, needed in known.items() if not needed)
        given = read_record(data, required, where, optional=optional)
        return cls(**{name: _from_plain(value) for name, value in given.items()})


def _to_plain(value: Any) -> Any:
    """Return a value for a file: lists, and infinity as a string."""
    if isinstance(value, tuple):
        return [*map(_to_plain, value)]
    return str(value) if isinstance(value, float) and np.isinf(value) else value


def _from_plain(value: Any) -> Any:
    """Return a value of a file, with infinity as a number."""
    if isinstance(value, list):
        return [_from_plain(x) for x in value]
    return np.inf if isinstance(value, str) and value == "inf" else value


def check_vector(value: Any, argument: str) -> tuple[float, float, float]:
    """Return three finite numbers as a tuple."""
    return tuple(finite_array(value, argument, "three finite numbers", (3,)).tolist())


def check_axis(value: Any, argument: str) -> tuple[float, float, float]:
    """Return a unit vector in the tool's frame, given as a vector or by a name such as ``"-z"``."""
    if isinstance(value, str):
        if value.removeprefix("-") not in AXES:
            raise InvalidInput(argument, repr(value)[:60], "x, y, z, -x, -y, -z, or three numbers")
        value = np.multiply(-1.0 if value.startswith("-") else 1.0, AXES[value.removeprefix("-")])
    vector = np.array(check_vector(value, argument))
    if not (length := float(np.linalg.norm(vector))) > 0.0:
        raise InvalidInput(argument, repr(value)[:60], "an axis of a length above 0")
    return tuple(((vector if abs(length - 1.0) < 1e-12 else vector / length) + 0.0).tolist())


def check_place(record: Any, name: str) -> None:
    """Check and normalise the axis and the centre of mass of a record."""
    object.__setattr__(record, "axis", check_axis(record.axis, f"{name}.axis"))
    if record.com is not None:
        object.__setattr__(record, "com", check_vector(record.com, f"{name}.com"))


def check_optional(value: Any, argument: str, unit: str, *, least: float = 0.0) -> float | None:
    """Return a number above `least`, or None."""
    return None if value is None else check_number(value, argument, f"a number above {least:g} [{unit}]", above=least)


class RecordLimit(Limit):
    """Base of a kind whose limit is a frozen record.

    The methods of `Limit` take the record as their limit.

    Attributes
    ----------
    record : type
        Class of the limit, with ``to_plain`` and ``from_plain``.
    """

    record: ClassVar[Any]
    subject: ClassVar[str | None] = "tool"

    def check(self, value: Any) -> Any:
        """Return the record; a mapping has its fields, and a number is its first field."""
        if isinstance(value, self.record):
            return value
        if not isinstance(value, Mapping | int | float) or isinstance(value, bool):
            raise InvalidInput(self.name, repr(value)[:60], f"a {self.record.__name__}, its fields, or a number")
        return self.record.from_plain(dict(value) if isinstance(value, Mapping) else value, self.name)

    def array(self, value: Any, n: int) -> Any:
        """Return the record itself."""
        return value

    def is_given(self, limit: Any) -> bool:
        """Return whether there is a record."""
        return limit is not None

    def to_plain(self, value: Any) -> Any:
        """Return the record as plain data."""
        return None if value is None else value.to_plain()

    def from_plain(self, data: Any, n: int) -> Any:
        """Return the record from plain data."""
        return None if data is None else self.record.from_plain(data, f"limits.{self.name}")


class SampledLimit(RecordLimit):
    """Base of a kind of limit whose ratios are sampled for the law and proved by `judge`."""

    @abstractmethod
    def sample_ratios(self, motion: LimitedMotion, limit: Any, c: float = 1.0) -> Array:
        """Return the ratios (m, k, r) of a motion stretched by c at sampled instants; at rest for an infinite c."""

    def piece_ratios(self, motion: LimitedMotion, limit: Any) -> Array:
        """Return the ratios on each piece of a motion, sampled."""
        return np.asarray(self.sample_ratios(motion, limit).max(axis=1))

    def excess(self, motion: LimitedMotion, limit: Any) -> Array:
        """Return the dynamic share of each row."""
        return dynamic_share(self.sample_ratios(motion, limit), self.sample_ratios(motion, limit, np.inf))

    def stretch_factor(self, motion: LimitedMotion, limit: Any) -> float:
        """Return the least factor of time at which the sampled ratio, times what the proof adds, is at most 1."""
        proved = float(np.nanmax(self.judge(motion, limit).ratio))

        def ratio(c: float) -> float:
            return float(self.sample_ratios(motion, limit, c).max())

        over = max(proved / max(ratio(1.0), 1e-300), 1.0)
        if not np.isfinite(proved) or ratio(np.inf) * over > 1.0:
            return np.inf
        low, high = 1e-3, 1.0
        while ratio(high) * over > 1.0:
            low, high = high, 2.0 * high
        for _ in range(BISECTIONS):
            c = 0.5 * (low + high)
            low, high = (c, high) if ratio(c) * over > 1.0 else (low, c)
        return float(max(high, np.nextafter(1.0, 2.0)) if proved > 1.0 else min(high, 1.0))


BISECTIONS = 60
"""Halvings of a factor of time: more than the 53 binary digits of a float."""
PLACES = np.array([0.0, 0.1, 0.25, 0.4, 0.5, 0.6, 0.75, 0.9, 1.0])
"""Fractions of a piece at which the values of limits are sampled."""
LEAST_ROOM = 1e-3
"""Least fraction of a limit above its static part with which a row is tightened."""


def find_velocity_reversals(q1: Array) -> Flags:
    """Return where joints (k, n) rest or reverse nearby, from q'(s) at points of a path."""
    sign = np.where(q1 < 0.0, -1.0, 1.0)
    found, turning = np.abs(q1) <= 1e-9 * np.abs(q1).max(initial=0.0), sign[1:] != sign[:-1]
    found[1:] |= turning
    found[:-1] |= turning
    return np.asarray(found)


def dynamic_share(value: Array, static: Array) -> Array:
    """Return the largest dynamic part of values (m, k, ...) of each piece over the room that the static part leaves below 1."""
    return np.asarray(((value - static) / np.maximum(1.0 - static, LEAST_ROOM)).max(axis=1))
