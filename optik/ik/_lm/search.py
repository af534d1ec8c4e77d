"""One lane's way to an answer: attempts from the start and then from the seeds, windings, limits, and giving up.

An attempt runs free of the limits, since the shortest way may lead outside and back. Where it meets the target, whole
turns bring the joints inside (the winding nearest to the start); where they cannot, the configuration is cut to the
limits and the attempt goes on with every step cut to them. An attempt that no longer gets on is given up for the next.
The first starts where the caller says, the next ones as `_starts` says. Nothing is drawn at run time: the same problem
has the same answer in any lane, thread and process.

All functions take the arm as `_chain.pack` wrote it and the work array w (ROWS, L) of `_lanes`; l is a lane.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from optik.arm.limits import LIMIT_TOLERANCE as SLACK
from optik.arm.reach import outside_reach
from optik.compiled import compiled, inlined, parallel
from optik.ik._lm.lanes import (
    ABOUT,
    ATTEMPT,
    BEGINS,
    BEST,
    BEST_E,
    CLAMPED,
    ENDING,
    GEOMETRY,
    GOAL,
    HIGH,
    ITERATION,
    LEAST,
    LOOK,
    LOW,
    MOVED,
    NEXT,
    OUTSIDE,
    PROBLEM,
    ROWS,
    STALL,
    TOTAL,
    E,
    Q,
    S,
    e,
    errors,
    face_about,
    steps,
)  # fmt: skip
from optik.ik._lm.packed import (
    ATTEMPTS,
    BASE_P,
    BASE_R,
    FIRST,
    ITERATIONS,
    LOWER,
    PATIENCE,
    PROGRESS,
    REACH,
    SLIDES,
    TOLERANCE_P,
    TOLERANCE_R,
    TOOL_R,
    UPPER,
)  # fmt: skip
from optik.ik._lm.stack import stack
from optik.ik._lm.starts import begin, put
from optik.ik._lm.winding import inside_winding
from optik.se3 import is_pose
from optik.types import Array

SOLVED, MAX_ITERATIONS, STALLED, OUTSIDE_LIMITS, UNREACHABLE = 0, 1, 2, 4, 5
"""Answers, by their position in IKStatus."""

STEP, HELD, WRONG = -1, -2, -3
"""No answer yet: the lane takes a step, or has just been put elsewhere and must be measured first. Wrong arguments."""

IDLE = -1.0


class Answers(NamedTuple):
    """Where answers go: q (N, n), and (N,) each; trace (6 k,) takes the errors of one attempt of one problem."""

    q: Array
    status: Any
    iterations: Any
    restarts: Any
    position_error: Array
    rotation_error: Array
    trace: Array


@inlined
def aim(arm: Array, target: Array, w: Array, l: int) -> None:
    """Take a target (4, 4): seen from the first joint's frame, its rotation without the tool's."""
    for i in range(3):
        v = 0.0
        for m in range(3):
            v += arm[BASE_R + 3 * m + i] * (target[m, 3] - arm[BASE_P + m])
        w[GOAL + 9 + i, l] = v
        b0, b1, b2 = arm[BASE_R + i], arm[BASE_R + 3 + i], arm[BASE_R + 6 + i]
        r0 = b0 * target[0, 0] + b1 * target[1, 0] + b2 * target[2, 0]
        r1 = b0 * target[0, 1] + b1 * target[1, 1] + b2 * target[2, 1]
        r2 = b0 * target[0, 2] + b1 * target[1, 2] + b2 * target[2, 2]
        for j in range(3):
            m = TOOL_R + 3 * j
            w[GOAL + 3 * i + j, l] = r0 * arm[m] + r1 * arm[m + 1] + r2 * arm[m + 2]


@inlined
def settle(arm: Array, w: Array, n: int, start: Array, l: int) -> bool:
    """Bring a lane inside the limits: by whole turns, to the winding nearest to the start, else to the limit itself.

    Returns whether it stood there already.
    """
    same = True
    for i in range(n):
        low, high, q = arm[LOWER + i], arm[UPPER + i], w[Q + i, l]
        x = q if arm[SLIDES + i] != 0.0 else inside_winding(q, start[i], low, high)
        x = min(max(x, low), high)
        same = same and x == q
        w[Q + i, l] = x
    return same


@inlined
def inside(arm: Array, w: Array, n: int, l: int) -> bool:
    """Whether a lane stands inside the limits."""
    for i in range(n):  # noqa: SIM110  (a generator does not compile)
        if not (arm[LOWER + i] <= w[Q + i, l] <= arm[UPPER + i]):
            return False
    return True


@inlined
def move(arm: Array, w: Array, n: int, start: Array, l: int) -> None:
    """Put a lane where it was sent or its attempt starts; its steps end at the limits if it is to keep them, else nowhere."""
    if w[BEGINS, l] != 0.0:
        begin(arm, w, n, start, l)
    clamped = w[CLAMPED, l] != 0.0
    w[MOVED, l] = 0.0
    for i in range(n):
        w[Q + i, l] = w[NEXT + i, l]
        w[LOW + i, l] = arm[LOWER + i] if clamped else -1e9
        w[HIGH + i, l] = arm[UPPER + i] if clamped else 1e9


@inlined
def load(arm: Array, w: Array, targets: Array, problem: int, l: int) -> None:
    """Give a lane a problem."""
    aim(arm, targets[problem], w, l)
    for i in range(PROBLEM, ROWS):
        w[i, l] = 0.0
    w[PROBLEM, l], w[ATTEMPT, l], w[BEST_E, l] = problem, arm[FIRST], np.inf
    w[BEGINS, l], w[MOVED, l] = 1.0, 1.0


@inlined
def tick(arm: Array, w: Array) -> None:
    """Keep count of every lane's progress, and note which ones want a look; the others are ready for a step."""
    tolerance_p, tolerance_r = arm[TOLERANCE_P] * arm[TOLERANCE_P], arm[TOLERANCE_R] * arm[TOLERANCE_R]
    progress, patience, most = arm[PROGRESS], arm[PATIENCE], arm[ITERATIONS]
    for l in range(w.shape[1]):
        cost = w[E, l]
        least = w[LEAST, l]
        better = cost < progress * least
        stall = 0.0 if better else w[STALL, l] + 1.0
        w[LEAST, l], w[STALL, l] = cost if better else least, stall
        met = (w[S, l] <= tolerance_p) & (w[S + 1, l] <= tolerance_r)
        # NaN is no progress either, and never gets better
        over = (w[ITERATION, l] >= most) | (stall >= patience) | (not cost < np.inf)
        look = met | over | (w[ENDING, l] != 0.0) | (w[S + 1, l] >= ABOUT)
        w[LOOK, l] = 1.0 if look else 0.0
        step = 0.0 if look else 1.0
        # the start is inside the limits, and already kept as the best: only its error is new
        at_start = (w[ITERATION, l] == 0.0) & (w[ATTEMPT, l] == 0.0) & (w[CLAMPED, l] == 0.0) & (cost < np.inf)
        w[BEST_E, l] = cost if at_start else w[BEST_E, l]
        w[ITERATION, l] += step
        w[TOTAL, l] += step


