"""Part of its path that a motion covers, forwards."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.check import check_number
from optik.errors import InvalidInput
from optik.ik.base import Tolerance
from optik.types import Array
from planners.certificate.path_error import Passage
from planners.certificate.violation import Violation
from planners.paths.base import Path

FALLS = 100
"""Largest number of measured backward stretches, the longest first; each needs 65 twists."""
COVERED = (1e-5, 1e-5)
"""Largest distance along the path [m, rad] of start and end from their required positions, and of backward stretches, without
a tolerance: the default tolerance of `planners.plan`."""
SIMPSON_INTERVALS = 64
"""Number of intervals of Simpson's rule for the length of a stretch, even: exact to 1e-6 on any arc of these paths."""


class Coverage(NamedTuple):
    """Part of its path that a motion covers.

    ``begin`` and ``end`` are the path parameters of start and end, ``wanted`` the required ones; ``back`` and ``t_back`` are
    the path parameter and the time [s] of the end of its longest backward stretch. ``missing`` are distances along the path
    [m, rad]: of the start and of the end from their required positions, and of the longest backward stretch.
    """

    begin: float
    end: float
    wanted: tuple[float, float]
    back: float
    t_back: float
    missing: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]

    def find_violations(self, tolerance: Tolerance | None, duration: float) -> list[Violation]:
        """Return the violations: a wrong start, a wrong end, and a backward stretch."""
        late, early, back = (not np.less_equal(x, tuple(tolerance or COVERED)).all() for x in self.missing)
        found = []
        if late:
            words = f"the motion begins at s = {self.begin:.6g} of its path, not at {self.wanted[0]:.6g}"
            found.append(Violation(words, 0.0, "coverage"))
        if early:
            words = f"the motion ends at s = {self.end:.6g} of its path, not at {self.wanted[1]:.6g}"
            found.append(Violation(words, duration, "coverage"))
        if back:
            words = f"the motion goes back along its path, to s = {self.back:.6g} at t = {self.t_back:.6g} s"
            found.append(Violation(words, self.t_back, "coverage"))
        return found


def coverage(path: Path, passage: Passage, span: tuple[float, float]) -> Coverage:
    """Return the part of its path that a motion covers, and its longest backward stretch."""
    begin, end = float(passage.s[0]), float(passage.s[-1])
    back = (0.0, 0.0), end, float(passage.t[-1])  # nowhere
    for t, high, low in _find_backward_stretches(passage):
        length = length_between(path, low, high)
        if max(length) > max(back[0]):
            back = length, float(low), float(t)
    missing = length_between(path, begin, span[0]), length_between(path, end, span[1]), back[0]
    return Coverage(begin, end, span, back[1], back[2], missing)


def _find_backward_stretches(passage: Passage) -> Array:
    """Return the longest backward stretches (k, 3): their end time, the largest s before, and the least s until the next.

    A stretch may span many intervals; ``passage.falls`` has its part in each of them.
    """
    falls = passage.falls
    t = np.concatenate([passage.t, falls[:, 0], falls[:, 0]])
    s = np.concatenate([passage.s, falls[:, 1], falls[:, 2]])
    order = np.lexsort((np.repeat([0, 1, 2], [passage.t.size, len(falls), len(falls)]), t))
    t, s = t[order], s[order]
    starts = np.flatnonzero(np.append(True, s[1:] > np.maximum.accumulate(s)[:-1]))
    ends = np.append(starts[1:], s.size)
    starts, ends = starts[ends > starts + 1], ends[ends > starts + 1]
    lowest = np.array([first + s[first:last].argmin() for first, last in zip(starts, ends, strict=True)], np.int64)
    back = np.column_stack([t[lowest], s[starts], s[lowest]])[s[lowest] < s[starts]]
    return np.asarray(back[np.argsort(back[:, 2] - back[:, 1], kind="stable")[:FALLS]])


def length_between(path: Path, a: float, b: float) -> tuple[float, float]:
    """Return how far the tool moves and turns between two positions along a path, by Simpson's rule."""
    s = np.linspace(min(a, b), max(a, b), SIMPSON_INTERVALS + 1)
    twist = path.twist(s)
    weights = np.array([1.0, *[4.0, 2.0] * (SIMPSON_INTERVALS // 2 - 1), 4.0, 1.0]) * (s[1] - s[0]) / 3.0
    moved, turned = (float(weights @ np.linalg.norm(part, axis=1)) for part in (twist[:, :3], twist[:, 3:]))
    return moved, turned


def check_span(span: tuple[float, float] | None, path: Path) -> tuple[float, float]:
    """Return the part of a path that a motion must cover; raise InvalidInput for an invalid one."""
    if span is None:
        return 0.0, path.end
    expected = f"two increasing path parameters in [0, {path.end:.9g}]"
    if not isinstance(span, tuple | list) or len(span) != 2:
        raise InvalidInput("span", repr(span)[:60], expected)
    begin, end = (check_number(x, "span", expected, least=0.0) for x in span)
    if not begin <= end <= path.end:
        raise InvalidInput("span", repr(span)[:60], expected)
    return begin, end
