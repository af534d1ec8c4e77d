"""Controllers that change or follow set-points, each with its public source."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import ArrayLike

from optik.check import check_number, real_array
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.types import Array
from planners.limits import MotionLimits
from planners.trajectory import Trajectory

# ---------------- the rate limiter of libfranka 0.9 for the Panda, which changes positions at 1 kHz that it finds too fast


LIMITER_PERIOD, EPSILON, LOST_PACKETS = 1e-3, 1e-3, 3
"""Period [s], margin of all limits, and the lost packets after which the velocity limits still hold, as in libfranka."""
ACCELERATION = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]) - EPSILON
"""Largest accelerations [rad/s²]."""
JERK = np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0]) - EPSILON
"""Largest jerks [rad/s³]."""
VELOCITY = np.array([2.175] * 4 + [2.61] * 3) - EPSILON - LOST_PACKETS * LIMITER_PERIOD * ACCELERATION
"""Largest velocities [rad/s]."""


class FrankaLimiter:
    """The limiter ``franka::limitRate`` for joint positions, without libfranka's low-pass filter.

    Source: libfranka 0.9.2, ``include/franka/rate_limiting.h`` and ``src/rate_limiting.cpp``
    (https://github.com/frankaemika/libfranka).

    Attributes
    ----------
    limits : MotionLimits
        Limits of streams that the limiter does not change. Near its velocity limit V it bounds accelerations by (J/A) (V − v).
        Samples with velocities up to u = V − A²/(2 J) and accelerations that change by at most J Δ per period Δ respect this:
        from an acceleration a to 0, the velocity still rises by Δ (a + (a − J Δ) + …) ≥ a²/(2 J). So V − v is at least
        A²/(2 J) + a²/(2 J) ≥ a A/J. Differences of a motion's samples are means of its derivatives, so they have its limits.
    """

    limits = MotionLimits(velocity=VELOCITY - ACCELERATION**2 / (2.0 * JERK), acceleration=ACCELERATION, jerk=JERK)

    def apply(self, q: ArrayLike) -> Array:
        """Return the positions that the limiter sends for positions at 1 kHz from rest.

        Parameters
        ----------
        q : (k, 7) array
            Positions [rad].

        Returns
        -------
        (k, 7) array
            The positions after the limiter [rad].

        Raises
        ------
        InvalidInput
            Not seven finite positions in each row.
        """
        expected = "a (k, 7) array of finite positions"
        positions = real_array(q, "q", expected)
        if positions.ndim != 2 or positions.shape[1] != VELOCITY.size or not np.isfinite(positions).all():
            raise InvalidInput("q", f"an array of shape {positions.shape}", expected)
        out = positions.copy()
        _limit(out, VELOCITY.copy(), ACCELERATION.copy(), JERK.copy())
        return out


@compiled
def _limit(q: Array, velocity: Array, acceleration: Array, jerk: Array) -> None:
    """Limit positions q (k, n) [rad] in place."""
    for j in range(q.shape[1]):
        last, v, a = q[0, j], 0.0, 0.0
        V, A, J = velocity[j], acceleration[j], jerk[j]
        for k in range(1, q.shape[0]):
            wanted = (((q[k, j] - last) / LIMITER_PERIOD - v) / LIMITER_PERIOD - a) / LIMITER_PERIOD
            a_wanted = a + max(min(wanted, J), -J) * LIMITER_PERIOD
            a_most, a_least = min(J / A * (V - v), A), max(J / A * (-V - v), -A)
            v_next = v + max(min(a_wanted, a_most), a_least) * LIMITER_PERIOD
            a = (v_next - v) / LIMITER_PERIOD
            v = v_next
            last = last + v * LIMITER_PERIOD
            q[k, j] = last


# ---------------- the command servoj of Universal Robots, which follows set-points with a gain and a lookahead time


SERVO_PERIOD = 2e-3
"""Period of e-Series controllers [s]."""
SERVO_AT_REST = 1e-12
"""Distance [rad] to the last set-point, and velocity [rad/s], at which the arm is at rest."""
LOOKAHEAD, GAIN = (0.03, 0.2), (100.0, 2000.0)
"""Ranges of the options, from the script manual [s, 1/s²]."""


class ServoJ:
    """A model of ``servoj(q, t=0.002, lookahead_time, gain)``: q̈ = gain (q_set − q − lookahead q̇) for one period.

    Source: the description of gain (a proportional term) and lookahead time (a projection of the position by the velocity) in
    https://www.universal-robots.com/articles/ur/programming/servoj-command. The manual has no formula and no unit of the gain:
    this is the simplest formula that fits its words, and a real arm may differ.

    Parameters
    ----------
    lookahead : float
        Lookahead time, 0.03 to 0.2 [s].
    gain : float
        Gain, 100 to 2000 [1/s²].

    Raises
    ------
    InvalidInput
        An option out of its range.
    """

    def __init__(self, lookahead: float = 0.1, gain: float = 300.0) -> None:
        for name, value, (least, most) in (("lookahead", lookahead, LOOKAHEAD), ("gain", gain, GAIN)):
            if check_number(value, name, f"a number in [{least:g}, {most:g}]", least=least) > most:
                raise InvalidInput(name, value, f"a number in [{least:g}, {most:g}]")
        self.lookahead, self.gain = lookahead, gain

    def follow(self, q: ArrayLike) -> Trajectory:
        """Return what the arm makes of set-points, for `planners.certify`.

        Parameters
        ----------
        q : (k, n) array
            Set-points at 500 Hz [rad], the first one at rest.

        Returns
        -------
        Trajectory
            The motion of the arm, with a constant acceleration in each period, until it is at rest at the last set-point.

        Raises
        ------
        InvalidInput
            Fewer than two set-points, or numbers that are not finite.
        """
        expected = "a (k, n) array of at least two finite set-points"
        targets = real_array(q, "q", expected)
        if targets.ndim != 2 or len(targets) < 2 or not np.isfinite(targets).all():
            raise InvalidInput("q", f"an array of shape {targets.shape}", expected)
        pieces, place, speed, k = list[tuple[Array, Array, Array]](), targets[0], np.zeros(targets.shape[1]), 0
        while (
            k < len(targets) or np.abs(targets[-1] - place).max() > SERVO_AT_REST or np.abs(speed).max() > SERVO_AT_REST
        ):
            a = self.gain * (targets[min(k, len(targets) - 1)] - place - self.lookahead * speed)
            pieces.append((0.5 * a, speed, place))
            place, speed, k = place + SERVO_PERIOD * (speed + 0.5 * SERVO_PERIOD * a), speed + SERVO_PERIOD * a, k + 1
        t = SERVO_PERIOD * np.arange(k + 1)
        return Trajectory(scipy.interpolate.PPoly(np.stack(pieces, axis=1), t, extrapolate=True))
