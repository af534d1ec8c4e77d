"""Analysis of a motion: quantities that several parts of a certificate need, each computed once, and checks."""

from __future__ import annotations

from collections.abc import Hashable
from functools import cached_property
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
from optik.types import Array, Flags, Indices
from planners.certificate.bounds import FEW_INTERVALS, MotionBounds, instants, prove_peak
from planners.certificate.effort import find_torque_stretch
from planners.certificate.path_error import ERROR_FLOOR, Passage, PathError, path_error
from planners.certificate.projection import NEAREST_TURN, Nearest
from planners.certificate.torque import TORQUE_INTERVALS, TorqueBounds
from planners.certificate.violation import Violation
from planners.limits.inputs import Enclose, Evaluate, Gears, LimitedMotion, TorqueRatios
from planners.paths.base import Path
from planners.trajectory import Extrema, Trajectory, map_joints

# ---------------- position limits


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


def find_smallest_singular_value(robot: Robot, trajectory: Trajectory) -> tuple[float, float]:
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


def find_discontinuities(trajectory: Trajectory, order: int, standing: tuple[bool, bool] | None = None) -> Array:
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
    size = np.abs(find_discontinuities(trajectory, order, rest(trajectory))) * jumping[order]
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
        length = measure_between(path, low, high)
        if max(length) > max(back[0]):
            back = length, float(low), float(t)
    missing = measure_between(path, begin, span[0]), measure_between(path, end, span[1]), back[0]
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


def measure_between(path: Path, a: float, b: float) -> tuple[float, float]:
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


# ---------------- ratio of the tool's speed to limits


CROSSING_ROUNDING = 1e-12
"""Fraction of the path, and of the duration, below which two positions, or two instants, are the same: rounding is near."""
CROSSING_STEPS = 60
"""Largest number of steps to the instant at which a break is passed; three Newton steps are usual."""


def segment_speed(
    bounds: MotionBounds, path: Path, passage: Passage, on_pieces: Array, part: int
) -> tuple[float, float]:
    """Return a bound on the ratio of the tool's speed to the limit of the current piece of the path, and its time.

    The current piece is that of s(t), the projection onto the path (`planners.certificate.path_error`). If s(t) decreases
    within an interval, the least limit of all its pieces counts.
    """
    piece, begin, end, limit = _stretches(bounds, path, passage, on_pieces)
    ends, limits = bounds.at(np.tile(piece, 2), np.concatenate([begin, end])), np.full((piece.size, 2), np.inf)
    limits[:, part] = limit
    proved, _, when = bounds.bound_speeds(piece, ends, limits)
    return float(proved[part]), float(when[part])


def _stretches(
    bounds: MotionBounds, path: Path, passage: Passage, on_pieces: Array
) -> tuple[Indices, Array, Array, Array]:
    """Return intervals of time (k,) with one limit each: their pieces of the motion, starts, ends [s] and limits."""
    t, s, inner = passage.t, passage.s, path.breaks[1:-1]
    low, high = np.minimum(s[:-1], s[1:]), np.maximum(s[:-1], s[1:])
    back = s[1:] < s[:-1]
    for when, top, _, bottom in passage.falls:
        i = min(int(np.searchsorted(t, when, side="right")) - 1, low.size - 1)
        low[i], high[i], back[i] = min(low[i], bottom), max(high[i], top), True
    first = np.searchsorted(inner, low + CROSSING_ROUNDING * path.end, side="right")
    last = np.maximum(first, np.searchsorted(inner, high - CROSSING_ROUNDING * path.end, side="left"))
    piece = np.cumsum(passage.knot)[:-1] - 1
    limit = on_pieces[first]
    for k in np.flatnonzero(back & (first < last)):
        limit[k] = on_pieces[first[k] : last[k] + 1].min()
    changes = np.flatnonzero(on_pieces[1:] != on_pieces[:-1])  # inner breaks at which the limit changes
    count = np.searchsorted(changes, last) - np.searchsorted(changes, first)
    count[back] = 0
    parted = np.repeat(np.arange(count.size), count)  # intervals, once for each change in them
    if not parted.size:
        return _merge(piece, t[:-1], limit, t[-1])
    nth = np.arange(parted.size) - np.repeat(np.cumsum(count) - count, count)
    crossed = changes[np.searchsorted(changes, first[parted]) + nth]
    knots = t[passage.knot]
    within = (knots[piece[parted]], knots[piece[parted] + 1]) if not back.any() else (t[parted], t[parted + 1])
    when = _crossings(bounds, path, piece[parted], within, inner[crossed])
    begin, after = np.concatenate([t[:-1], when]), np.concatenate([limit, on_pieces[crossed + 1]])
    owner = np.concatenate([piece, piece[parted]])
    order = np.lexsort((np.arange(begin.size), begin))
    return _merge(owner[order], begin[order], after[order], t[-1])


