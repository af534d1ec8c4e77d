"""Redundancy resolution: a secondary objective among the configurations that meet a task.

`Preference` holds the options ``prefer`` and ``posture`` of every method that supports them. All methods minimise the same
function of q, from a configuration that meets the target to a local minimum in the null space: `lm` by the projected
gradient descent of `optik.ik._null_space`, `sqp` and `ipopt` by a second programme with the symbolic function of
`optik.ik._casadi.symbolic`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput
from optik.ik._null_space import Objective, compute_cost, descend
from optik.task import Task
from optik.types import Array

PREFERENCES: Mapping[str, str] = {
    "posture": "½|q − posture|²",
    "limits": "½ Σ ((q − middle) / half range)² over joints with two finite limits (Liégeois 1977)",
    "manipulability": "−log sqrt(det(J Jᵀ)), J the task's rows in metres and radians (Yoshikawa 1985)",
}
"""Objectives by name, and the functions that are minimised."""


@dataclass(frozen=True, eq=False)
class Preference:
    """Secondary objective in the null space of a task, with weights above 0 by name; false if it is empty.

    The posture (n,) [rad, m] is None for the initial guess of each solve.
    """

    robot: Robot
    weights: Mapping[str, float]
    posture: Array | None

    @classmethod
    def from_options(cls, robot: Robot, prefer: object, posture: ArrayLike | None) -> Preference:
        """Read the options ``prefer`` and ``posture``."""
        expected = f"one or more of {', '.join(PREFERENCES)}, alone or as a mapping from these to weights"
        named = {} if prefer is None else {prefer: 1.0} if isinstance(prefer, str) else prefer
        if not isinstance(named, Mapping):
            raise InvalidInput("prefer", repr(prefer)[:60], expected)
        for name in named:
            if name not in PREFERENCES:
                raise InvalidInput("prefer", repr(name)[:60], expected)
        weights = {k: check_number(v, f"prefer[{k!r}]", "a weight ≥ 0", least=0.0) for k, v in named.items()}
        weights = {k: weight for k, weight in weights.items() if weight > 0.0}
        if posture is not None and "posture" not in weights:
            raise InvalidInput("posture", "a posture", 'prefer="posture" together with it')
        return cls(robot, weights, None if posture is None else robot.configuration(posture, "posture").copy())

    def __bool__(self) -> bool:
        return bool(self.weights)

    @property
    def options(self) -> dict[str, Any]:
        """Values of the options ``prefer`` and ``posture``."""
        posture = None if self.posture is None else tuple(self.posture.tolist())
        return {"prefer": dict(self.weights) or None, "posture": posture}

    def explain(self, task: Task, moving: int | None = None) -> str:
        """Return the message that the preference has no effect if the arm is not redundant for the task, else ""."""
        limits = self.robot.limits
        moving = int((limits.lower < limits.upper).sum()) if moving is None else moving
        if not self or task.exact < moving:
            return ""
        return f"prefer has no effect: {moving} joints move, and {task.exact} components of the task are exact"

    def objective(self, start: Array) -> Objective:
        """Return the objective of one solve as the kernels take it."""
        weights = np.array([self.weights.get(name, 0.0) for name in PREFERENCES])
        return weights, start if self.posture is None else self.posture

    def value(self, task: Task, target: Array, start: Array, q: Array) -> float:
        """Return the cost at one configuration."""
        limits, goal = (self.robot.limits.lower, self.robot.limits.upper), (task.flags, target)
        return float(compute_cost(self.robot.chain, limits, goal, self.objective(start), q))

    def improve(self, task: Task, tolerance: tuple[float, float], target: Array, start: Array, q: Array) -> Array:
        """Return the local minimum of the cost in the null space that is found from a configuration."""
        limits, out = (self.robot.limits.lower, self.robot.limits.upper), q.copy()
        descend(self.robot.chain, limits, (task.flags, target), tolerance, self.objective(start), out)
        return out
