"""The IK method's own answers along a path, before any polishing: what its error is judged by."""

from __future__ import annotations

import numpy as np

from optik.ik import IKSolver
from optik.types import Array


def ik_answers(solver: IKSolver, poses: Array, q: Array) -> Array:
    """Solve poses one after the other, each from the answer before, as the paper does."""
    limits = solver.robot.limits
    answers = np.empty((len(poses), solver.robot.n))
    for k, pose in enumerate(poses):
        q = answers[k] = solver.solve(pose, np.clip(q, limits.lower, limits.upper)).q
    return answers
