"""Events of a program: signals at places along its parts, and their times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from optik.check import check_number
from optik.errors import InvalidInput
from planners.certificate.certification import SectionTimes
from planners.following.joint_path import JointPath
from planners.motion.motion import Event, check_signal
from planners.paths.base import Path
from planners.planning.result import Plan
from planners.program.joining import Corner

NEAR_SAMPLES, NEAR_ROUNDS = 65, 5
"""Samples of a rounded corner in the search of its point nearest to the sharp corner, and how often they are refined."""
STEPS = 60
"""Most Newton steps or bisections for the time of a place: bisection alone suffices."""
PASSED = 1e-9
"""Fraction of a part's length beyond its ends that is rounding."""
A_FRACTION = "a number from 0 to 1"
"""Fractions that an event may have, in words."""
MOST_EVENTS = 1_000_000
"""Largest number of signals of a `PeriodicEvent`."""


@dataclass(frozen=True)
class PathEvent:
    """A signal at a place along a part.

    Parameters
    ----------
    part : int or str
        The part: its number from 0, or its name.
    distance : float or None
        Distance along the part's own path from its start [m, or rad if the tool only turns], or from its end if it is
        negative. None for a part in joint space, which has a `fraction`.
    signal : str
        Name of the signal.
    value : bool, int, float or str
        The value that it takes.
    fraction : float, optional
        Fraction of the part's length [1], instead of a distance.
    before, after : float
        Time [s] by which the signal precedes the tool at this place, for a valve or a gun with a delay; or follows it.
    """

    part: int | str
    distance: float | None
    signal: str
    value: Any = 1
    fraction: float | None = None
    before: float = 0.0
    after: float = 0.0

    def __post_init__(self) -> None:
        check_signal(self.signal, self.value)
        for name in ("before", "after"):
            check_number(getattr(self, name), name, "a time [s], at least 0", least=0.0)
        if (self.distance is None) == (self.fraction is None):
            raise InvalidInput("distance", f"{self.distance}, and fraction={self.fraction}", "one of the two")
        if self.distance is not None:
            check_number(self.distance, "distance", "a number [m]")
        if self.fraction is not None and check_number(self.fraction, "fraction", A_FRACTION, least=0.0) > 1.0:
            raise InvalidInput("fraction", f"{self.fraction:g}", A_FRACTION)


@dataclass(frozen=True)
class PeriodicEvent:
    """A signal at equal distances along a part, from its start on.

    Parameters
    ----------
    part : int or str
        The part: its number from 0, or its name.
    spacing : float
        Distance between two signals [m, or rad if the tool only turns].
    signal : str
        Name of the signal.
    value : bool, int, float or str
        The value that it takes.
    """

    part: int | str
    spacing: float
    signal: str
    value: Any = 1

    def __post_init__(self) -> None:
        check_signal(self.signal, self.value)
        check_number(self.spacing, "spacing", "a distance above 0 [m]", above=0.0)


@dataclass(frozen=True)
class TimedEvent:
    """A signal at a time of the motion.

    Parameters
    ----------
    t : float
        Time since the start [s].
    signal : str
        Name of the signal.
    value : bool, int, float or str
        The value that it takes.
    """

    t: float
    signal: str
    value: Any = 1

    def __post_init__(self) -> None:
        check_signal(self.signal, self.value)
        check_number(self.t, "t", "a time [s], at least 0", least=0.0)


Scheduled = PathEvent | PeriodicEvent | TimedEvent


def find_part(parts: Sequence[Any], which: Any, first: int = 0) -> int:
    """Return the number of a part, from 0, by its name or its number, which counts from `first`."""
    names = [part.name for part in parts]
    if isinstance(which, str) and which in names:
        return names.index(which)
    if isinstance(which, int) and not isinstance(which, bool) and 0 <= which - first < len(parts):
        return which - first
    known = ", ".join(repr(name) for name in names if name is not None)
    numbers = f"{first} to {len(parts) - 1 + first}"
    raise InvalidInput("part", repr(which)[:60], f"{numbers}{f', or {known}' if known else ''}"[:200])


