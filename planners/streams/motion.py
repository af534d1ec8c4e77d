"""Joint motions as piecewise cubics: time-optimal ones between two states by Ruckig, and the pace of a reference."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import scipy

from optik.compiled import inlined, parallel
from optik.types import Array, Indices
from planners.trajectory import Trajectory, without_rounding

# ---------------- joint motions as piecewise cubics


SAME_TIME = 1e-9
"""Largest difference of times that are equal [s]."""
SAME_KNOT = 1e-13
"""Largest difference of two joints' knots that counts as rounding [s]."""
SAME_PLACE = 1e-14
"""Distance to a goal that is rounding, over the larger of the position and 1 [rad, m]."""
SHORTEST, BRIEF_REST = 1e-12, 1e-3
"""Duration below which a phase is left out, and the third of that of a joint without any [s]."""


@inlined
def _widen(order: int, j: int, value: float, t: float, out: Array) -> None:
    """Widen the extrema out (4, 4, n): least, greatest, and their times, by order."""
    if value < out[order, 0, j]:
        out[order, 0, j], out[order, 2, j] = value, t
    if value > out[order, 1, j]:
        out[order, 1, j], out[order, 3, j] = value, t


@parallel
def cubic_extrema(knots: Array, count: Indices, c: Array, state: Array, out: Array, jump: Array) -> None:
    """Write the exact extrema of position, velocity, acceleration and jerk, and the largest discontinuities jump (3,).

    Before it, the motion has a state (3, n), and at its last knot a joint is at rest. Shapes: out (4, 4, n).
    """
    out[:, 0], out[:, 1], out[:, 2:] = np.inf, -np.inf, 0.0
    jump[:] = 0.0
    for j in range(count.size):
        for order in range(3):
            jump[order] = max(jump[order], abs((1.0, 1.0, 2.0)[order] * c[j, 3 - order, 0] - state[order, j]))
        for k in range(count[j] - 1):
            t, h = knots[j, k], knots[j, k + 1] - knots[j, k]
            a, b, v, q = c[j, 0, k], c[j, 1, k], c[j, 2, k], c[j, 3, k]
            end = (((a * h + b) * h + v) * h + q, (3.0 * a * h + 2.0 * b) * h + v, 6.0 * a * h + 2.0 * b)
            for order, first in enumerate((q, v, 2.0 * b)):
                _widen(order, j, first, t, out)
                _widen(order, j, end[order], t + h, out)
            _widen(3, j, 6.0 * a, t, out)
            if (a != 0.0 and 0.0 < -b < 3.0 * a * h) or 0.0 < b < -3.0 * a * h:
                u = -b / (3.0 * a)
                _widen(1, j, v + u * b, t + u, out)
            square = b * b - 3.0 * a * v
            if square > 0.0:
                root = -(b + (np.sqrt(square) if b >= 0.0 else -np.sqrt(square)))
                for u in (root / (3.0 * a) if a != 0.0 else -1.0, v / root if root != 0.0 else -1.0):
                    if 0.0 < u < h:
                        _widen(0, j, ((a * u + b) * u + v) * u + q, t + u, out)
            if k < count[j] - 2:
                after = (c[j, 3, k + 1], c[j, 2, k + 1], 2.0 * c[j, 1, k + 1])
            else:
                after = (end[0], 0.0, 0.0)
            for order in range(3):
                jump[order] = max(jump[order], abs(end[order] - after[order]))


