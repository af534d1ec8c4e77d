"""Pink: differential inverse kinematics by quadratic programmes, as a loop to convergence (Caron et al.)."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers.ik.base import LOOP_ITERATIONS, LOOP_TOLERANCE, TASK_DAMPING, LoopPeer, frame_task_loop
from benchmarks.peers.models import pinocchio_model
from optik.arm.robot import Robot
from optik.types import Array


class Pink(LoopPeer):
    """``solve_ik(configuration, [frame_task], dt=1)`` and ``integrate``, repeated until the error of the task is small."""

    distribution = "pin-pink"
    package = "pink"
    settings = (
        "solve_ik(configuration, [FrameTask(lm_damping=1e-3)], dt=1, solver=daqp) and integrate_inplace in a loop, at most "
        f"{LOOP_ITERATIONS} times, until |log6| < {LOOP_TOLERANCE:g}; ConfigurationLimit with its gain of 0.5 (with a gain "
        "of 1 the loop stays at limits: cold 42 % solved instead of 58 %); no velocity limits, no restarts; lm_damping 1e-3 "
        "solved as many as 0 and 0.1, and more than 1"
    )

    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        import pink
        import pinocchio

        model = pinocchio_model(pinocchio, robot)
        limits = [pink.limits.ConfigurationLimit(model)]
        task = pink.FrameTask("tool", position_cost=1.0, orientation_cost=1.0, lm_damping=TASK_DAMPING)
        q_middle = robot.limits.clip(np.zeros(robot.n))
        self.configuration: Any = pink.Configuration(model, model.createData(), q_middle)
        self.call = frame_task_loop(
            self.configuration, task, pinocchio.SE3, pink.solve_ik, pink.exceptions.NoSolutionFound, iterations,
            limits=limits, safety_break=False,
        )  # fmt: skip
        self.limits = robot.limits  # the quadratic programme keeps them to rounding

    def fk(self, q: Array) -> Array | None:
        """Return the tool pose by Pink's configuration."""
        self.configuration.update(q)
        return np.asarray(self.configuration.get_transform_frame_to_world("tool").homogeneous)


METHOD = Pink
