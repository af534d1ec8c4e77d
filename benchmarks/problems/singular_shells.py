"""Targets near one kind of singularity: wrist, elbow or shoulder, in shells of the smallest singular value."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from benchmarks.problems import base
from benchmarks.problems.base import ELBOW, SHOULDER, WRIST, by_all_joints, by_one_joint, random_stream, with_starts
from optik.arm.robot import Robot
from optik.check import check_count, check_number
from optik.errors import InvalidInput
from optik.types import Array, Flags

JOINT_OF = {"wrist": WRIST, "elbow": ELBOW, "shoulder": SHOULDER}
"""Index of the joint whose motion leads through each kind of singularity of a six-joint arm."""

LEAST_EDGE = 1e-8
"""Smallest lower edge of a shell [1]: ten times the bound of the search for singular configurations."""

SHELL_CHUNK, IDLE_CHUNKS = 64, 30
"""Configurations searched at a time, and how many times more than there are problems: each shall find one on average."""

FARTHEST_STEP, NEAREST_STEP = 2.0, 1e-10
"""Largest and smallest searched distance from the singular configuration [rad]."""

SHELL_TICKS, SHELL_BISECTIONS = 60, 60
"""Number of searched distances, in geometric progression, and of bisections, down to rounding."""

STILL_SINGULAR = 1e-12
"""Smallest singular value that counts as zero after joint 2 has moved [1]: rounding. On arms without a wrist whose axes meet,
some configurations come to 1e-10."""


@with_starts
def singular_shells(
    robot: Robot, seed: int, *, count: int = 100, which: Sequence[str] | None = None,
    edges: Sequence[float] = (1e-6, 1e-4, 1e-2),
) -> dict[str, Array]:  # fmt: skip
    """Targets whose solution lies in a chosen range of the smallest singular value, beside a named singularity.

    A singular configuration is found by search: a joint of a random configuration moves to a sign change of det J (joint 5
    for the wrist, 3 for the elbow, 2 for the shoulder). A wrist or elbow singularity must persist when joint 2 moves,
    which tells it from that of the shoulder. Then the same joint moves away until the smallest singular value has a
    log-uniform random value inside the shell. The first problems of a group are the same for any larger count.

    Parameters
    ----------
    robot : Robot
        The arm, of six joints or more.
    seed : int
        Seed of the random draw.
    count : int
        Number of targets for each kind of singularity and each shell.
    which : sequence of str, optional
        Out of wrist, elbow, shoulder and any; all three by default for arms with six joints. ``any`` moves all joints to
        a Jacobian of lower rank, without telling of which kind it is: the only one for arms with more joints.
    edges : sequence of float
        Edges of the shells, ascending: smallest singular value of the Jacobian in metres and radians [1].

    Returns
    -------
    dict of (count, n) arrays
        Configurations that reach the targets, by singularity and shell [rad, m].

    Raises
    ------
    InvalidInput
        Fewer than six joints, a kind that the arm does not have or that is not defined for it, edges that do not ascend,
        a count below 1, or wrong starts.
    """
    check_count(count, "count", 1)
    kinds, shells = _kinds(robot, which), _shells(edges)
    return {
        f"{kind}, {low:g} ≤ σ < {high:g}": _shell(robot, seed, count, kind, (low, high))
        for kind in kinds
        for low, high in shells
    }


def _shells(edges: Sequence[float]) -> list[tuple[float, float]]:
    """Check the edges, and return the shells between them."""
    if len(edges) < 2 or list(edges) != sorted(set(edges)):
        raise InvalidInput("edges", repr(edges)[:60], "two or more increasing numbers")
    for edge in edges:
        check_number(edge, "edges", f"numbers of at least {LEAST_EDGE:g}", least=LEAST_EDGE)
    return list(pairwise(map(float, edges)))


def _kinds(robot: Robot, which: Sequence[str] | None) -> tuple[str, ...]:
    """Check and return the kinds of singularities."""
    if robot.n < 6:
        raise InvalidInput("robot", f"{robot.name} with {robot.n} joints", "an arm of six joints or more")
    known = (*JOINT_OF, "any") if robot.n == 6 else ("any",)
    kinds = (tuple(JOINT_OF) if robot.n == 6 else known) if which is None else tuple(which)
    if isinstance(which, str) or not kinds or any(kind not in known for kind in kinds):
        expected = f"a list of names among {', '.join(known)} ({robot.name} has {robot.n} joints)"
        raise InvalidInput("which", repr(which)[:60], expected)
    return kinds


def _shell(robot: Robot, seed: int, count: int, kind: str, shell: tuple[float, float]) -> Array:
    """Return configurations (count, n) near one kind of singularity, in one shell."""
    samples: list[Array] = []
    for chunk in range(count + IDLE_CHUNKS):
        rng = random_stream(seed, "singular_shells", kind, repr(shell), str(chunk))
        singular = _singular(robot, rng, kind)
        away = np.zeros_like(singular)
        if kind == "any":
            away = rng.normal(size=singular.shape)
            away /= np.linalg.norm(away, axis=1, keepdims=True)
        else:
            away[:, JOINT_OF[kind]] = rng.choice([-1.0, 1.0], len(singular))
        wanted = np.exp(rng.uniform(np.log(shell[0]), np.log(shell[1]), len(singular)))
        q = _moved(robot, singular, away, wanted)
        sigma = robot.singular_values(q)[:, -1]
        samples.append(q[robot.limits.contains(q) & (sigma >= shell[0]) & (sigma < shell[1])])
        if sum(map(len, samples)) >= count:
            return np.ascontiguousarray(np.concatenate(samples)[:count])
    low, high = shell
    raise InvalidInput(
        "which", f"{kind} with {low:g} ≤ σ < {high:g} on {robot.name}", 'a singularity of this arm, or "any"'
    )


def _singular(robot: Robot, rng: np.random.Generator, kind: str) -> Array:
    """Return some singular configurations (j, n) of one kind inside the limits."""
    q = robot.limits.sample(rng, SHELL_CHUNK)
    q = by_all_joints(robot, q) if kind == "any" else by_one_joint(robot, rng, q, JOINT_OF[kind])
    q = q[robot.limits.contains(q) & (robot.singular_values(q)[:, -1] < base.RANK_LOST)]
    return q[_persists(robot, q)] if kind in ("wrist", "elbow") else q


def _persists(robot: Robot, q: Array) -> Flags:
    """Say which configurations (j, n) remain singular when joint 2 moves: these are shoulder singularities."""
    stays = np.ones(len(q), dtype=bool)
    for step in (-0.5, 0.3):
        moved = q.copy()
        moved[:, SHOULDER] += step
        stays &= robot.singular_values(moved)[:, -1] < STILL_SINGULAR
    return stays


def _moved(robot: Robot, q: Array, away: Array, wanted: Array) -> Array:
    """Return configurations (j, n) moved along `away` to the nearest ones with the specified smallest singular values (j,)."""

    def sigma(distance: Array) -> Array:
        values: Array = robot.singular_values(q + distance[:, None] * away)
        return np.asarray(values[:, -1])

    ticks = np.concatenate([[0.0], np.geomspace(NEAREST_STEP, FARTHEST_STEP, SHELL_TICKS)])
    beyond = np.stack([sigma(np.full(len(q), tick)) >= wanted for tick in ticks], axis=1)
    first = np.maximum(beyond.argmax(axis=1), 1)  # where none is beyond, the result is outside the shell and dropped
    low, high = ticks[first - 1], ticks[first]
    for _ in range(SHELL_BISECTIONS):
        middle = 0.5 * (low + high)
        small = sigma(middle) < wanted
        low, high = np.where(small, middle, low), np.where(small, high, middle)
    return np.asarray(q + high[:, None] * away)


METHOD = singular_shells