@inlined
def integrate(T: Array, jerk: Array, state: Array, goal: Array, c: Array) -> None:
    """Write the cubics c (4, N), highest power first, of jerks over breakpoints T, from a state (3,) to a goal (3,).

    The jerks (N,) are changed by the least amount with which the motion ends exactly at the goal, which is free where it is
    NaN: so rounding is removed, and position, velocity and acceleration are continuous. A position that differs by rounding is
    not changed, because in a motion of microseconds that takes a jerk beyond its limit.
    """
    N = T.size - 1
    for sweep in range(3):
        q, v, a = state[0], state[1], state[2]
        for i in range(N):
            h, j = T[i + 1] - T[i], jerk[i]
            c[0, i], c[1, i], c[2, i], c[3, i] = j / 6.0, 0.5 * a, v, q
            q += h * (v + h * (0.5 * a + h * j / 6.0))
            v += h * (a + 0.5 * h * j)
            a += h * j
        if sweep < 2 and goal[1] == goal[1]:
            _correct(T, jerk, goal[0] - q, goal[1] - v, goal[2] - a, SAME_PLACE * max(1.0, abs(q)))


@inlined
def _correct(T: Array, jerk: Array, m0: float, m1: float, m2: float, same: float) -> None:
    """Change jerks (N,) by the least amount that adds m0, m1 and m2 to the final position, velocity and acceleration.

    The position is free if m0 is NaN or at most `same`. The amount is Σ h δ² over the pieces, so that δ = Rᵀ y / h with
    (R diag(1/h) Rᵀ) y = m, where row i of R is the effect of the jerks on the final derivative of order i.
    """
    N, end = T.size - 1, T[-1]
    g00, g01, g02, g11, g12, g22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(N):
        h, left = T[i + 1] - T[i], end - T[i + 1]
        r0, r1 = h * h / 6.0 + 0.5 * left * (h + left), 0.5 * h + left  # over h
        g00, g01, g02 = g00 + h * r0 * r0, g01 + h * r0 * r1, g02 + h * r0
        g11, g12, g22 = g11 + h * r1 * r1, g12 + h * r1, g22 + h
    b11, b01, b00 = g11 - g12 * g12 / g22, g01 - g02 * g12 / g22, g00 - g02 * g02 / g22
    n1 = m1 - m2 * g12 / g22
    y0 = (m0 - m2 * g02 / g22 - n1 * b01 / b11) / (b00 - b01 * b01 / b11) if abs(m0) > same else 0.0
    y1 = (n1 - b01 * y0) / b11
    y2 = (m2 - g12 * y1 - g02 * y0) / g22
    for i in range(N):
        h, left = T[i + 1] - T[i], end - T[i + 1]
        jerk[i] += (h * h / 6.0 + 0.5 * left * (h + left)) * y0 + (0.5 * h + left) * y1 + y2


@parallel
def join_phases(h: Array, j: Array, ends: tuple[Array, Array], knots: Array, count: Indices, c: Array) -> None:
    """Write the cubics of phases of constant jerk from states to states, without phases of no duration.

    Shapes and units: durations h (n, k) [s] and jerks j (n, k) [rad/s³, m/s³], two states (3, n), knots (n, K), count (n,),
    cubics c (n, 4, K).
    """
    jerk, jerks, end = np.empty(knots.shape[1]), np.empty(knots.shape), 0.0
    for i in range(h.shape[0]):
        knots[i, 0], N = 0.0, 0
        parts = 3 if (h[i] > SHORTEST).sum() < 3 else 1  # three numbers are corrected
        for k in range(h.shape[1]):
            for _ in range(parts if h[i, k] > SHORTEST else 0):
                jerk[N], knots[i, N + 1] = j[i, k], knots[i, N] + h[i, k] / parts
                N += 1
        if N == 0:  # nothing moves
            N, jerk[:3] = 3, 0.0
            knots[i, 1:4] = np.arange(1, 4) * BRIEF_REST
        for k in range(1, N + 1):  # knots of joints that differ by rounding are the same
            for other in range(i):
                for near in knots[other, 1 : count[other]]:
                    knots[i, k] = near if abs(near - knots[i, k]) < SAME_KNOT else knots[i, k]
        count[i] = N + 1
        jerks[i, :N] = jerk[:N]
        end = max(end, knots[i, N])
    for i in range(h.shape[0]):
        N = count[i] - 1
        if end - knots[i, N] < SAME_TIME:  # joints that end together may still move there
            knots[i, N] = end
        state, goal = ends[0][:, i].copy(), ends[1][:, i].copy()
        integrate(knots[i, : N + 1], jerks[i, :N], state, goal, c[i])


