"""Discontinuities of a motion's derivatives, for each joint on its own scale, and rest at its start and end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.types import Array, Flags
from planners.certificate.violation import Violation
from planners.trajectory import Trajectory

JUMP = 1e-5
"""Difference of one-sided values above which it is a jump, relative to the joint's largest value of that derivative."""
STEP_ROUNDING = 1e-14
"""Rounding error of a derivative: this fraction of q, over the shorter piece's duration to the power of the order."""
FROM_AFAR = 0.1
"""Least q [rad or m] in the rounding error: a motion that ends at 0 keeps the rounding error of its earlier positions."""
AT_REST = 1e-9
"""Final velocity, relative to the joint's largest one, below which it is at rest; the rounding error is added."""


class Jump(NamedTuple):
    """A discontinuity of a joint's position or velocity [rad, m, or per s], and its time [s]."""

    size: float
    t: float
    joint: int


def jumps(trajectory: Trajectory) -> Flags:
    """Return where a joint's derivative steps by more than rounding error, each joint on its own scale."""
    standing = rest(trajectory)
    size = np.abs(np.stack([steps(trajectory, order, standing) for order in range(4)]))
    worst = np.stack([trajectory.extrema(order).worst for order in range(4)])
    return np.asarray(size > JUMP * worst[:, None] + _rounding(trajectory))


def _rounding(trajectory: Trajectory) -> Array:
    """Return the rounding errors of derivatives (4, m + 1, n) at the knots, from the shorter of the adjacent pieces."""
    h = np.diff(trajectory.knots)
    shorter = np.minimum(np.append(h, h[-1]), np.append(h[0], h))
    size = np.maximum(trajectory.extrema(0).worst, FROM_AFAR)
    return np.asarray(STEP_ROUNDING * size / (shorter[:, None] ** np.arange(4)).T[:, :, None])


def rest(trajectory: Trajectory) -> tuple[bool, bool]:
    """Return whether a motion starts and ends at rest, each joint on its own scale.

    The start is at rest only within rounding error: a motion that is replanned just after its start is slow but moves.
    """
    first, last = trajectory.ends(1)
    begin, end = _rounding(trajectory)[1, [0, -1]]
    still = AT_REST * trajectory.extrema(1).worst
    begin, end = (
        np.minimum(begin, still),
        end + still,
    )  # the remaining motion just before the end is slow but not at rest
    return bool((np.abs(first[0]) <= begin).all()), bool((np.abs(last[-1]) <= end).all())


def steps(trajectory: Trajectory, order: int, standing: tuple[bool, bool] | None = None) -> Array:
    """Return the steps of a derivative at all knots; an end at rest continues with standstill."""
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
