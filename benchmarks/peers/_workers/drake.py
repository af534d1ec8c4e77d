"""The method that `serve.py` serves for Drake: the nonlinear programme of ``InverseKinematics``, solved by SNOPT."""

from typing import Any

FEASIBILITY = 1e-9
"""SNOPT's "Major feasibility tolerance": with its default of 1e-6 nearly all errors are between 1e-6 and 3e-6 m."""


class _Method:
    """Six equalities on the tool by ``AddPositionConstraint``, joint limits as bounds, no cost, SNOPT from the start.

    The three constraints put the tool's origin at the target's, its point one metre along x on the target's x axis, and its
    point one metre along y into the target's x-y plane. ``AddOrientationConstraint`` bounds the cosine of the angle, which is
    flat where it should be active: nearly all its answers miss 1e-6 rad by a factor of 10.
    """

    def __init__(self, model: dict[str, Any]) -> None:
        import numpy as np
        from pydrake.math import RigidTransform
        from pydrake.multibody.inverse_kinematics import InverseKinematics
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.solvers import SnoptSolver, SolverOptions

        self.np, self.solver = np, SnoptSolver()
        self.InverseKinematics, self.RigidTransform = InverseKinematics, RigidTransform
        plant = MultibodyPlant(0.0)
        Parser(plant).AddModelsFromString(model["urdf"], "urdf")
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("link0"))
        plant.Finalize()
        self.plant, self.tool = plant, plant.GetFrameByName("tool")
        self.context = plant.CreateDefaultContext()
        zero, free = np.zeros(3), np.inf
        self.pins = [
            (zero, zero, zero),
            (np.array([1.0, 0.0, 0.0]), zero, np.array([free, 0.0, 0.0])),
            (np.array([0.0, 1.0, 0.0]), np.array([-free, 0.0, 0.0]), np.array([free, free, 0.0])),
        ]
        self.options = SolverOptions()
        self.options.SetOption(SnoptSolver.id(), "Major feasibility tolerance", FEASIBILITY)
        if model["iterations"] is not None:
            self.options.SetOption(SnoptSolver.id(), "Major iterations limit", model["iterations"])

    def prepared(self, target: list[Any], q0: list[float]) -> tuple[Any, ...]:
        """Return the arguments of `call` as arrays."""
        return self.np.array(target), self.np.array(q0)

    def call(self, target: Any, q0: Any) -> Any:
        """Build and solve the programme, as users write it for each target; the timed call."""
        plant = self.plant
        ik = self.InverseKinematics(plant)
        world, frame = plant.world_frame(), self.RigidTransform(target)
        for point, lower, upper in self.pins:
            ik.AddPositionConstraint(self.tool, point, world, frame, lower, upper)
        program, q = ik.prog(), ik.q()
        found = self.solver.Solve(program, q0, self.options)
        return found.GetSolution(q), found.is_success()

    def answer(self, raw: Any) -> Any:
        """Return configuration, iterations (not reported) and claim of a call."""
        return raw[0], None, bool(raw[1])

    def fk(self, q: list[float]) -> Any:
        """Return the tool pose by its own model."""
        self.plant.SetPositions(self.context, self.np.array(q))
        return self.tool.CalcPoseInWorld(self.context).GetAsMatrix4()


METHOD = _Method
