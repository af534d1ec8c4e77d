"""Brake a running motion as hard as its limits allow: a sweep of its clock to rest.

A clock τ(t) drives the motion q(τ). Its rate w = τ̇ decreases from 1 to 0, or to a goal. In w, b = τ̈ and j = τ⃛ every limit
is a row: rows of second order contain b, w² and w, and rows of third order contain j. A clock with a constant rate w ≤ 1
respects the limits, because the motion respects them. A backward pass finds the least b from which b = 0 can still be reached
in time (viability). The sweep runs forwards with the least j that keeps b above this bound. It ends when the greatest j brings
b to 0 and w to its goal at the same time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.curve import apply_chain_rule, quintic
from planners.limits import MotionLimits
from planners.limits._torque import LoadedLimit
from planners.limits.base import Limit
from planners.timing._brake.rows import Cells, Course, cells_of, derivatives_at, piece_at
from planners.timing._brake.sweep import AT_GOAL, MOST_SWEEP_STEPS, RAMP_STEPS, TOO_SHORT, sweep_clock
from planners.timing._brake.viability import CLOCK_RATES
from planners.trajectory import Trajectory

ROUNDS, TIGHTER = 10, 5e-3
"""Largest number of sweeps, and a margin: each sweep tightens the rows where the last one exceeds a limit between knots."""
QUICK_RAMP = 0.02
"""Fraction of a stop's duration in which b reaches its bound if there is no jerk limit."""
STOP_AHEAD = 1.5
"""Length of the examined part of the motion, relative to the length of a stop from its start under constant limits."""
GAUSS = np.polynomial.legendre.leggauss(4)
"""Nodes in [−1, 1] and weights of the integral of q̇ over a piece."""


class BrakingMotion(NamedTuple):
    """The joints' motion while they brake, None if none was found, and the time of the running motion at which it ends.

    The time is infinite if the running motion ends before the clock can reach its goal.
    """

    motion: Trajectory | None
    end: float


NONE_FOUND, ENDS_BEFORE = BrakingMotion(None, 0.0), BrakingMotion(None, np.inf)
"""No braking was found, or the running motion ends before it."""


def brake(
    robot: Robot, running: Trajectory, limits: MotionLimits, t: float, clock: tuple[float, float],
    scales: dict[str, float], share: float, goal: float = 0.0,
) -> BrakingMotion:  # fmt: skip
    """Return the braking motion from time t on: the clock slows from `clock`, its rate and acceleration, to the rate `goal`.

    It uses the fraction `share` of the limits in `scales`, each multiplied by its scale, or as much as the running motion uses.
    """
    left, (w, b) = running.end - t, clock
    if w <= goal or left <= 0.0:
        return NONE_FOUND
    jerk, length = _rough(Course(robot, running), limits, t, clock, scales)
    kinds = [
        k
        for k in limits.kinds
        if k.order > 1 and k.name in scales and np.isfinite(limits.bounds(robot.n)[k.name]).any()
    ]
    cells, rounds = cells_of(Course(robot, running), limits, t, min(length, left), scales), 0
    out = np.zeros((4, MOST_SWEEP_STEPS + RAMP_STEPS + 2))
    while rounds < ROUNDS:
        least = np.zeros((cells.x.size, CLOCK_RATES + 1))
        end, count = sweep_clock(cells, (w, b, goal), share, jerk, least, out)
        if end == TOO_SHORT and length < left:
            length, before = 2.0 * length, cells
            cells = cells_of(Course(robot, running), limits, t, min(length, left), scales)
            cells.take(before)
            continue
        if end != AT_GOAL:
            return ENDS_BEFORE if end == TOO_SHORT else NONE_FOUND
        motion, stopped = _braking(running, t, out[:, : count + 1])
        rounds += 1
        if not _tighten(cells, robot, motion, limits, kinds, scales, out[0, : count + 1], rounds):
            return BrakingMotion(motion, stopped)
    return NONE_FOUND