@inlined
def look(arm: Array, w: Array, n: int, start: Array, l: int) -> int:
    """Judge a lane: SOLVED, why its attempt ends, STEP, or HELD where it has been brought inside its limits."""
    tolerance_p, tolerance_r = arm[TOLERANCE_P], arm[TOLERANCE_R]
    if w[S, l] <= tolerance_p * tolerance_p and w[S + 1, l] <= tolerance_r * tolerance_r:
        # once brought inside, it keeps the limits: to turn it again could go on for ever where a turn is lost in rounding
        if w[CLAMPED, l] != 0.0 or settle(arm, w, n, start, l):
            return SOLVED
        w[OUTSIDE, l], w[CLAMPED, l], w[LEAST, l], w[STALL, l] = 1.0, 1.0, np.inf, 0.0
        for i in range(n):
            put(arm, w, l, i, w[Q + i, l])
        return HELD
    if w[ITERATION, l] >= arm[ITERATIONS]:
        return MAX_ITERATIONS
    return STALLED if w[STALL, l] >= arm[PATIENCE] or not w[E, l] < np.inf else STEP


@inlined
def give_up(arm: Array, w: Array, n: int, start: Array, l: int, attempts: float) -> bool:
    """Go to the next attempt; where there is none, back to the best found, to be measured once more."""
    if w[E, l] < w[BEST_E, l] and inside(arm, w, n, l):
        w[BEST_E, l] = w[E, l]
        for i in range(n):
            w[BEST + i, l] = w[Q + i, l]
    if w[ATTEMPT, l] + 1.0 < attempts:
        w[ATTEMPT, l] += 1.0
        w[BEGINS, l], w[MOVED, l] = 1.0, 1.0
        return False
    for i in range(n):
        q = w[BEST + i, l] if w[BEST_E, l] < np.inf else w[Q + i, l]
        put(arm, w, l, i, q if abs(q) < 1e9 else start[i])
    return True


@inlined
def advance(arm: Array, w: Array, n: int, target: Array, start: Array, l: int) -> int:
    """Move a lane on that wants a look: STEP, HELD, or its answer."""
    face_about(w, l)
    if w[ENDING, l] != 0.0:
        return int(w[ENDING, l])
    status = look(arm, w, n, start, l)
    if status == STEP:
        w[ITERATION, l] += 1.0
        w[TOTAL, l] += 1.0
    elif status in (MAX_ITERATIONS, STALLED):
        proved = outside_reach(arm[REACH : REACH + 8], target, arm[TOLERANCE_P], arm[TOLERANCE_R]) >= 0.0
        if give_up(arm, w, n, start, l, 0.0 if proved else arm[ATTEMPTS]):
            w[ENDING, l] = UNREACHABLE if proved else (OUTSIDE_LIMITS if w[OUTSIDE, l] != 0.0 else status)
        return HELD
    return status