@parallel
def _merge(knots: Array, count: Indices, c: Array, t: Array, out: Array) -> None:
    """Write the cubics out (4, m, n) of all joints between the knots t (m + 1,), which contain those of each joint."""
    for j in range(count.size):
        last, piece = count[j] - 2, 0
        for k in range(t.size - 1):
            while piece < last and t[k] >= knots[j, piece + 1]:
                piece += 1
            over = t[k] >= knots[j, last + 1]
            u = min(t[k], knots[j, last + 1]) - knots[j, piece]
            a, b, v, q = c[j, 0, piece], c[j, 1, piece], c[j, 2, piece], c[j, 3, piece]
            out[3, k, j] = ((a * u + b) * u + v) * u + q
            out[2, k, j] = 0.0 if over else (3.0 * a * u + 2.0 * b) * u + v
            out[1, k, j] = 0.0 if over else 3.0 * a * u + b
            out[0, k, j] = 0.0 if over else a


class JointCubics:
    """A joint motion from a moving state to rest: cubics of each joint between knots of its own.

    Parameters
    ----------
    knots : (n, K) array
        Times of the knots from 0 [s], the first `count` of each row.
    count : (n,) array of int
        Numbers of knots. A joint whose last knot is earlier than those of others is at rest after it.
    c : (n, 4, K) array
        Coefficients, highest power first, in the time since each piece's first knot [rad/s^i, m/s^i].
    """

    def __init__(self, knots: Array, count: Indices, c: Array) -> None:
        self.knots, self.count, self.c = knots, count, c
        self.end = float(max(knots[j, k - 1] for j, k in enumerate(count.tolist())))

    @cached_property
    def trajectory(self) -> Trajectory:
        """The same motion with the knots of all joints."""
        t, c = self._pieces()
        return Trajectory(scipy.interpolate.PPoly.construct_fast(c, t, extrapolate=True))

    def onto(self, other: Trajectory, t: float, state: Array) -> Trajectory:
        """Return this motion, followed by the rest of another one from its state (3, n) at a time t [s].

        Durations of pieces change by the rounding of their knots. Least changes of the jerks keep the acceleration continuous.
        """
        (knots, cubics), first = self._pieces(), int(np.searchsorted(other.knots, t, side="right")) - 1
        later, m = knots[-1] + (other.knots[first + 1 :] - t), knots.size - 1
        c = np.zeros((6, m + later.size, cubics.shape[2]))
        c[2:, :m], c[:, m:], u = cubics, other.padded[:, first:], t - other.knots[first]
        c[2, m] += u * (4.0 * c[1, m] + 10.0 * u * c[0, m])
        c[1, m] += 5.0 * u * c[0, m]
        c[3:, m] = 0.5 * state[2], state[1], state[0]
        knots = np.append(knots, later)
        h = np.diff(knots)[:, None]
        wrong = 2.0 * c[3] + h * (6.0 * c[2] + h * (12.0 * c[1] + 20.0 * h * c[0]))  # over the next acceleration
        wrong[:-1] -= 2.0 * c[3, 1:]
        c[2] -= wrong / np.maximum(6.0 * h, BRIEF_REST)
        return without_rounding(c, knots)

    def _pieces(self) -> tuple[Array, Array]:
        """Return the knots (m + 1,) of all joints, and the cubics (4, m, n) between them."""
        t = np.unique(np.concatenate([self.knots[j, :k] for j, k in enumerate(self.count.tolist())]))
        c = np.empty((4, t.size - 1, self.count.size))
        _merge(self.knots, self.count, self.c, t, c)
        return t, c


# ---------------- time-optimal joint motions between two states


