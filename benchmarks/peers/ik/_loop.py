"""Peers that iterate from one start: the result of a call, and the loop of differential inverse kinematics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from benchmarks.peers.ik.base import Peer, one
from optik.arm.limits import JointLimits
from optik.types import Array

LOOP_ITERATIONS = 100
"""Iteration limit of a loop of differential inverse kinematics, for targets where it does not converge."""
LOOP_TOLERANCE = 7e-7
"""Bound on the norm of the pose error, so that both errors are below the 1e-6 m and rad that every method must reach."""
TASK_DAMPING = 1e-3
"""``lm_damping`` of a frame task: without it the quadratic programme of an arm with seven joints may be singular."""


class LoopPeer(Peer):
    """A peer whose call returns a configuration (n,) [rad, m], the number of iterations and whether it converged."""

    budgeted: ClassVar[bool] = True
    limits: JointLimits | None = (
        None  # to which the configuration is clamped, for a method that keeps limits to rounding
    )

    def answers(self, raw: Any) -> Array:
        """Return the last configuration of the iteration."""
        return one(raw[0] if self.limits is None else self.limits.clip(raw[0]))

    def iterations(self, raw: Any) -> int | None:
        """Return the number of iterations."""
        return int(raw[1])

    def claims(self, raw: Any) -> bool | None:
        """Say whether the method reports convergence."""
        return bool(raw[2])


def frame_task_loop(
    configuration: Any,
    task: Any,
    pose_of: Callable[[Array], Any],
    solve_ik: Callable[..., Any],
    no_solution: type[Exception],
    iterations: int | None,
    **options: Any,
) -> Callable[[Array, Array], tuple[Array, int, bool]]:
    """Return ``solve_ik(configuration, [task], dt=1)`` and ``integrate_inplace``, repeated until the task's error is small."""
    most = LOOP_ITERATIONS if iterations is None else iterations

    def call(target: Array, q0: Array) -> tuple[Array, int, bool]:
        task.set_target(pose_of(target))
        configuration.update(q0)
        for i in range(most + 1):
            converged = bool(np.linalg.norm(task.compute_error(configuration)) < LOOP_TOLERANCE)
            if converged or i == most:
                break
            try:
                velocity = solve_ik(configuration, [task], 1.0, "daqp", **options)
            except no_solution:
                break
            configuration.integrate_inplace(velocity, 1.0)
        return configuration.q.copy(), i, converged

    return call