def list_places(
    parts: tuple[Any, ...], corners: tuple[Corner, ...], path: Path, event: PathEvent | PeriodicEvent
) -> list[float]:
    """Return the path parameters of an event in the whole program.

    Outside rounded corners it is the programmed place. Inside, the ends of the corner keep their place, and the point of the
    corner nearest to the programmed corner is the end of the one part and the start of the other.
    """
    i = find_part(parts, event.part)
    along, label = parts[i].path, f"the part {event.part!r}"
    if isinstance(event, PathEvent) and event.fraction is not None:
        at = np.array([event.fraction * along.end])
    elif along.in_joints:
        argument = "distance" if isinstance(event, PathEvent) else "spacing"
        got = f"a distance along {label}, whose path is in joint space"
        raise InvalidInput(argument, got, "fraction=, from 0 to 1")
    elif isinstance(event, PeriodicEvent):
        if along.end / event.spacing > MOST_EVENTS:
            raise InvalidInput("spacing", f"{event.spacing:g}", f"at least {along.end / MOST_EVENTS:g} for {label}")
        at = event.spacing * np.arange(np.floor(along.end / event.spacing * (1.0 + PASSED)) + 1.0)
    else:
        assert event.distance is not None
        at = np.array([event.distance if event.distance >= 0.0 else along.end + event.distance])
        if not -PASSED * along.end <= at[0] <= (1.0 + PASSED) * along.end:
            expected = f"at most the length of {label}, {along.end:.6g} {along.unit}"
            raise InvalidInput("distance", f"{event.distance:g} {along.unit}", expected)
    return [_bend(parts, corners, path, i, x) for x in np.clip(at, 0.0, along.end).tolist()]


def _bend(parts: tuple[Any, ...], corners: tuple[Corner, ...], path: Path, i: int, x: float) -> float:
    """Return the path parameter of a place x of a part, moved inside its rounded corners."""
    s = float(parts[i].s_at(x))
    for corner in corners:
        if corner.begin == corner.end:
            continue
        sharp = parts[corner.part]
        if corner.part == i and corner.begin < s:
            near = _find_nearest(corner, path, sharp.path)
            return float(corner.begin + (s - corner.begin) * (near - corner.begin) / (sharp.end - corner.begin))
        if corner.part < i and s < corner.end:
            near = _find_nearest(corner, path, sharp.path)
            return float(near + (s - sharp.end) * (corner.end - near) / (corner.end - sharp.end))
    return s


@lru_cache(maxsize=256)
def _find_nearest(corner: Corner, path: Path, before: Path) -> float:
    """Return the path parameter of the point of a rounded corner that is nearest to the end of the part before it."""
    low, high, best = corner.begin, corner.end, 0.5 * (corner.begin + corner.end)
    for _ in range(NEAR_ROUNDS):
        s = np.linspace(low, high, NEAR_SAMPLES)
        far = np.linalg.norm(path.pose(s)[:, :3, 3] - before.pose(before.end)[:3, 3], axis=1)
        if np.ptp(far) <= PASSED * max(float(far.max()), PASSED):  # the tool only turns
            return best
        best = float(s[far.argmin()])
        low, high = max(best - (s[1] - s[0]), corner.begin), min(best + (s[1] - s[0]), corner.end)
    return best


def find_time(plan: Plan, joints: JointPath, start: float, s: float, when: SectionTimes) -> float:
    """Return the time at which a motion is at a path parameter of a section that begins at `start`.

    It is the root of g(t) = q'(s) · (q(t) − q(s)), between the knots around: earlier and later knots are before and behind s.
    """
    motion, x = plan.trajectory, float(np.clip(s - start, 0.0, joints.end))
    q, rate = joints(x), joints(x, 1)
    inside = (plan.certificate.t >= when.begin) & (plan.certificate.t <= when.rest)
    t, places = plan.certificate.t[inside], plan.certificate.s[inside]
    k = int(np.clip(np.searchsorted(places, s), 1, places.size - 1))

    def g(at: float) -> float:
        return float(rate @ (motion(at) - q))

    low, high = float(t[k - 1]), float(t[k])
    if g(low) >= 0.0:
        return low
    if g(high) <= 0.0:
        return high
    at = low + (high - low) * (s - places[k - 1]) / (places[k] - places[k - 1])
    for _ in range(STEPS):
        value = g(at)
        low, high = (at, high) if value < 0.0 else (low, at)
        slope = float(rate @ motion(at, 1))
        after = at - value / slope if slope > 0.0 else low - 1.0
        after = after if low < after < high else 0.5 * (low + high)
        if abs(after - at) <= 1e-15 * max(motion.end, 1.0):
            return float(after)
        at = after
    return float(at)


def round_to_periods(events: list[Event], period: float | None, end: float) -> tuple[Event, ...]:
    """Return events sorted by time; with a period, their times are whole periods, not after the motion's end."""
    if period is not None:
        last = int(end / period * (1.0 + PASSED))
        whole = [period * min(round(event.t / period), last) for event in events]
        events = [event._replace(t=t, shift=t - event.t) for event, t in zip(events, whole, strict=True)]
    return tuple(sorted(events, key=lambda event: event.t))