INSIDE = 2e-8
"""Distance [rad, m] to the end of a range at which a jogged joint stops: above what Ruckig's goals are off by."""


class Transfer:
    """Motions between states within the limits (n, 4, 2) of position, velocity, acceleration and jerk, lower and upper."""

    def __init__(self, limits: Array) -> None:
        self.n, self._limits = len(limits), limits
        import ruckig  # only where it is used, because it loads for long

        self._ruckig, self._solver = ruckig, ruckig.Ruckig(self.n)
        jerk = np.minimum(limits[:, 3, 1], -limits[:, 3, 0])
        self._sides = [*(limits[:, i, side].tolist() for i in (1, 2) for side in (0, 1)), jerk.tolist()]

    def to_state(self, state: Array, goal: Array) -> JointCubics | None:
        """Return the motion from a state (3, n) to a goal (3, n), whose joints end together."""
        answer = self.find(state, goal)
        return None if answer is None else build(state, goal, answer)

    def find(self, state: Array, goal: Array, most: Array | None = None, together: bool = True) -> Any:
        """Return Ruckig's trajectory from a state to a goal, or None; its joints end together, or each at once.

        `most` (2, n) are other limits on the velocity, lower and upper.
        """
        problem = self._problem(state, goal)
        if most is not None:
            problem.min_velocity, problem.max_velocity = most[0].tolist(), most[1].tolist()
        problem.target_position = goal[0].tolist()
        if not together:
            problem.synchronization = self._ruckig.Synchronization.No
        return self._solve(problem)

    def jog(self, state: Array, velocity: Array, hold: float) -> JointCubics | None:
        """Return the motion to a joint velocity (n,), which is stopped `hold` [s] after the start, or at the end of a range."""
        target = np.zeros((3, self.n))
        target[1] = np.clip(velocity, self._limits[:, 1, 0], self._limits[:, 1, 1])
        ramp = self._velocity_phases(state, target)
        if ramp is None:
            return None
        h, j = ramp
        ends = np.minimum(np.cumsum(h, axis=1), hold)
        head = np.diff(np.column_stack([ends, np.full(self.n, hold)]), axis=1, prepend=0.0), np.pad(j, ((0, 0), (0, 1)))
        then = state
        if hold >= SAME_TIME:
            moving = join_states(state, np.full((3, self.n), np.nan), *head).trajectory
            then = np.stack([moving(moving.end, order) for order in range(3)])
        stop = self._velocity_phases(then, np.zeros((3, self.n)))
        if stop is None:
            return None
        h, j = (np.concatenate(parts, axis=1) for parts in zip(head, stop, strict=True))
        goal = np.zeros((3, self.n))
        goal[0] = np.nan
        motion = join_states(state, goal, h, j)
        goal[0] = motion.trajectory(motion.end)
        low, high = self._limits[:, 0, 0] + INSIDE, self._limits[:, 0, 1] - INSIDE
        outside = (goal[0] < low) | (goal[0] > high)
        if not outside.any():
            return motion
        # A joint that would leave its range moves to the end of it instead, no faster.
        goal[0] = np.clip(goal[0], low, high)
        most = np.where(outside, np.maximum(np.abs(target[1]), 1e-3), np.inf)
        limit = np.clip(np.stack([-most, most]), self._limits[:, 1, 0], self._limits[:, 1, 1])
        answer = self.find(state, goal, limit, together=False)
        if answer is None:
            return None
        goal[0] = np.nan  # to end exactly there would take a jerk beyond the limit
        for old, new in zip((h, j), _phases(answer), strict=True):
            old[outside], old[outside, : new.shape[1]] = 0.0, new[outside]
        return join_states(state, goal, h, j)

    def _problem(self, state: Array, goal: Array) -> Any:
        problem = self._ruckig.InputParameter(self.n)
        problem.current_position, problem.current_velocity, problem.current_acceleration = state.tolist()
        problem.target_velocity, problem.target_acceleration = goal[1].tolist(), goal[2].tolist()
        problem.min_velocity, problem.max_velocity, problem.min_acceleration, problem.max_acceleration = self._sides[:4]
        problem.max_jerk = self._sides[4]
        return problem

    def _velocity_phases(self, state: Array, target: Array) -> tuple[Array, Array] | None:
        problem = self._problem(state, target)
        problem.control_interface = self._ruckig.ControlInterface.Velocity
        problem.synchronization = self._ruckig.Synchronization.No
        answer = self._solve(problem)
        return None if answer is None else _phases(answer)

    def _solve(self, problem: Any) -> Any:
        answer = self._ruckig.Trajectory(self.n)
        try:
            result = self._solver.calculate(problem, answer)
        except (self._ruckig.RuckigError, RuntimeError):
            return None
        return answer if result in (self._ruckig.Result.Working, self._ruckig.Result.Finished) else None


