"""Random chunks and running motions for the figures on `planners.retarget`, and a judge of motions that shares no code with it.

The judge reads knots and coefficients, evaluates them by Horner's rule at 20 kHz and on both sides of every knot, and compares
the values with the limits. Ruckig is called directly.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import ruckig

import optik
import planners
from optik.types import Array
from planners import MotionLimits, Plan
from planners.streams import Chunk

ARMS = ("panda", "ur5e", "iiwa14", "paper6r")
FREQUENCY = 20_000.0
GRACE = 0.3
"""Largest distance from zero at which random joints begin and end, to the ends of their ranges [rad]."""
PANDA = np.array([[2.175] * 4 + [2.61] * 3, [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]])


class Box(NamedTuple):
    """Limits (4, 2, n) of position to jerk, lower and upper, and the same as the package takes them."""

    values: Array
    limits: MotionLimits


@lru_cache(maxsize=8)
def robot_of(name: str) -> optik.Robot:
    return optik.load(name)


def box_of(robot: optik.Robot, rng: np.random.Generator, skewed: bool) -> Box:
    """The limits of an arm; if skewed, each side of velocity and acceleration has 0.6 to 1 of them."""
    n, own = robot.n, robot.limits
    if robot.name == "panda":
        v, a, j = PANDA[0], PANDA[1], 500.0 * PANDA[1]
    else:
        velocity = None if robot.name == "ur5e" else own.velocity
        v = np.full(n, np.pi) if velocity is None else np.array(velocity)
        a, j = np.full(n, 10.0) if own.acceleration is None else np.array(own.acceleration), np.full(n, 100.0)
    part = rng.uniform(0.6, 1.0, (2, 2, n)) if skewed else np.ones((2, 2, n))
    pairs = [np.stack([-x * p[0], x * p[1]]) for x, p in zip((v, a), part, strict=True)]
    given = [*pairs, j] if skewed else [v, a, j]
    ranges = np.stack([own.lower, own.upper])
    return Box(np.stack([ranges, *pairs, np.stack([-j, j])]), MotionLimits(*given))


def span(robot: optik.Robot) -> tuple[Array, Array]:
    return np.maximum(robot.limits.lower, -3.0), np.minimum(robot.limits.upper, 3.0)


def random_plan(robot: optik.Robot, box: Box, rng: np.random.Generator) -> Plan:
    """A certified motion between random joints, at most 1.3 rad apart."""
    low, high = span(robot)
    while True:
        a = rng.uniform(low + GRACE, high - GRACE)
        b = np.clip(a + rng.uniform(-1.3, 1.3, robot.n), low + GRACE, high - GRACE)
        if made := planners.plan(robot, b, a, limits=box.limits):
            return made


class Case(NamedTuple):
    """A chunk, and the largest distance to its targets."""

    chunk: Chunk
    tolerance: float


def random_chunk(running: Any, at: float, box: Box, rng: np.random.Generator, robot: optik.Robot) -> Case:
    """A policy's chunk: observed up to 0.15 s ago, beside the arm, with jumps of its speed, noise and repeated targets."""
    n, m, rate = robot.n, int(rng.integers(8, 51)), float(rng.choice([10.0, 15.0, 20.0, 30.0]))
    observed = at - float(rng.uniform(0.0, 0.15))
    tau = np.arange(m)[:, None] / rate
    now = max(observed, 0.0)
    q, dq = evaluate(running, now, 0), evaluate(running, now, 1)
    beside = rng.uniform(-0.05, 0.05, n) * (rng.random() < 0.7)
    points = q + beside + 0.4 * dq * (1.0 - np.exp(-tau / 0.4))
    most, begin = box.values[1, 1], 0.0
    while begin < tau[-1, 0]:  # strokes of least jerk, which overlap
        lasts = rng.uniform(0.5, 1.5)
        u = np.clip((tau - begin) / lasts, 0.0, 1.0)
        stroke = rng.uniform(-1.0, 1.0, n) * most * rng.uniform(0.2, 1.1) * lasts / 1.875
        points = points + u**3 * (10.0 - 15.0 * u + 6.0 * u**2) * stroke
        begin += lasts * rng.uniform(0.5, 1.0)
    noise = float(rng.choice([0.0, 1e-3, 3e-3]))
    points = points + noise * rng.normal(size=points.shape)
    if rng.random() < 0.3:
        twice = int(rng.integers(1, m - 2))
        points[twice + 1] = points[twice]
    low, high = span(robot)
    return Case(Chunk(np.clip(points, low + 0.01, high - 0.01), rate, observed), max(2e-3, 3.5 * noise))


