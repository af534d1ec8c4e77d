"""The method that `serve.py` serves for placo (Rhoban): a frame task and quadratic programmes, as a loop to convergence."""

from typing import Any

ITERATIONS = 100
"""Iteration limit of the loop."""
TOLERANCE = 7e-7
"""Bound on the norms of position and rotation error, below the 1e-6 m and rad that every method must reach."""


class _Method:
    """``solver.solve(True)`` and ``robot.update_kinematics()`` until the frame task's errors are small."""

    def __init__(self, model: dict[str, Any]) -> None:
        import numpy as np
        import placo

        self.np = np
        self.robot = placo.RobotWrapper(model["urdf_file"], placo.Flags.ignore_collisions)
        self.solver = placo.KinematicsSolver(self.robot)
        self.solver.mask_fbase(True)
        self.solver.enable_joint_limits(True)
        self.task = self.solver.add_frame_task("tool", np.eye(4))
        self.task.configure("tool", "soft", 1.0, 1.0)
        self.most = ITERATIONS if model["iterations"] is None else model["iterations"]

    def prepared(self, target: list[Any], q0: list[float]) -> tuple[Any, ...]:
        """Return the arguments of `call` as arrays."""
        return self.np.array(target), self.np.array(q0)

    def call(self, target: Any, q0: Any) -> Any:
        """Iterate to convergence; the timed call."""
        robot, solver, task, norm = self.robot, self.solver, self.task, self.np.linalg.norm
        robot.state.q[7:] = q0
        robot.update_kinematics()
        task.T_world_frame = target
        position, orientation = task.position(), task.orientation()
        for i in range(self.most + 1):
            position.update()
            orientation.update()
            converged = norm(position.b) < TOLERANCE and norm(orientation.b) < TOLERANCE
            if converged or i == self.most:
                break
            solver.solve(True)
            robot.update_kinematics()
        return robot.state.q[7:].copy(), i, bool(converged)

    def answer(self, raw: Any) -> Any:
        """Return configuration, iterations and claim of a call."""
        return raw

    def fk(self, q: list[float]) -> Any:
        """Return the tool pose by its own model."""
        self.robot.state.q[7:] = q
        self.robot.update_kinematics()
        return self.robot.get_T_world_frame("tool")


METHOD = _Method
