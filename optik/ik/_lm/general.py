"""One attempt at any task, whatever it leaves free: the search of `_search` for a masked error, one target at a time."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.ik._lm.winding import inside_winding
from optik.kinematics import Chain, frames, jacobian_from, tool_pose
from optik.linear import damped_step
from optik.task import task_error, task_rows
from optik.types import Array, Flags

SOLVED, MAX_ITERATIONS, STALLED, OUTSIDE_LIMITS = 0, 1, 2, 4


@compiled
def settle(prismatic: Flags, lower: Array, upper: Array, start: Array, q: Array) -> bool:
    """Bring q (n,) inside the limits, by whole turns to the winding nearest to the start, else to the limit itself.

    Returns whether it stood there already.
    """
    same = True
    for i in range(q.shape[0]):
        x = q[i] if prismatic[i] else inside_winding(q[i], start[i], lower[i], upper[i])
        x = min(max(x, lower[i]), upper[i])
        same = same and x == q[i]
        q[i] = x
    return same


@compiled
def attempt_task(
    chain: Chain,
    lower: Array,
    upper: Array,
    flags: Array,
    target: Array,
    numbers: Array,
    clamped: bool,
    q: Array,
    trace: Array,
) -> tuple[int, int]:
    """Iterate from q (n,) in place, cut to the limits or free of them until the task is met outside; errors into trace.

    numbers are (tolerances, gain, least damping, iterations, –, –, patience, progress). Returns (iterations, status).
    """
    _fixed, prismatic, _tool = chain
    n = q.shape[0]
    frame, T, J = np.empty((n, 4, 4)), np.empty((4, 4)), np.empty((6, n))
    A, y, dq, e, w, start = np.empty((6, 6)), np.empty(6), np.empty(n), np.empty(6), np.empty(3), q.copy()
    least, stalls, iteration, settled = np.inf, 0, 0, False
    while True:
        frames(chain, q, frame)
        tool_pose(chain, frame, T)
        task_error(T, target, flags, e, w)
        if trace.shape[0] > 0:
            for i in range(6):
                trace[iteration, i] = e[i]
        p2 = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
        r2 = e[3] * e[3] + e[4] * e[4] + e[5] * e[5]
        cost = 0.5 * (p2 + r2)
        if p2 <= numbers[0] * numbers[0] and r2 <= numbers[1] * numbers[1]:
            if settled or settle(prismatic, lower, upper, start, q):
                return iteration, SOLVED
            settled, clamped, least, stalls = True, True, np.inf, 0
            continue
        if cost < numbers[8] * least:
            least, stalls = cost, 0
        else:
            stalls += 1
        if iteration >= numbers[4]:
            return iteration, MAX_ITERATIONS
        if stalls >= numbers[7] or not cost < np.inf:
            return iteration, OUTSIDE_LIMITS if clamped else STALLED
        jacobian_from(chain, frame, T, J)
        task_rows(target, flags, w, J)
        for i in range(n):
            if lower[i] == upper[i]:
                for r in range(6):
                    J[r, i] = 0.0
        if not damped_step(J, e, numbers[2] * cost + numbers[3], A, y, dq, 0.0):
            return iteration, STALLED
        for i in range(n):
            q[i] += dq[i]
            if clamped:
                q[i] = min(max(q[i], lower[i]), upper[i])
        iteration += 1
