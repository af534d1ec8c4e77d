"""The rate limiter of libfranka 0.9 for the Panda, which changes joint positions at 1 kHz that it finds too fast."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from optik.check import real_array
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.types import Array
from planners.limits import MotionLimits

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
        given = real_array(q, "q", expected)
        if given.ndim != 2 or given.shape[1] != VELOCITY.size or not np.isfinite(given).all():
            raise InvalidInput("q", f"an array of shape {given.shape}", expected)
        out = given.copy()
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