def _phases(answer: Any) -> tuple[Array, Array]:
    """Return durations [s] and jerks (n, k) of Ruckig's trajectory."""
    profiles = answer.profiles[0]
    return np.array([p.brake.t + p.t for p in profiles]), np.array([p.brake.j + p.j for p in profiles])


def build(state: Array, goal: Array, answer: Any) -> JointCubics:
    """Return Ruckig's trajectory from a state (3, n) to a goal (3, n), exact at both."""
    return join_states(state, goal, *_phases(answer))


def join_states(state: Array, goal: Array, h: Array, j: Array) -> JointCubics:
    """Return the motion of phases of constant jerk, durations h and jerks j (n, k), from a state (3, n) to a goal (3, n)."""
    n, k = h.shape
    knots, count, c = np.zeros((n, 3 * k + 1)), np.zeros(n, dtype=np.int64), np.zeros((n, 4, 3 * k))
    join_phases(h, j, (state, goal), knots, count, c)
    return JointCubics(knots, count, c)


# ---------------- the pace of a reference


PLACES, APART = (40, 2000), 0.02
"""Least and largest number of places of a sweep, and their distance between these numbers [s]."""
HALVINGS = 22
"""Bisections of ṡ² at a place."""
VELOCITY_PART, ACCELERATION_PART, OTHER_PART = 0.995, 0.95, 0.9
"""Fractions of the limits on velocity, on acceleration, and of all others that a pace uses."""
LEAST_PACE, FADE = 0.1, 0.2
"""Least ṡ of a pace, also where the limits stop it, since tracking respects them; and its fall [1/s] at the end, in ṡ²."""
NO_RATE = 1e-9
"""Rate of a joint [1] below which it does not limit s̈."""


@inlined
def _bracket(row: Array, x: float, low: float, high: float) -> tuple[float, float]:
    """Return the interval of s̈ in [low, high] that a row (4,) over s̈, ṡ², ṡ, 1 allows at ṡ² = x; empty if low > high."""
    rest = row[1] * x + row[2] * np.sqrt(x) + row[3]
    if abs(row[0]) < NO_RATE:
        return (low, high) if abs(rest) <= 1.0 else (1.0, -1.0)
    a, b = (-1.0 - rest) / row[0], (1.0 - rest) / row[0]
    return max(low, min(a, b)), min(high, max(a, b))


