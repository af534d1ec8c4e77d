"""Kernels of `lm` for one target and for batches: lanes take problems, and their results are written."""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from optik.arm.limits import LIMIT_TOLERANCE as SLACK
from optik.compiled import compiled, inlined, parallel
from optik.ik._lm.lanes import (
    AT_BASE_P,
    AT_BASE_R,
    AT_FIRST,
    AT_LOWER,
    AT_TOOL_R,
    AT_UPPER,
    ATTEMPT,
    BEGINS,
    BEST_E,
    ENDING,
    FLAG,
    GEOMETRY,
    GOAL,
    HELD_JOINTS,
    ITERATION,
    LEAST_END,
    MOVED,
    PROBLEM,
    ROWS,
    TOTAL,
    Q,
    S,
    compute_errors,
    correct_half_turn,
    e,
    stack,
    step_lanes,
)  # fmt: skip
from optik.ik._lm.search import MEASURE, STEP, advance, flag_lanes, place_lane
from optik.se3 import is_pose
from optik.types import Array

INVALID_ARGUMENT = -3
"""Code of invalid arguments: the caller checks them again and raises."""
IDLE = -1.0
"""Number of the problem of a lane without one."""


class Answers(NamedTuple):
    """Arrays of the results: q (N, n), the others (N,); trace (6 k,) receives the errors of one attempt."""

    q: Array
    status: Any
    iterations: Any
    restarts: Any
    position_error: Array
    rotation_error: Array
    trace: Array


@inlined
def aim(arm: Array, target: Array, w: Array, l: int) -> None:
    """Write a target into the goal of a lane: relative to the first joint's frame, without the tool's rotation.

    Shapes and units: arm (size,) [as `pack` writes it], target (4, 4) [1, m], w (ROWS, L) [as the rows say] (overwritten).
    """
    for i in range(3):
        v = 0.0
        for m in range(3):
            v += arm[AT_BASE_R + 3 * m + i] * (target[m, 3] - arm[AT_BASE_P + m])
        w[GOAL + 9 + i, l] = v
        b0, b1, b2 = arm[AT_BASE_R + i], arm[AT_BASE_R + 3 + i], arm[AT_BASE_R + 6 + i]
        r0 = b0 * target[0, 0] + b1 * target[1, 0] + b2 * target[2, 0]
        r1 = b0 * target[0, 1] + b1 * target[1, 1] + b2 * target[2, 1]
        r2 = b0 * target[0, 2] + b1 * target[1, 2] + b2 * target[2, 2]
        for j in range(3):
            m = AT_TOOL_R + 3 * j
            w[GOAL + 3 * i + j, l] = r0 * arm[m] + r1 * arm[m + 1] + r2 * arm[m + 2]


@inlined
def load_kernels(arm: Array, w: Array, targets: Array, problem: int, l: int) -> None:
    """Assign a problem to a lane.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), targets (N, 4, 4) [1, m].
    """
    aim(arm, targets[problem], w, l)
    for i in range(PROBLEM, ROWS):
        w[i, l] = 0.0
    w[PROBLEM, l], w[ATTEMPT, l], w[BEST_E, l], w[LEAST_END, l] = problem, arm[AT_FIRST], np.inf, np.inf
    w[BEGINS, l], w[MOVED, l] = 1.0, 1.0


@inlined
def write_answer(w: Array, n: int, answers: Answers, l: int, status: int) -> None:
    """Write the result of a lane: w (ROWS, L) [as the rows say]."""
    p = int(w[PROBLEM, l])
    for i in range(n):
        answers.q[p, i] = w[Q + i, l]
    answers.status[p] = status
    answers.iterations[p], answers.restarts[p] = int(w[TOTAL, l]), int(w[ATTEMPT, l])
    answers.position_error[p], answers.rotation_error[p] = sqrt(w[S, l]), sqrt(w[S + 1, l])


@inlined
def write_trace(w: Array, trace: Array) -> None:
    """Write the error of the first lane into the trace of its attempt; a trace of one row keeps the last error.

    Shapes and units: w (ROWS, L) [as the rows say], trace (m,) [m, rad] (overwritten).
    """
    correct_half_turn(w, 0)
    if w[ENDING, 0] <= 0.0:
        row = int(w[ITERATION, 0]) if trace.shape[0] > 6 else 0
        for i in range(6):
            trace[6 * row + i] = w[e + i, 0]


