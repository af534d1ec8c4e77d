"""Position limits, sampled jerk, singular values, continuity, rest and covered path of a motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik import kinematics, linear
from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.motors import Ranges, ranges_of
from optik.arm.robot import Robot
from optik.check import check_number
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.ik.base import Tolerance
from optik.kinematics import Chain
from optik.types import Array, Flags
from planners.certificate.path_error import Passage
from planners.certificate.violation import Violation
from planners.paths.base import Path
from planners.trajectory import Extrema, Trajectory, map_joints


def reach_of(robot: Robot, trajectory: Trajectory) -> tuple[Extrema, Ranges]:
    """Return the positions that a motion reaches, and their ranges."""
    ranges = ranges_of(robot)
    moved = trajectory if robot.motors is None else map_joints(trajectory, ranges.rows, ranges.offset)
    return moved.extrema(0), ranges


def position_margins(robot: Robot, trajectory: Trajectory) -> Array:
    """Return the least distance of every joint, or motor, to its position limits over a motion."""
    reach, limits = reach_of(robot, trajectory)
    return np.minimum(reach.least - limits.lower, limits.upper - reach.greatest)


def position_times(robot: Robot, trajectory: Trajectory) -> Array:
    """Return the times at which the joints are nearest to their position limits (n,) [s]."""
    reach, limits = reach_of(robot, trajectory)
    lower = reach.least - limits.lower < limits.upper - reach.greatest
    return np.where(lower, reach.t_least, reach.t_greatest)


def find_position_violations(
    margins: Array, joint_names: tuple[str, ...], times: Array | None = None
) -> list[Violation]:
    """Return the largest violation of a position limit above 1e-9, from the margins and their times."""
    i = int(np.argmin(margins))
    if margins[i] >= -LIMIT_TOLERANCE:
        return []
    t = 0.0 if times is None else float(times[i])
    words = f"{joint_names[i]} exceeds its range by {-margins[i]:.3g} (rad or m) at t = {t:.6g} s"
    return [Violation(words, t, "limits", joint_names[i])]


RATES = (1e-6, 1e9)
"""Range of a controller's rate [1/s], in which differences describe the motion."""
PERIODS = 1_000_000
"""Largest number of periods that are all evaluated: half a minute of computing."""


def check_rate(rate: float) -> float:
    """Return a controller's rate [1/s]; raise InvalidInput unless it is in `RATES`."""
    if not RATES[0] <= check_number(rate, "rate", "samples per second") <= RATES[1]:
        raise InvalidInput("rate", f"{rate:.9g}", f"samples per second, in [{RATES[0]:g}, {RATES[1]:g}]")
    return rate


def sampled_jerk(trajectory: Trajectory, rate: float) -> Array:
    """Return the largest difference of accelerations over one period of a controller, divided by the period."""
    periods = max(int(trajectory.end * rate + 1e-9), 1)
    first = np.arange(min(periods, PERIODS))
    # A motion of days: periods around the knots, where accelerations change fastest, and a sample.
    if periods > PERIODS:
        around = np.floor(trajectory.knots[:, None] * rate) + np.arange(-1, 2)
        first = np.concatenate([np.linspace(0, periods - 1, PERIODS), np.clip(around.ravel(), 0, periods - 1)])
        begin, end = (trajectory(np.minimum(np.floor(i) / rate, trajectory.end), 2) for i in (first, first + 1))
    else:
        every = trajectory(np.minimum(np.append(first, periods) / rate, trajectory.end), 2)
        begin, end = every[:-1], every[1:]
    difference: Array = np.abs(end - begin).max(axis=0) * rate
    return difference


GRID_INSTANTS, FINER_INSTANTS = 121, 9
"""Number of instants of the first grid, which resolves minima of 1 % of the motion, and of each finer grid."""
GRID_WIDTH = 1e-4
"""Fraction of the duration below which a grid is not refined: at a smooth minimum the value is correct to 1e-8."""


