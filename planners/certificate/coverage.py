"""Which part of its path a motion runs through, forwards."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik import se3
from optik.check import check_number
from optik.errors import InvalidInput
from planners.certificate.path_error import Passage
from planners.paths.base import Path

FALLS = 100
"""Stretches between two instants on which a motion goes back that are measured, the longest first."""


class Coverage(NamedTuple):
    """Which part of its path a motion runs through.

    ``begin`` and ``end`` are the places where it begins and ends, ``wanted`` those where it should; ``back`` and ``t_back`` are
    the place that it goes back to farthest from one it had come to before, and when it is there [s]. ``missing`` says how far
    along the path [m, rad] it begins away from where it should, ends away from where it should, and goes back.
    """

    begin: float
    end: float
    wanted: tuple[float, float]
    back: float
    t_back: float
    missing: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


def coverage(path: Path, passage: Passage, span: tuple[float, float]) -> Coverage:
    """Which part of its path a motion runs through, and how far it goes back on the way."""
    s = passage.s
    begin, end = float(s[0]), float(s[-1])
    top = np.maximum.accumulate(s)
    first = np.maximum.accumulate(np.where(s == top, np.arange(s.size), 0))  # where it came to the farthest place yet
    back = (0.0, 0.0), end, float(passage.t[-1])  # nowhere
    if (s < top).any():
        gap = se3.error(passage.poses[first], passage.poses)
        away = np.stack([np.linalg.norm(part, axis=1) for part in (gap[:, :3], gap[:, 3:])], axis=1)
        k = int(away.max(axis=1).argmax())
        back = (float(away[k, 0]), float(away[k, 1])), float(s[k]), float(passage.t[k])
    falls = passage.falls[np.argsort(passage.falls[:, 2] - passage.falls[:, 1], kind="stable")[:FALLS]]
    for t, high, low in falls:
        length = length_between(path, low, high)
        if max(length) > max(back[0]):
            back = length, float(low), float(t)
    missing = length_between(path, begin, span[0]), length_between(path, end, span[1]), back[0]
    return Coverage(begin, end, span, back[1], back[2], missing)


def length_between(path: Path, a: float, b: float) -> tuple[float, float]:
    """How far the tool moves [m] and turns [rad] along a path between two places, by Simpson's rule."""
    s = np.linspace(min(a, b), max(a, b), 65)
    twist = path.twist(s)
    weights = np.array([1.0, *[4.0, 2.0] * 31, 4.0, 1.0]) * (s[1] - s[0]) / 3.0
    moved, turned = (float(weights @ np.linalg.norm(part, axis=1)) for part in (twist[:, :3], twist[:, 3:]))
    return moved, turned


def check_span(span: tuple[float, float] | None, path: Path) -> tuple[float, float]:
    """Return the part of a path that a motion shall run through: two places, by default its ends."""
    if span is None:
        return 0.0, path.end
    expected = f"two places on the path, in [0, {path.end:.9g}], the second not before the first"
    if not isinstance(span, tuple | list) or len(span) != 2:
        raise InvalidInput("span", repr(span)[:60], expected)
    begin, end = (check_number(x, "span", expected, least=0.0) for x in span)
    if not begin <= end <= path.end:
        raise InvalidInput("span", repr(span)[:60], expected)
    return begin, end