def _merge(piece: Indices, begin: Array, limit: Array, end: float) -> tuple[Indices, Array, Array, Array]:
    """Return intervals as `_stretches`, without bounds between two of one piece and one limit.

    Thus the ratio does not depend on the intervals of the projection, which are others for a motion from a file.
    """
    kept = np.append(True, (piece[1:] != piece[:-1]) | (limit[1:] != limit[:-1]))
    begin = begin[kept]
    return piece[kept], begin, np.append(begin[1:], end), limit[kept]


def _crossings(bounds: MotionBounds, path: Path, piece: Indices, ends: tuple[Array, Array], places: Array) -> Array:
    """Return the instants (k,) at which a motion passes positions along its path: Newton's method within a bisection."""
    nearest, (low, high) = Nearest(path), ends
    t, shortest = 0.5 * (low + high), CROSSING_ROUNDING * float(bounds.knots[-1])
    for _ in range(CROSSING_STEPS):
        found = nearest.places(bounds.at(piece, t), places)
        off = found.s - places
        low, high = np.where(off < 0.0, t, low), np.where(off < 0.0, high, t)
        with np.errstate(divide="ignore", invalid="ignore"):
            after = t - off / found.speed
        after = np.where((after > low) & (after < high), after, 0.5 * (low + high))
        settled = np.abs(after - t).max() <= shortest
        t = after
        if settled:
            break
    return t


# ---------------- analysis of a motion


PATH_INDEPENDENT = ("members", "bounds", "tool_speed", "torque_bounds", "jumps", "rest", "peaks")
"""Properties of a `MotionAnalysis` that do not depend on the path."""