def smallest_singular_value(robot: Robot, trajectory: Trajectory) -> tuple[float, float]:
    """Return the smallest singular value along a motion, and its time, from a grid that is refined around its minimum."""
    return _find_smallest(robot.chain, trajectory.padded, trajectory.knots, trajectory.end)


@compiled
def _find_smallest(chain: Chain, c: Array, knots: Array, end: float) -> tuple[float, float]:
    """Return the smallest singular value of the Jacobian of quintics c (6, m, n) on [0, end], and its time."""
    n = c.shape[2]
    q, (frame, T, J) = np.empty(n), kinematics.workspace(chain, n)
    low, high, count = 0.0, end, GRID_INSTANTS
    while True:
        step, best, at = (high - low) / (count - 1), np.inf, 0
        for k in range(count):
            t = low + k * step if k < count - 1 else high
            i = min(max(np.searchsorted(knots, t, side="right") - 1, 0), c.shape[1] - 1)
            for j in range(n):
                q[j] = 0.0
                for power in range(6):
                    q[j] = q[j] * (t - knots[i]) + c[power, i, j]
            kinematics.forward(chain, q, frame, T)
            kinematics.jacobian_from(chain, frame, T, J)
            value = linear.smallest_singular_value(J, np.inf, best)
            if value < best:
                best, at = value, k
        if high - low <= GRID_WIDTH * end:
            return best, low + at * step if at < count - 1 else high
        low, high = low + max(at - 1, 0) * step, (low + (at + 1) * step if at + 1 < count - 1 else high)
        count = FINER_INSTANTS


JUMP = 1e-5
"""Difference of one-sided values above which it is a jump, relative to the joint's largest value of that derivative."""
STEP_ROUNDING = 1e-14
"""Rounding error of a derivative: this fraction of q, over the shorter piece's duration to the power of the order."""
FROM_AFAR = 0.3
"""Least q [rad or m] in the rounding error: a motion that ends at 0 keeps the rounding error of its earlier positions, and one
that stays at 0 has that of the pose: 1.0e-15 rad was seen between two parts of a program."""
AT_REST = 1e-9
"""Final velocity, relative to the joint's largest one, below which it is at rest; the rounding error is added."""


class Jump(NamedTuple):
    """A discontinuity of a joint's position or velocity [rad, m, or per s], and its time [s]."""

    size: float
    t: float
    joint: int


def jumps(trajectory: Trajectory, standing: tuple[bool, bool]) -> Flags:
    """Return where a joint's derivative steps by more than rounding error, each joint on its own scale."""
    first, last = zip(*(trajectory.ends(order) for order in range(4)), strict=True)
    worst = np.stack([trajectory.extrema(order).worst for order in range(4)])
    size = STEP_ROUNDING * np.maximum(worst[0], FROM_AFAR)
    jumping = np.empty((4, len(first[0]) + 1, trajectory.n), np.bool_)
    _find_jumps(np.stack(first), np.stack(last), np.diff(trajectory.knots), standing, JUMP * worst, size, jumping)
    return jumping


@compiled
def _find_jumps(
    first: Array, last: Array, h: Array, standing: tuple[bool, bool], allowed: Array, size: Array, jumping: Flags
) -> None:
    """Write where derivatives (4, m, n) step at knots by more than `allowed` (4, n) plus rounding of positions `size` (n,)."""
    m = h.shape[0]
    for order in range(4):
        for k in range(m + 1):
            shorter = min(h[max(k - 1, 0)], h[min(k, m - 1)])
            for i in range(size.shape[0]):
                if 0 < k < m:
                    step = first[order, k, i] - last[order, k - 1, i]
                elif order == 0 or not standing[0 if k == 0 else 1]:
                    step = 0.0
                else:
                    step = first[order, 0, i] if k == 0 else last[order, m - 1, i]
                jumping[order, k, i] = abs(step) > allowed[order, i] + size[i] / shorter**order