@parallel
def sweep_pace(s: Array, rows: Array, cap: Array, first: float, slowest: float, x: Array, t: Array) -> None:
    """Write the largest ṡ² x (k,) along places s (k,), from `first` to rest, and before it not below `slowest`; and times t.

    Each place has rows (k, m, 4) over s̈, ṡ², ṡ and 1, which are respected where their values are in [−1, 1], and a largest
    ṡ² cap (k,). The backward sweep finds the largest ṡ² from which the next place can be reached, by bisection.
    """
    k = s.size
    K = np.empty(k)
    for i in range(k - 1, -1, -1):
        low, high = 0.0, cap[i] if i < k - 1 else 0.0
        for trial in range(HALVINGS):
            y = high if trial == 0 else 0.5 * (low + high)
            least, most = -np.inf, np.inf
            if i < k - 1:
                step = 2.0 * (s[i + 1] - s[i])
                least, most = -y / step, (K[i + 1] - y) / step
            for j in range(rows.shape[1]):
                least, most = _bracket(rows[i, j], y, least, most)
                if least > most:
                    break
            if least <= most:
                low = y
                if trial == 0:
                    break
            else:
                high = y
        K[i] = low
    x[0], t[0] = min(first, K[0]), 0.0
    for i in range(k - 1):
        step = 2.0 * (s[i + 1] - s[i])
        most = (K[i + 1] - x[i]) / step
        for j in range(rows.shape[1]):
            _, most = _bracket(rows[i, j], x[i], -np.inf, most) if abs(rows[i, j, 0]) >= NO_RATE else (0.0, most)
        floor = min(slowest, FADE * (s[k - 1] - s[i + 1]))
        x[i + 1] = max(min(x[i] + step * most, K[i + 1]), floor)
        t[i + 1] = t[i] + step / max(np.sqrt(x[i]) + np.sqrt(x[i + 1]), NO_RATE)


@parallel
def write_joint_rows(R: Array, limits: Array, pace: float, rows: Array, cap: Array) -> None:
    """Write the rows of the accelerations, and the largest ṡ² by velocities, jerks and the pace.

    Shapes and units: R (k, 4, n) [rad/s^i, m/s^i], limits (n, 4, 2) of position, velocity, acceleration and jerk, lower and
    upper, rows (k, n, 4) [1], cap (k,) [1].
    """
    for i in range(R.shape[0]):
        cap[i] = pace * pace
        for j in range(R.shape[2]):
            first, second, third = R[i, 1, j], R[i, 2, j], abs(R[i, 3, j])
            if abs(first) > NO_RATE:
                v = min(limits[j, 1, 1], -limits[j, 1, 0])
                cap[i] = min(cap[i], (VELOCITY_PART * v / first) ** 2)
            if third > NO_RATE:
                cap[i] = min(cap[i], (min(limits[j, 3, 1], -limits[j, 3, 0]) / third) ** (2.0 / 3.0))
            middle = 0.5 * (limits[j, 2, 1] + limits[j, 2, 0])
            half = 0.5 * ACCELERATION_PART * (limits[j, 2, 1] - limits[j, 2, 0])
            rows[i, j, 0], rows[i, j, 1] = first / half, second / half
            rows[i, j, 2], rows[i, j, 3] = 0.0, -middle / half


@parallel
def smooth_pace(s: Array, t: Array, first: float, width: float, when: Array, out: Array) -> None:
    """Write the means of s(t) over centred windows, at instants `when`; before t = 0 the rate is `first`.

    A mean bounds the jerk of the pace. A window behind the instant would lag by half its width.
    """
    k, end = s.size, s[-1]
    integral = np.zeros(k)
    for i in range(k - 1):
        integral[i + 1] = integral[i] + 0.5 * (s[i] + s[i + 1]) * (t[i + 1] - t[i])
    for w in range(when.size):
        sides = (0.0, 0.0)
        for side in range(2):
            y = when[w] + (side - 0.5) * width
            if y <= 0.0:
                value = s[0] * y + 0.5 * first * y * y
            elif y >= t[-1]:
                value = integral[-1] + end * (y - t[-1])
            else:
                i = min(max(np.searchsorted(t, y, side="right") - 1, 0), k - 2)
                u, slope = y - t[i], (s[i + 1] - s[i]) / max(t[i + 1] - t[i], 1e-12)
                value = integral[i] + s[i] * u + 0.5 * slope * u * u
            sides = (value, sides[1]) if side == 0 else (sides[0], value)
        out[w] = min((sides[1] - sides[0]) / width, end)