class MotionAnalysis(LimitedMotion):
    """A motion of an arm, along a path if it has one, and its computed values.

    `enough` [m, rad] is a small path error. `turn` [m/rad] weighs rotation against position where the tool is projected.
    """

    def __init__(
        self,
        robot: Robot,
        trajectory: Trajectory,
        path: Path | None = None,
        enough: tuple[float, float] = (ERROR_FLOOR, ERROR_FLOOR),
        turn: float = NEAREST_TURN,
    ) -> None:
        self.robot, self.trajectory, self._path = robot, trajectory, path
        self._accuracy = (min(enough[0], ERROR_FLOOR), min(enough[1], ERROR_FLOOR)), turn

    def along_path(self, path: Path | None, enough: tuple[float, float], turn: float = NEAREST_TURN) -> MotionAnalysis:
        """Return the analysis of the same motion along a path; values that do not depend on the path are reused."""
        other, known = MotionAnalysis(self.robot, self.trajectory, path, enough, turn), vars(self)
        if path is self._path and other._accuracy == self._accuracy:
            return self
        vars(other).update({name: known[name] for name in PATH_INDEPENDENT if name in known})
        return other

    def bare(self) -> MotionAnalysis:
        """Return the analysis of the same motion without its large computed values."""
        other, known = MotionAnalysis(self.robot, self.trajectory, self._path, *self._accuracy), vars(self)
        vars(other).update({name: known[name] for name in ("rest", "knot_positions") if name in known})
        return other

    def stretched(self, factor: float) -> MotionAnalysis:
        """Return the motion stretched in time by a factor."""
        return MotionAnalysis(self.robot, self.trajectory.stretched(factor), self._path, *self._accuracy)

    def of_member(self, robot: Robot, columns: tuple[int, ...]) -> MotionAnalysis:
        """Return the analysis of the motion of one mechanism, by its joints among those of this motion, computed once."""
        if (robot, columns) not in self.members:
            moved = map_joints(self.trajectory, np.eye(self.robot.n)[list(columns)])
            self.members[robot, columns] = MotionAnalysis(robot, moved)
        return self.members[robot, columns]

    @cached_property
    def members(self) -> dict[tuple[Robot, tuple[int, ...]], MotionAnalysis]:
        """Results of `of_member`."""
        return {}

    @property
    def has_path(self) -> bool:
        """Whether the motion has a path."""
        return self._path is not None

    @property
    def path(self) -> Path:
        """The path; raises InvalidInput if there is none."""
        if self._path is None:
            raise InvalidInput("path", "none", "the path of the motion: limits of its segments need it")
        return self._path

    @cached_property
    def along(self) -> tuple[PathError, Passage]:
        """The path error, and the motion's progress along the path."""
        return path_error(self.robot, self.path, self.trajectory, self.bounds, *self._accuracy)

    @cached_property
    def knot_positions(self) -> Array:
        """Path parameter (m + 1,) at the knots of the trajectory [m, or rad]."""
        passage = self.along[1]
        return passage.s[passage.knot]

    @cached_property
    def bounds(self) -> MotionBounds:
        """Bounds on the derivatives of the tool's motion."""
        return MotionBounds(self.robot, self.trajectory)

    @cached_property
    def tool_speed(self) -> tuple[Array, Array]:
        """Proved bounds on |v| [m/s] and |ω| [rad/s] of the tool, (2,), and the times of the peaks [s]."""
        pieces = np.arange(self.trajectory.knots.size - 1)
        proved, _, when = self.bounds.bound_speeds(pieces, self.bounds.ends, np.ones((pieces.size, 2)))
        return proved, when

    def tool_speed_bound(self, part: int) -> tuple[float, float]:
        """Return a proved bound on the tool's speed [m/s, rad/s], and the time of the peak [s]."""
        proved, when = self.tool_speed
        return float(proved[part]), float(when[part])

    def tool_speed_ratio(self, on_pieces: Array, part: int) -> tuple[float, float]:
        """Return a proved bound on the ratio of the tool's speed to the limits of the path's pieces, and its time [s]."""
        return segment_speed(self.bounds, self.path, self.along[1], on_pieces, part)

    def tool_speed_ends(self, part: int) -> tuple[Array, Array]:
        """Return the tool's speed (m,) at the first and at the last instant of every piece [m/s, rad/s]."""
        rows = slice(3 * part, 3 * part + 3)
        first, last = np.linalg.norm(self.bounds.ends.twists[:, 0, rows], axis=1).reshape(2, -1)
        return first, last

    def states(self, shares: Array) -> tuple[Array, Array]:
        """Return the joints' derivatives (m, k, 6, n) of order 0 to 5 at fractions (k,) of each piece, and the times (m, k)."""
        knots = self.trajectory.knots
        t = knots[:-1, None] + np.diff(knots)[:, None] * shares
        piece = np.repeat(np.arange(knots.size - 1), shares.size)
        return self.joints_at(piece, t.ravel()).reshape(*t.shape, 6, -1), t

    def joints_at(self, piece: Indices, t: Array) -> Array:
        """Return the joints' derivatives (k, 6, n) at instants of given pieces."""
        joints = np.empty((t.size, 6, self.robot.n))
        instants(self.trajectory.padded, piece, t - self.trajectory.knots[piece], joints)
        return joints

    @cached_property
    def peaks(self) -> dict[Hashable, tuple[float, float]]:
        """Results of `prove_peak`, by key."""
        return {}

    def prove_peak(self, key: Hashable, evaluate: Evaluate, enclose: Enclose, excess: float) -> tuple[float, float]:
        """Return a proved upper bound on peak / limit, a fraction `excess` above the largest found, and its time [s]."""
        if key not in self.peaks:
            self.peaks[key] = prove_peak(self.bounds, evaluate, enclose, excess)
        return self.peaks[key]

    @cached_property
    def torque_bounds(self) -> dict[bytes, TorqueBounds]:
        """Results of `_torques_of`, by the matrix of the gears."""
        return {}

    @property
    def torques(self) -> TorqueBounds:
        """Torques of the joints and proved bounds on them; raises InvalidInput if the arm's masses are unknown."""
        return self._torques_of(None)

    def _torques_of(self, gears: Gears | None) -> TorqueBounds:
        """Return the torques of joints or motors, computed once."""
        key = b"" if gears is None else gears.matrix.tobytes()
        if key not in self.torque_bounds:
            knots = self.bounds.knots
            piece = np.arange(knots.size - 1)
            ends = (self.joints_at(piece, t) for t in (knots[:-1], knots[1:]))
            self.torque_bounds[key] = TorqueBounds(self.robot, knots, *ends, gears=gears)
        return self.torque_bounds[key]

    def torque_ratios(self, limit: Array, *, rate: bool, gears: Gears | None = None) -> TorqueRatios:
        """Return proved bounds on the ratios of joint or motor torques, or of their rates, to the limits (2, n)."""
        most = FEW_INTERVALS if self.bounds.far_out_of_range else TORQUE_INTERVALS
        return self._torques_of(gears).bound_ratios(limit, rate=rate, most=most)

    def torque_piece_ratios(self, limit: Array, *, rate: bool, gears: Gears | None = None) -> Array:
        """Return the ratios (m, n) of these torques, or of their rates, to the limits: on each piece the larger end value."""
        return self._torques_of(gears).piece_ratios(limit, rate=rate)

    def torque_stretch(self, limit: Array, *, rate: bool, gears: Gears | None = None) -> float:
        """Return the least factor by which the motion is stretched in time to respect the torque or rate limits (2, n)."""
        return find_torque_stretch(self._torques_of(gears), limit, rate=rate)

    @cached_property
    def jumps(self) -> Flags:
        """Discontinuities (4, m + 1, n) of the joints' derivatives of order 0 to 3 at the knots."""
        return jumps(self.trajectory, self.rest)

    def steps(self, order: int) -> Array:
        """Return the discontinuities (m + 1, n) of the joints' derivative of one order at the knots."""
        return find_discontinuities(self.trajectory, order)

    @cached_property
    def rest(self) -> tuple[bool, bool]:
        """Whether the motion starts and ends at rest."""
        return rest(self.trajectory)