def stop_time(
    robot: Robot,
    running: Trajectory,
    limits: MotionLimits,
    t: float,
    clock: tuple[float, float],
    scales: dict[str, float],
) -> float:
    """Return the approximate duration [s] of a stop from time t, with the limits that hold at t."""
    return min(_rough(Course(robot, running), limits, t, clock, scales)[1], running.end - t)


def _tighten(
    cells: Cells,
    robot: Robot,
    motion: Trajectory,
    limits: MotionLimits,
    kinds: list[Limit],
    scales: dict[str, float],
    x: Array,
    rounds: int,
) -> bool:
    """Tighten the rows where the motion exceeds a limit inside its pieces; return whether it does."""
    more = TIGHTER * rounds
    analysis, bounds, done = MotionAnalysis(robot, motion), limits.bounds(robot.n), False
    first = np.searchsorted(cells.x[1:], x[:-1] + 1e-9 * cells.x[-1])
    last = np.searchsorted(cells.x[1:], x[1:] - 1e-9 * cells.x[-1])
    for loaded in (False, True):
        if done:
            break
        for kind in kinds:
            if isinstance(kind, LoadedLimit) is not loaded:
                continue
            ratios = kind.piece_ratios(analysis, bounds[kind.name]).max(axis=1) / scales[kind.name]
            for piece in np.flatnonzero(ratios > 1.0):
                cells.tighten(
                    kind.order, slice(first[piece], last[piece] + 1), 1.0 + 1.2 * (ratios[piece] - 1.0) + more
                )
                done = True
    return done


def _rough(
    course: Course, limits: MotionLimits, t: float, clock: tuple[float, float], scales: dict[str, float]
) -> tuple[float, float]:
    """Return the greatest |j|, and the part of the motion [s] that a stop needs, with the limits that hold at its start."""
    left, (w, b) = course.end - t, clock
    cells = cells_of(course, limits, t, 1e-3 * left, scales, 1)
    with np.errstate(divide="ignore"):
        most = float((1.0 / np.abs(cells.node[0, 0, :, 0])).min(initial=np.inf))
        jerk = float((1.0 / np.abs(cells.edge[0, 0, :, 0])).min(initial=np.inf))
    most = max(min(most, 1e15 * w * w / left), abs(b), 1e-100)
    quickest = most * most / (QUICK_RAMP * w)
    jerk = min(jerk, quickest)
    ramp = min((most + abs(b)) / jerk, 2.0 * np.sqrt(w / jerk) + 2.0 * abs(b) / jerk)
    return 4.0 * jerk, STOP_AHEAD * w * (ramp + 0.5 * w / most)


def _braking(running: Trajectory, start: float, swept: Array) -> tuple[Trajectory, float]:
    """Return the joints' motion for a motion (4, k + 1) of the clock, and its end in the time of the running motion.

    Each piece is computed from the displacement of the joints on it, the integral of q̇. For a motion of nanometres, the
    difference of two positions would be only rounding error.
    """
    x, (w, b), t = np.minimum(swept[0], running.end - start), swept[1:3, :, None], swept[3]
    nodes, weights = GAUSS
    inner, k = x[:-1, None] + np.diff(x)[:, None] * (0.5 + 0.5 * nodes), x.size - 1
    every = np.concatenate([x[:-1], x[1:], inner.ravel()])
    piece = piece_at(running.knots, start + every)
    piece[k : 2 * k] = piece_at(running.knots, start + x[1:] - 1e-9 * np.diff(x))  # one-sided values where q̈ jumps
    q, q1, q2, _ = derivatives_at(running.padded, piece, start - running.knots[piece] + every)
    first = apply_chain_rule((q1[:k], q2[:k]), (w[:-1], b[:-1]))
    last = apply_chain_rule((q1[k : 2 * k], q2[k : 2 * k]), (w[1:], b[1:]))
    moved = np.einsum("k,kin,i->kn", np.diff(x), q1[2 * k :].reshape(*inner.shape, -1), 0.5 * weights)
    motion = quintic(t, (np.zeros_like(moved), *first), (moved, *last))
    motion.c[5] = q[0] + np.concatenate([np.zeros((1, moved.shape[1])), np.cumsum(moved, axis=0)[:-1]])
    return Trajectory(motion), min(start + float(x[-1]), running.end)
