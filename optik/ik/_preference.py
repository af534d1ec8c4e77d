"""Redundancy resolution: a preference among the configurations that meet a task, and the descent to its minimum.

`Preference` is what the options ``prefer`` and ``posture`` mean to every method that has them: the same weights and the
same function of q. Methods differ in how they minimise it, from the configuration that met the target: `lm` by the
projected gradient descent of `optik.ik._null_space`, `sqp` and `ipopt` by a programme of their own, for which
`optik.ik._casadi.symbolic` has the function in symbols. All find a local minimum along the motion that is free.
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
from optik.ik._null_space import Wish, descend, value_at
from optik.task import Task
from optik.types import Array

PREFERENCES: Mapping[str, str] = {
    "posture": "½|q − posture|²",
    "limits": "½ Σ ((q − middle) / half range)² over joints with two finite limits (Liégeois 1977)",
    "manipulability": "−log sqrt(det(J Jᵀ)), J the task's rows in metres and radians (Yoshikawa 1985)",
}
"""What can be preferred, and what is minimised for it."""


@dataclass(frozen=True, eq=False)
class Preference:
    """What to minimise along the motion that a task leaves free; false where there is nothing to prefer.

    Attributes
    ----------
    robot : Robot
        The arm.
    weights : mapping of str to float
        Weights above 0 [1], by the names of `PREFERENCES`.
    posture : (n,) array or None
        Posture to come near to [rad, m]; None for the start of each solve.
    """

    robot: Robot
    weights: Mapping[str, float]
    posture: Array | None

    @classmethod
    def of(cls, robot: Robot, prefer: object, posture: ArrayLike | None) -> Preference:
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
            raise InvalidInput("posture", "a posture", 'prefer="posture" beside it')
        return cls(robot, weights, None if posture is None else robot.configuration(posture, "posture").copy())

    def __bool__(self) -> bool:
        return bool(self.weights)

    @property
    def options(self) -> dict[str, Any]:
        """The two options, as they would be given again."""
        posture = None if self.posture is None else tuple(self.posture.tolist())
        return {"prefer": dict(self.weights) or None, "posture": posture}

    def note(self, task: Task, moving: int | None = None) -> str:
        """Message that a preference changes nothing, where a task leaves the joints no free motion; else empty."""
        limits = self.robot.limits
        moving = int((limits.lower < limits.upper).sum()) if moving is None else moving
        if not self or task.exact < moving:
            return ""
        return f"prefer changes nothing: {moving} joints that move, {task.exact} components to be met exactly"

    def wish(self, start: Array) -> Wish:
        """Arguments of the kernels for one solve."""
        weights = np.array([self.weights.get(name, 0.0) for name in PREFERENCES])
        return weights, start if self.posture is None else self.posture

    def value(self, task: Task, target: Array, start: Array, q: Array) -> float:
        """Return what is minimised, at one configuration."""
        limits, goal = (self.robot.limits.lower, self.robot.limits.upper), (task.flags, target)
        return float(value_at(self.robot.chain, limits, goal, self.wish(start), q))

    def improve(self, task: Task, tolerance: tuple[float, float], target: Array, start: Array, q: Array) -> Array:
        """Return the local minimum along the free motion that is found from a configuration."""
        limits, out = (self.robot.limits.lower, self.robot.limits.upper), q.copy()
        descend(self.robot.chain, limits, (task.flags, target), tolerance, self.wish(start), out)
        return out