@inlined
def solve_lanes(
    arm: Array, w: Array, g: Array, J: Array, n: int, targets: Array, starts: Array, answers: Answers
) -> None:
    """Solve all problems: every lane takes the next one as soon as its own is finished.

    Shapes and units: arm (size,) [as `pack` writes it], w (ROWS, L) [as the rows say] (overwritten), g (GEOMETRY, L) [m, 1]
    (overwritten), J (6 * n, L) [m/rad, 1] (overwritten), targets (N, 4, 4) [1, m], starts (N, n) [rad, m].
    """
    N, L = targets.shape[0], w.shape[1]
    waiting, busy = 0, 0
    for l in range(L):  # a lane without a problem computes a copy of another's, and its result is ignored
        load_kernels(arm, w, targets, min(waiting, N - 1), l)
        if waiting < N:
            waiting += 1
            busy += 1
        else:
            w[PROBLEM, l] = IDLE
    while busy > 0:
        for l in range(L):
            if w[MOVED, l] != 0.0:
                place_lane(arm, w, n, starts[max(int(w[PROBLEM, l]), 0)], l)
        compute_errors(arm, w, g, n)
        if answers.trace.shape[0] > 0:
            write_trace(w, answers.trace)
        flag_lanes(arm, w)
        stepping, holding = False, False
        for l in range(L):
            if w[FLAG, l] == 0.0 or w[PROBLEM, l] == IDLE:
                stepping = stepping or w[PROBLEM, l] != IDLE
                continue
            p = int(w[PROBLEM, l])
            status = advance(arm, w, n, targets[p], starts[p], l)
            if status == STEP:
                stepping = True
                holding = holding or w[HELD_JOINTS, l] != 0.0
            elif status != MEASURE:
                write_answer(w, n, answers, l, status)
                if waiting < N:
                    load_kernels(arm, w, targets, waiting, l)
                    waiting += 1
                else:
                    w[PROBLEM, l] = IDLE
                    busy -= 1
        if stepping:
            step_lanes(arm, w, g, J, n, holding)


def build_single(n: int) -> Any:
    """Build the kernel for one target."""
    n6 = 6 * n

    @compiled
    def solve_one(arm: Array, target: Array, q0: Array, out: Array) -> tuple[int, int, int, float, float]:
        """Write q into out (n,), and return the status code; a longer out also receives the errors of the iterates."""
        if target.shape[0] != 4 or target.shape[1] != 4 or not is_pose(target):
            return INVALID_ARGUMENT, 0, 0, 0.0, 0.0
        if q0.shape[0] != n:
            return INVALID_ARGUMENT, 0, 0, 0.0, 0.0
        for i in range(n):
            if not (arm[AT_LOWER + i] - SLACK <= q0[i] <= arm[AT_UPPER + i] + SLACK and abs(q0[i]) < np.inf):
                return INVALID_ARGUMENT, 0, 0, 0.0, 0.0
        w, g, J, x = stack(ROWS, 1), stack(GEOMETRY, 1), stack(n6, 1), stack(5, 1)
        answers = Answers(out[:n][None], x[0], x[1], x[2], x[3], x[4], out[n:])
        solve_lanes(arm, w, g, J, n, target[None], q0[None], answers)
        return int(x[0, 0]), int(x[1, 0]), int(x[2, 0]), x[3, 0], x[4, 0]

    return solve_one


def build_batch(n: int, L: int) -> Any:
    """Build the kernel for many targets."""
    n6 = 6 * n

    @parallel
    def solve_many(arm: Array, targets: Array, starts: Array, fields: Any) -> None:
        """Write the results of valid targets (N, 4, 4) and initial guesses (N, n) into the arrays of an `IKBatch`."""
        q, status, iterations, restarts, position_error, rotation_error = fields
        w, g, J = stack(ROWS, L), stack(GEOMETRY, L), stack(n6, L)
        answers = Answers(q, status, iterations, restarts, position_error, rotation_error, np.empty(0))
        solve_lanes(arm, w, g, J, n, targets, starts, answers)

    return solve_many
