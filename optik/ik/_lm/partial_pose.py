"""One attempt of `lm` for a task that constrains a part of the pose."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.ik._gauss_newton import Rule, descend_inside
from optik.ik._lm.winding import inside_winding
from optik.ik.problem import OUTSIDE_LIMITS, SOLVED, STALLED
from optik.kinematics import Chain, Range
from optik.task import Goal
from optik.types import Array, Flags


@compiled
def wrap_configuration(prismatic: Flags, limits: Range, start: Array, q: Array) -> bool:
    """Bring q inside the limits by 2π-multiples nearest to the initial guess, else clamp it; return whether q is unchanged.

    Shapes and units: prismatic (n,), start (n,) [rad, m], q (n,) [rad, m] (overwritten).
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
def attempt_task(
    chain: Chain, limits: Range, goal: Goal, rule: Rule, clamped: bool, q: Array, trace: Array
) -> tuple[int, int]:  # fmt: skip
    """Iterate from q (n,) inside the limits; or ignore the limits until the task is met outside them, then iterate inside.

    Returns the number of steps, and SOLVED, MAX_ITERATIONS, STALLED or OUTSIDE_LIMITS; `trace` is that of `descend_inside`.
    """
    (lower, upper), start, iteration = limits, q.copy(), 0
    if not clamped:
        low, high = lower.copy(), upper.copy()
        for i in range(q.shape[0]):
            if lower[i] < upper[i]:
                low[i], high[i] = -np.inf, np.inf
        iteration, code, _, _ = descend_inside(chain, (low, high), goal, rule, 0, q, trace)
        if wrap_configuration(chain[1], limits, start, q) or code != SOLVED:
            return iteration, code
    iteration, code, _, _ = descend_inside(chain, limits, goal, rule, iteration, q, trace)
    return iteration, OUTSIDE_LIMITS if code == STALLED and not clamped else code
