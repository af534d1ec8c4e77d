"""Joint motions as piecewise cubics, each joint with its own knots: exact extrema, and the trajectory of all."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy

from optik.compiled import inlined, parallel
from optik.types import Array, Indices
from planners.trajectory import Trajectory, without_rounding

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
