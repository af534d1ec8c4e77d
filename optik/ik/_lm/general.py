"""One attempt of `lm` at any task: damped Gauss–Newton steps on the masked error, one target at a time."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.ik._lm.packed import (
    AT_GAIN,
    AT_ITERATIONS,
    AT_LEAST_DAMPING,
    AT_PATIENCE,
    AT_PROGRESS,
    AT_TOLERANCE_P,
    AT_TOLERANCE_R,
)  # fmt: skip
from optik.ik._lm.winding import inside_winding
from optik.ik._status import MAX_ITERATIONS, OUTSIDE_LIMITS, SOLVED, STALLED
from optik.kinematics import Chain, Range, workspace
from optik.linear import copy_vector, damped_step
from optik.task import Goal, goal_error, goal_jacobian
from optik.types import Array, Flags


@compiled
def settle_inside(prismatic: Flags, limits: Range, start: Array, q: Array) -> bool:
    """Bring a configuration inside the limits: by whole turns nearest to the start, else clamped.

    Parameters
    ----------
    prismatic : (n,) array of bool
        Which joints slide.
    limits : Range
        Position limits.
    start : (n,) array
        Start of the solve [rad, m].
    q : (n,) array
        Configuration [rad, m]; overwritten.

    Returns
    -------
    bool
        Whether it was inside already.
    """
    lower, upper = limits
    same = True
    for i in range(q.shape[0]):
        x = q[i] if prismatic[i] else inside_winding(q[i], start[i], lower[i], upper[i])
        x = min(max(x, lower[i]), upper[i])
        same = same and x == q[i]
        q[i] = x
    return same


@compiled
def hold_locked(limits: Range, J: Array) -> None:
    """Take locked joints, whose limits are equal, out of a Jacobian.

    Parameters
    ----------
    limits : Range
        Position limits.
    J : (6, n) array
        Jacobian [m/rad, 1]; columns of locked joints are set to 0.
    """
    lower, upper = limits
    for i in range(J.shape[1]):
        if lower[i] == upper[i]:
            for r in range(6):
                J[r, i] = 0.0


@compiled
def attempt_task(
    chain: Chain, limits: Range, goal: Goal, numbers: Array, clamped: bool, q: Array, trace: Array
) -> tuple[int, int]:  # fmt: skip
    """Iterate from one start, clamped to the limits, or free of them until the task is met outside.

    Parameters
    ----------
    chain : Chain
        The arm.
    limits : Range
        Its position limits.
    goal : Goal
        The task and its target.
    numbers : (9,) array
        Options of the search [as `pack` takes them].
    clamped : bool
        Whether steps are clamped to the limits from the start.
    q : (n,) array
        Initial guess inside the limits [rad, m]; overwritten by the last iterate.
    trace : (iterations + 1, 6) or (0, 6) array
        Error of every iterate [m, rad], where it has rows; overwritten.

    Returns
    -------
    iteration : int
        Steps taken.
    code : int
        SOLVED, MAX_ITERATIONS, STALLED or OUTSIDE_LIMITS.
    """
    n, prismatic, (flags, target), (lower, upper) = q.shape[0], chain[1], goal, limits
    (frame, T, J), start = workspace(n), q.copy()
    A, y, dq, e, w = np.empty((6, 6)), np.empty(6), np.empty(n), np.empty(6), np.empty(3)
    least, stalls, iteration, settled = np.inf, 0, 0, False
    while True:
        p2, r2 = goal_error(chain, flags, target, q, frame, T, e, w)
        if trace.shape[0] > 0:
            copy_vector(e, trace[iteration])
        cost = 0.5 * (p2 + r2)
        if p2 <= numbers[AT_TOLERANCE_P] ** 2 and r2 <= numbers[AT_TOLERANCE_R] ** 2:
            if settled or settle_inside(prismatic, limits, start, q):
                return iteration, SOLVED
            settled, clamped, least, stalls = True, True, np.inf, 0
            continue
        if cost < numbers[AT_PROGRESS] * least:
            least, stalls = cost, 0
        else:
            stalls += 1
        if iteration >= numbers[AT_ITERATIONS]:
            return iteration, MAX_ITERATIONS
        if stalls >= numbers[AT_PATIENCE] or not cost < np.inf:
            return iteration, OUTSIDE_LIMITS if clamped else STALLED
        goal_jacobian(chain, flags, target, frame, T, w, J)
        hold_locked(limits, J)
        if not damped_step(J, e, numbers[AT_GAIN] * cost + numbers[AT_LEAST_DAMPING], A, y, dq, 0.0):
            return iteration, STALLED
        for i in range(n):
            q[i] += dq[i]
            if clamped:
                q[i] = min(max(q[i], lower[i]), upper[i])
        iteration += 1