@inlined
def answer(w: Array, n: int, answers: Answers, l: int, status: int) -> None:
    """Write a lane's answer."""
    p = int(w[PROBLEM, l])
    for i in range(n):
        answers.q[p, i] = w[Q + i, l]
    answers.status[p] = status
    answers.iterations[p], answers.restarts[p] = int(w[TOTAL, l]), int(w[ATTEMPT, l])
    answers.position_error[p], answers.rotation_error[p] = sqrt(w[S, l]), sqrt(w[S + 1, l])


@inlined
def note(w: Array, trace: Array) -> None:
    """Keep the error of the first lane in the trace of its attempt."""
    face_about(w, 0)
    if w[ENDING, 0] == 0.0:
        for i in range(6):
            trace[6 * int(w[ITERATION, 0]) + i] = w[e + i, 0]


@inlined
def run(arm: Array, w: Array, g: Array, J: Array, n: int, targets: Array, starts: Array, answers: Answers) -> None:
    """Solve all problems: every lane takes the next one as soon as its own is answered."""
    N, L = targets.shape[0], w.shape[1]
    waiting, busy = 0, 0
    for l in range(L):  # a lane without a problem runs along with a copy of another's, and is not looked at
        load(arm, w, targets, min(waiting, N - 1), l)
        if waiting < N:
            waiting += 1
            busy += 1
        else:
            w[PROBLEM, l] = IDLE
    while busy > 0:
        for l in range(L):
            if w[MOVED, l] != 0.0:
                move(arm, w, n, starts[max(int(w[PROBLEM, l]), 0)], l)
        errors(arm, w, g, n)
        if answers.trace.shape[0] > 0:
            note(w, answers.trace)
        tick(arm, w)
        stepping = False
        for l in range(L):
            if w[LOOK, l] == 0.0 or w[PROBLEM, l] == IDLE:
                stepping = stepping or w[PROBLEM, l] != IDLE
                continue
            p = int(w[PROBLEM, l])
            status = advance(arm, w, n, targets[p], starts[p], l)
            if status == STEP:
                stepping = True
            elif status != HELD:
                answer(w, n, answers, l, status)
                if waiting < N:
                    load(arm, w, targets, waiting, l)
                    waiting += 1
                else:
                    w[PROBLEM, l] = IDLE
                    busy -= 1
        if stepping:
            steps(arm, w, g, J, n)


def single(n: int) -> Any:
    """Return the kernel for one target of an arm of n joints."""
    n6 = 6 * n

    @compiled
    def solve_one(arm: Array, target: Array, q0: Array, out: Array) -> tuple[int, int, int, float, float]:
        """Answer into out (n,); returns (status, iterations, restarts, errors), or a negative status for wrong arguments.

        Where out is longer by 6 (k + 1), the rest takes the errors of the attempt's iterates.
        """
        if target.shape[0] != 4 or target.shape[1] != 4 or not is_pose(target):
            return WRONG, 0, 0, 0.0, 0.0
        if q0.shape[0] != n:
            return WRONG, 0, 0, 0.0, 0.0
        for i in range(n):
            if not (arm[LOWER + i] - SLACK <= q0[i] <= arm[UPPER + i] + SLACK and abs(q0[i]) < np.inf):
                return WRONG, 0, 0, 0.0, 0.0
        w, g, J, x = stack(ROWS, 1), stack(GEOMETRY, 1), stack(n6, 1), stack(5, 1)
        answers = Answers(out[:n][None], x[0], x[1], x[2], x[3], x[4], out[n:])
        run(arm, w, g, J, n, target[None], q0[None], answers)
        return int(x[0, 0]), int(x[1, 0]), int(x[2, 0]), x[3, 0], x[4, 0]

    return solve_one


def batch(n: int, L: int) -> Any:
    """Return the kernel for many targets of an arm of n joints, L side by side."""
    n6 = 6 * n

    @parallel
    def solve_many(
        arm: Array, targets: Array, starts: Array, q: Array, status: Any, iterations: Any, restarts: Any,
        position_error: Array, rotation_error: Array,
    ) -> None:  # fmt: skip
        """Answers to targets (N, 4, 4) from starts (N, n), both checked before, into the arrays of an `IKBatch`."""
        w, g, J = stack(ROWS, L), stack(GEOMETRY, L), stack(n6, L)
        answers = Answers(q, status, iterations, restarts, position_error, rotation_error, np.empty(0))
        run(arm, w, g, J, n, targets, starts, answers)

    return solve_many
