"""Where derivatives of a motion jump, each joint judged on its own scale, and whether it begins and ends at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from optik.types import Array
from planners.trajectory import Trajectory

JUMP = 1e-5
"""A joint's derivative jumps where its one-sided values differ by more than this part of its own greatest value…"""
ROUNDING = 1e-14
"""…and by more than rounding can: this share of q, over the shorter piece's duration to the power of the derivative's order."""
STILL = 1e-9
"""A joint ends at rest where its velocity is below this part of its own greatest one, or below what rounding can make."""


def jumps(trajectory: Trajectory) -> NDArray[np.bool_]:
    """Where (4, m + 1, n) a joint's derivative of order 0 to 3 steps by more than rounding, each joint on its own scale."""
    standing = rest(trajectory)
    size = np.abs(np.stack([steps(trajectory, order, standing) for order in range(4)]))
    worst = np.stack([trajectory.extrema(order).worst for order in range(4)])
    return np.asarray(size > JUMP * worst[:, None] + _rounding(trajectory))


def _rounding(trajectory: Trajectory) -> Array:
    """What rounding may make of derivatives (4, m + 1, n) at the knots, where the shorter piece's duration divides it."""
    h = np.diff(trajectory.knots)
    shorter = np.minimum(np.append(h, h[-1]), np.append(h[0], h))
    return np.asarray(ROUNDING * trajectory.extrema(0).worst / (shorter[:, None] ** np.arange(4)).T[:, :, None])


def rest(trajectory: Trajectory) -> tuple[bool, bool]:
    """Whether a motion starts and ends at rest, each joint on its own scale.

    A start counts as rest only within rounding: a motion that has just begun, and is planned anew, is slow but moves.
    """
    first, last = trajectory.ends(1)
    begin, end = _rounding(trajectory)[1, [0, -1]]
    end = end + STILL * trajectory.extrema(1).worst
    return bool((np.abs(first[0]) <= begin).all()), bool((np.abs(last[-1]) <= end).all())


def steps(trajectory: Trajectory, order: int, standing: tuple[bool, bool] | None = None) -> Array:
    """How far (m + 1, n) a derivative steps at all knots; an end at rest counts as standstill before or after it."""
    first, last = trajectory.ends(order)
    start, end = (
        (standing or rest(trajectory)) if order else (False, False)
    )  # standstill is somewhere: q does not jump to it
    before = first[:1] if start else np.zeros_like(first[:1])
    after = -last[-1:] if end else np.zeros_like(last[-1:])
    return np.concatenate([before, trajectory.jumps(order), after])