def rest(trajectory: Trajectory) -> tuple[bool, bool]:
    """Return whether a motion starts and ends at rest, each joint on its own scale.

    The start is at rest only within rounding error: a motion that is replanned just after its start is slow but moves.
    """
    (first, last), knots = trajectory.ends(1), trajectory.knots
    rounding = STEP_ROUNDING * np.maximum(trajectory.extrema(0).worst, FROM_AFAR)
    still = AT_REST * trajectory.extrema(1).worst
    # The remaining motion just before the end is slow but not at rest.
    begin, end = np.minimum(rounding / (knots[1] - knots[0]), still), rounding / (knots[-1] - knots[-2]) + still
    return bool((np.abs(first[0]) <= begin).all()), bool((np.abs(last[-1]) <= end).all())


def steps(trajectory: Trajectory, order: int, standing: tuple[bool, bool] | None = None) -> Array:
    """Return the discontinuities of the joints' derivative of one order at all knots; at a resting end, against standstill."""
    first, last = trajectory.ends(order)
    # the position of a standstill is that of the adjacent end: it cannot jump
    start, end = (standing or rest(trajectory)) if order else (False, False)
    before = first[:1] if start else np.zeros_like(first[:1])
    after = -last[-1:] if end else np.zeros_like(last[-1:])
    return np.concatenate([before, trajectory.jumps(order), after])


def continuous_order(jumping: Flags) -> int:
    """Return the highest order up to which all derivatives of a motion are continuous; −1 if the position jumps."""
    return next((order - 1 for order in range(4) if jumping[order].any()), 3)


def largest_jump(trajectory: Trajectory, jumping: Flags) -> Jump | None:
    """Return the largest jump of the position, or of the velocity if the position is continuous; None if neither jumps."""
    order = continuous_order(jumping) + 1
    if order > 1:
        return None
    size = np.abs(steps(trajectory, order, rest(trajectory))) * jumping[order]
    knot, joint = (int(k) for k in np.unravel_index(size.argmax(), size.shape))
    return Jump(float(size[knot, joint]), float(trajectory.knots[knot]), joint)


def find_continuity_violations(continuous: int, jump: Jump | None, joint_names: tuple[str, ...]) -> list[Violation]:
    """Return the jump found by `largest_jump` as a violation; no motion may have one."""
    if continuous >= 1:
        return []
    what, unit = ("position", "rad or m") if continuous < 0 else ("velocity", "rad/s or m/s")
    if jump is None:
        return [Violation(f"the {what} jumps", 0.0, "limits")]
    name = joint_names[jump.joint]
    words = f"the {what} jumps by {jump.size:.3g} ({unit}) at t = {jump.t:.6g} s, joint {name}"
    return [Violation(words, jump.t, "limits", name)]


FALLS = 100
"""Largest number of measured backward stretches, the longest first; each needs 65 twists."""
COVERED = (1e-5, 1e-5)
"""Largest distance along the path [m, rad] of start and end from their required positions, and of backward stretches, without
a tolerance: the default tolerance of `planners.plan`."""
SIMPSON_INTERVALS, SHORT_STRETCH = 64, 1e-9
"""Even number of intervals of Simpson's rule for a length along a path (exact to 1e-6 on arcs), and the fraction of the path up
to which two suffice."""


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
    if not falls.size and (passage.s[1:] >= passage.s[:-1]).all():
        return np.empty((0, 3))
    t = np.concatenate([passage.t, falls[:, 0], falls[:, 2]])
    s = np.concatenate([passage.s, falls[:, 1], falls[:, 3]])
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
    if a == b:
        return 0.0, 0.0
    count = SIMPSON_INTERVALS if abs(b - a) > SHORT_STRETCH * path.end else 2
    s = np.linspace(min(a, b), max(a, b), count + 1)
    twist = path.twist(s)
    weights = np.array([1.0, *[4.0, 2.0] * (count // 2 - 1), 4.0, 1.0]) * (s[1] - s[0]) / 3.0
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
