"""The paper's iteration, a plain matrix inverse where the paper has one."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.oracles.arms import Arm
from tests.oracles.kinematics import fk, jacobian
from tests.oracles.poses import error

Array = Any


@dataclass(frozen=True)
class Iteration:
    """Every iterate of a damped least-squares run, and the error at each."""

    q: Array
    errors: Array
    solved: bool


def damped_least_squares(
    arm: Arm,
    target: Array,
    start: Array,
    *,
    damping: float,
    step: float = 1.0,
    iterations: int = 100,
    tolerance: float = 1e-6,
) -> Iteration:
    """Eq. 8–13 of the paper, eq. 9 corrected, clamped to the limits; a plain matrix inverse where the paper has one."""
    q = np.array(start, dtype=float)
    visited, errors = [q], [error(fk(arm, q), target)]
    while len(visited) <= iterations:
        e = errors[-1]
        if np.linalg.norm(e[:3]) <= tolerance and np.linalg.norm(e[3:]) <= tolerance:
            break
        J = jacobian(arm, q)
        dq = J.T @ np.linalg.inv(J @ J.T + damping**2 * np.eye(6)) @ e
        q = np.clip(q + step * dq, arm.lower, arm.upper)
        visited.append(q)
        errors.append(error(fk(arm, q), target))
    e = errors[-1]
    solved = bool(np.linalg.norm(e[:3]) <= tolerance and np.linalg.norm(e[3:]) <= tolerance)
    return Iteration(np.array(visited), np.array(errors), solved)
