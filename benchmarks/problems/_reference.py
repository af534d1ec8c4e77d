"""Known solutions, which define the reachable targets; they are computed before the comparison and independently of it."""

from __future__ import annotations

import hashlib
from collections.abc import Hashable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.problems.base import ProblemSet
from optik.arm.robot import Robot
from optik.ik import make_solver
from optik.ik.problem import UNREACHABLE
from optik.types import Array, Flags, content

REFERENCE_RESTARTS = 100
"""Restarts of `lm` for one target. On the paper's workspace 20, 50, 100 and 500 solve the same 2,733 targets of 4,305."""

MOST_BRANCHED = 6
"""Largest number of moving joints for finitely many solutions; with more, closed forms only sample them."""


class Known(NamedTuple):
    """Known solutions of some targets."""

    q: Array  # (k, n) configurations inside the limits [rad, m]; NaN where none was found
    unreachable: Flags  # whether the bound on the arm's reach proves that there is none

    @property
    def found(self) -> Flags:
        """Whether each target (k,) has a known solution."""
        return np.asarray(np.isfinite(self.q).all(axis=1))


def known_solutions(robot: Robot, targets: Array, starts: Array, *, restarts: int = REFERENCE_RESTARTS) -> Known:
    """Find a configuration for each target: by `lm` with restarts, or else by `closed_form` among all branches.

    `lm` solves all targets as one batch, and proves those beyond the bound on the arm's reach unreachable. `closed_form`
    takes those that are left; arms with more than six moving joints, which have infinitely many branches, do without.
    """
    digests = tuple(hashlib.sha256(x.tobytes()).digest() for x in (targets, starts))
    return _solved(_Asked((content(robot.to_dict()), digests, restarts), robot, targets, starts, restarts))


@dataclass(frozen=True)
class _Asked:
    """Arguments of `known_solutions`, compared by content."""

    key: Hashable
    robot: Robot = field(compare=False)
    targets: Array = field(compare=False)
    starts: Array = field(compare=False)
    restarts: int = field(compare=False)


@lru_cache(maxsize=2)  # blocks of a suite share a set: the paper's workspace is solved once, not once for each of them
def _solved(asked: _Asked) -> Known:
    """Return the known solutions, cached by arguments."""
    robot, targets, starts = asked.robot, asked.targets, asked.starts
    batch = make_solver(robot, "lm", max_restarts=asked.restarts).solve_batch(targets, starts)
    q = np.where(batch.solved[:, None], batch.q, np.nan)
    unreachable: Flags = batch.status == UNREACHABLE
    left = np.flatnonzero(~batch.solved & ~unreachable)
    if len(left) and np.count_nonzero(robot.limits.lower < robot.limits.upper) <= MOST_BRANCHED:
        branches = make_solver(robot, "closed_form").solve_batch(targets[left], starts[left])
        q[left[branches.solved]] = branches.q[branches.solved]
    q.flags.writeable = unreachable.flags.writeable = False
    return Known(q, unreachable)


def searched(
    robot: Robot, targets: Array, starts: Array, group: NDArray[np.str_], *, restarts: int = REFERENCE_RESTARTS
) -> ProblemSet:
    """Return a problem set of targets that are not reachable by construction; a search decides which are."""
    known = known_solutions(robot, targets, starts, restarts=restarts)
    sigma, found = np.full(len(targets), np.nan), known.found
    if found.any():
        sigma[found] = robot.singular_values(known.q[found])[:, -1]
    return ProblemSet(targets, starts, group, found, sigma, np.full(len(targets), np.nan), known.unreachable)
