"""Singular configurations, found by search: by one joint of a six-joint arm, or by all joints of any arm."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array

WRIST, ELBOW, SHOULDER = 4, 2, 1
"""Indices of the joints of a six-joint arm that bend its wrist, its elbow and its shoulder."""
DET_SAMPLES, DET_BISECTIONS = 61, 60
"""Values of a joint at which the sign of det J is sampled, and bisections of a sign change, down to rounding."""
DRAWS, RANK_STEPS = 40, 30
"""Number of attempts before an arm counts as without singular configurations, and Gauss–Newton steps of each."""
RANK_LOST = 1e-9
"""Smallest singular value below which a configuration counts as singular [1]: rounding of the searches."""


def put_on_limits(robot: Robot, rng: np.random.Generator, q: Array, but: int | None = None) -> Array:
    """Put joints on one of their limits: each with probability ½, at least one, never the joint `but`."""
    chosen = _some(rng, q.shape, but)
    ends = np.where(rng.random(q.shape) < 0.5, robot.limits.lower, robot.limits.upper)
    return np.where(chosen, ends, q)


def put_at_zero(robot: Robot, rng: np.random.Generator, q: Array) -> Array:
    """Put joints at zero: each with probability ½, at least one, all in the first configuration; clamp to the limits."""
    chosen = _some(rng, q.shape, None)
    chosen[0] = True
    return robot.limits.clip(np.where(chosen, 0.0, q))


def _some(rng: np.random.Generator, shape: tuple[int, ...], but: int | None) -> NDArray[np.bool_]:
    chosen = rng.random(shape) < 0.5
    joints = np.array([j for j in range(shape[1]) if j != but])
    chosen[np.arange(shape[0]), rng.choice(joints, shape[0])] = True
    if but is not None:
        chosen[:, but] = False
    return chosen


def singular(robot: Robot, rng: np.random.Generator, count: int, joint: int, *, on_limits: bool) -> Array:
    """Return singular configurations inside the limits, up to rounding."""
    found: list[Array] = []
    for _ in range(DRAWS):
        q = robot.limits.sample(rng, 2 * count)
        if on_limits:
            q = put_on_limits(robot, rng, q, but=joint)
        q = by_one_joint(robot, rng, q, joint) if robot.n == 6 else by_all_joints(robot, q)
        good = robot.limits.contains(q) & (robot.singular_values(q)[:, -1] < RANK_LOST)
        found.append(robot.limits.clip(q[good]))
        if sum(map(len, found)) >= count:
            return np.concatenate(found)[:count]
    raise InvalidInput(
        "robot",
        f"{robot.name}, no singular configuration found",
        "an arm with singular configurations within its limits",
    )


def by_one_joint(robot: Robot, rng: np.random.Generator, q: Array, joint: int) -> Array:
    """Move one joint to a random sign change of det J; configurations without a sign change are dropped."""

    def sign(values: Array) -> NDArray[np.bool_]:
        at = q.copy()
        at[:, joint] = values
        positive: NDArray[np.bool_] = np.linalg.det(robot.jacobian(at)) > 0.0
        return positive

    low, high = robot.limits.lower[joint], robot.limits.upper[joint]
    low = low if np.isfinite(low) else min(-np.pi, high - 2.0 * np.pi)
    ticks = np.linspace(low, high if np.isfinite(high) else low + 2.0 * np.pi, DET_SAMPLES)
    signs = np.stack([sign(np.full(len(q), tick)) for tick in ticks], axis=1)
    changes = signs[:, 1:] != signs[:, :-1]
    first = (changes * rng.uniform(0.5, 1.0, changes.shape)).argmax(axis=1)
    low, high, before = ticks[first], ticks[first + 1], signs[np.arange(len(q)), first]
    for _ in range(DET_BISECTIONS):
        middle = 0.5 * (low + high)
        same = sign(middle) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    moved = q.copy()
    moved[:, joint] = 0.5 * (low + high)
    found: Array = moved[changes.any(axis=1)]
    return found


def by_all_joints(robot: Robot, q: Array) -> Array:
    """Solve Jᵀu = 0, uᵀu = 1 for q and u by minimum-norm Gauss–Newton steps, clamped to the limits."""
    u = np.linalg.svd(robot.jacobian(q))[0][:, :, -1]
    for _ in range(RANK_STEPS):
        J = robot.jacobian(q)
        value = np.concatenate([np.einsum("kij,ki->kj", J, u), (np.sum(u * u, axis=1) - 1.0)[:, None]], axis=1)
        slope = np.zeros((len(q), robot.n + 1, robot.n + 6))
        for j in range(robot.n):
            step = np.zeros(robot.n)
            step[j] = 1e-6
            change = (robot.jacobian(q + step) - robot.jacobian(q - step)) / 2e-6
            slope[:, :-1, j] = np.einsum("kij,ki->kj", change, u)
        slope[:, :-1, robot.n :] = np.swapaxes(J, 1, 2)
        slope[:, -1, robot.n :] = 2.0 * u
        square = slope @ np.swapaxes(slope, 1, 2) + 1e-14 * np.eye(robot.n + 1)
        move = np.einsum("kji,kj->ki", slope, np.linalg.solve(square, value[..., None])[..., 0])
        move *= np.minimum(1.0, 0.5 / np.maximum(np.abs(move).max(axis=1, keepdims=True), 1e-12))
        q, u = robot.limits.clip(q - move[:, : robot.n]), u - move[:, robot.n :]
    return q