# ------------------------------------------------------------ evaluation


def evaluate(motion: Any, t: Any, order: int) -> Array:
    """A derivative at instants, by Horner's rule; after its end a motion is at rest."""
    knots, c = motion.knots, motion.coefficients
    x = np.minimum(np.atleast_1d(t), knots[-1])
    piece = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    out = horner(c, piece, x - knots[piece], order)
    if order:
        out[np.atleast_1d(t) > knots[-1] - 1e-15] = 0.0
    return out if np.ndim(t) else out[0]


def horner(c: Array, piece: Array, u: Array, order: int) -> Array:
    """A derivative (k, n) of polynomials c (degree + 1, m, n), highest power first, at u (k,) in pieces (k,)."""
    degree = len(c) - 1
    out = np.zeros((len(u), c.shape[2]))
    for i in range(degree - order + 1):
        factor = np.prod(np.arange(degree - i - order + 1, degree - i + 1)) if order else 1
        out *= u[:, None]
        out += factor * c[i, piece]
    return out


def trim(c: Array) -> Array:
    """Coefficients without the highest powers that are zero everywhere."""
    used = np.flatnonzero(np.abs(c).max(axis=(1, 2)) > 0.0)
    return c[min(used[0] if used.size else len(c) - 1, len(c) - 1) :]


def sample(motion: Any) -> tuple[Array, Array]:
    """Instants at 20 kHz and both sides of the knots, and the derivatives (4, k, n) there."""
    knots, c = motion.knots, trim(motion.coefficients)
    dense = np.arange(0.0, knots[-1], 1.0 / FREQUENCY)
    piece = np.minimum(np.searchsorted(knots, dense, side="right") - 1, len(knots) - 2)
    every = np.arange(len(knots) - 1)
    piece, t = np.concatenate([piece, every, every]), np.concatenate([dense, knots[:-1], knots[1:]])
    u = t - knots[piece]
    return t, np.stack([horner(c, piece, u, order) for order in range(4)])


def excess(values: Array, box: Box) -> Array:
    """The largest excess (4,) over the limits on position to jerk, over half the width of each limit; below 0 if none."""
    low, high = box.values[:, 0, None], box.values[:, 1, None]
    over = np.maximum(values - high, low - values)
    scale = np.where(values > 0.5 * (low + high), high, -low)
    scale[0] = 1.0
    return np.asarray((over / scale).max(axis=(1, 2)))


def jumps(motion: Any, before: Any, at: float) -> tuple[Array, Array, Array]:
    """Discontinuities (3,) of q, q̇ and q̈: to the motion before, inside, and q̇ and q̈ at the end."""
    knots, c = motion.knots, trim(motion.coefficients)
    piece, h = np.arange(len(knots) - 1), np.diff(knots)
    begin, inside, end = np.zeros(3), np.zeros(3), np.zeros(3)
    for order in range(3):
        left, right = horner(c, piece, 0.0 * h, order), horner(c, piece, h, order)
        begin[order] = np.abs(left[0] - evaluate(before, at, order)).max()
        inside[order] = np.abs(left[1:] - right[:-1]).max(initial=0.0)
        end[order] = np.abs(right[-1]).max() if order else 0.0
    return begin, inside, end


# ------------------------------------------------------------ Ruckig, called directly


def fastest(state: Array, goal: Array, box: Box, stop: bool = False) -> Any:
    """Ruckig's motion from a state (3, n) to a goal (3, n) with joints that end together, or to rest, each at once."""
    n = state.shape[1]
    problem, answer = ruckig.InputParameter(n), ruckig.Trajectory(n)
    problem.current_position, problem.current_velocity, problem.current_acceleration = state.tolist()
    problem.target_position, problem.target_velocity, problem.target_acceleration = goal.tolist()
    problem.min_velocity, problem.max_velocity = box.values[1].tolist()
    problem.min_acceleration, problem.max_acceleration = box.values[2].tolist()
    problem.max_jerk = box.values[3, 1].tolist()
    if stop:
        problem.control_interface = ruckig.ControlInterface.Velocity
        problem.synchronization = ruckig.Synchronization.No
    found = ruckig.Ruckig(n).calculate(problem, answer)
    return answer if found in (ruckig.Result.Working, ruckig.Result.Finished) else None


def stays_inside(answer: Any, box: Box) -> bool:
    """Whether Ruckig's motion stays in the ranges of the joints."""
    low, high = box.values[0]
    return all(low[i] <= e.min and e.max <= high[i] for i, e in enumerate(answer.position_extrema))
