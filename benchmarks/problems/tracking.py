"""Sequences of targets along a smooth motion; each start is the known solution of the previous target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.problems.base import ProblemSet, random_stream
from optik.arm.robot import Robot
from optik.check import check_count, check_number
from optik.errors import InvalidInput
from optik.types import Array

HARMONICS = 4
"""Harmonics of the motion of each joint: it reverses a few times in a loop."""

LOOP_SAMPLES = 20_001
"""Samples of a loop for the length of the tool's path."""


def tracking(
    robot: Robot, seed: int, *, count: int = 200, steps_m: Sequence[float] = (0.001, 0.01, 0.05),
    range_share: float = 0.8,
) -> ProblemSet:  # fmt: skip
    """Sequences of targets at equal distances along the tool's path, each started from the previous solution.

    All joints move round a smooth closed curve inside their limits, the same for every step; where it ends, it begins
    again. Targets follow each other at equal distances of the tool's way. The start of each is the curve's configuration
    at the target before, so that one failure does not make the next. The first problems of a group are the same for any
    larger count.

    Parameters
    ----------
    robot : Robot
        The arm.
    seed : int
        Seed of the random draw.
    count : int
        Number of targets for each step.
    steps_m : sequence of float
        Way of the tool from one target to the next [m]; one group for each.
    range_share : float
        Largest share of each joint's range that the curve may take, above 0 and at most 1 [1].

    Returns
    -------
    ProblemSet
        The problems in the order of the motion, grouped by step.

    Raises
    ------
    InvalidInput
        A step that is not positive, a fraction out of range, a count below 1, or an arm whose tool does not move.
    """
    check_count(count, "count", 1)
    check_number(range_share, "range_share", "a fraction in (0, 1]", above=0.0)
    if range_share > 1.0:
        raise InvalidInput("range_share", range_share, "a fraction in (0, 1]")
    rng = random_stream(seed, "tracking")
    loop = _Loop(robot, rng, range_share)
    q, starts = [], []
    for step in steps_m:
        check_number(step, "steps_m", "metres above 0", above=0.0)
        on = loop(loop.places(step * np.arange(count + 1.0)))
        q.append(on[1:])
        starts.append(on[:-1])
    solutions = np.concatenate(q)
    group = np.repeat([f"step {1e3 * step:g} mm" for step in steps_m], count)
    known, none = np.ones(len(group), dtype=bool), np.full(len(group), np.nan)
    sigma = robot.singular_values(solutions)[:, -1]
    return ProblemSet(robot.fk(solutions), np.concatenate(starts), group, known, sigma, none)


class _Loop:
    """Closed curve in joint space: for each joint a sum of sines whose amplitudes add up to a fraction of its range."""

    def __init__(self, robot: Robot, rng: np.random.Generator, range_share: float) -> None:
        weights = rng.random((HARMONICS, robot.n)) / np.arange(1, HARMONICS + 1)[:, None]
        half = np.where(np.isfinite(robot.limits.half), robot.limits.half, np.pi)
        self._limits, self._middle = robot.limits, robot.limits.middle
        self._amplitude = range_share * half * weights / weights.sum(axis=0)
        self._phase = rng.uniform(0.0, 2.0 * np.pi, (HARMONICS, robot.n))
        self._u = np.linspace(0.0, 1.0, LOOP_SAMPLES)
        way = np.linalg.norm(np.diff(robot.fk(self(self._u))[:, :3, 3], axis=0), axis=1)
        self._length = np.concatenate([[0.0], np.cumsum(way)])
        if self._length[-1] <= 0.0:
            raise InvalidInput("robot", f"{robot.name}, whose tool does not move", "an arm whose joints move its tool")

    def places(self, distance: Array) -> Array:
        """Return the parameters u (k,) at distances (k,) along the tool's closed path [m]."""
        return np.asarray(np.interp(np.mod(distance, self._length[-1]), self._length, self._u))

    def __call__(self, u: Array) -> Array:
        """Return configurations (k, n) at u (k,), with period 1."""
        turns = 2.0 * np.pi * u[:, None] * np.arange(1, HARMONICS + 1)
        waves = np.sin(turns[:, :, None] + self._phase)
        q: Array = self._limits.clip(self._middle + np.einsum("hn,khn->kn", self._amplitude, waves))
        return np.ascontiguousarray(q)


METHOD = tracking
