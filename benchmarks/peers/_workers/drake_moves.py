"""The method that `serve.py` serves for Drake's ``KinematicTrajectoryOptimization``: moves between two configurations."""

from typing import Any

CONTROL_POINTS = 32
"""Number of control points of the spline. On two moves 64 gave motions 1 % shorter, in five to ten times the computing time."""
SPLINE_ORDER = 6
"""Order of the spline: quintics. On three moves cubics (4), with constant jerk in equal spans, gave 1 % longer motions."""
EFFORT_TIMES = 128
"""Number of equal intervals at whose ends torques are limited. With 64, one move of three was slowed by 8 % to be certified."""


class _Method:
    """Duration as the cost, limits of the control points of the derivatives, torques at equal normalised times, SNOPT."""

    def __init__(self, model: dict[str, Any]) -> None:
        import numpy as np
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.planning import KinematicTrajectoryOptimization
        from pydrake.solvers import SnoptSolver

        self.np, self.solver, self.problem = np, SnoptSolver(), KinematicTrajectoryOptimization
        self.limits = {name: [np.array(x) for x in pair] for name, pair in model["limits"].items()}
        if "torque" not in self.limits:
            return
        plant = MultibodyPlant(0.0)
        (arm,) = Parser(plant).AddModels(model["urdf_file"])
        plant.WeldFrames(plant.world_frame(), plant.get_body(plant.GetBodyIndices(arm)[0]).body_frame())
        for name in model["joints"]:
            plant.AddJointActuator(name, plant.GetJointByName(name))
        plant.mutable_gravity_field().set_gravity_vector(np.array(model["gravity"]))
        plant.Finalize()
        self.plant = plant

    def prepared(self, ends: list[Any], duration: float) -> tuple[Any, ...]:
        """Return the arguments of `call`: configurations at both ends (2, n), and the duration of the initial guess."""
        return self.np.array(ends), duration

    def call(self, ends: Any, duration: float) -> Any:
        """Build and solve the programme from the straight line, as users write it for each move; the timed call."""
        from pydrake.math import BsplineBasis
        from pydrake.trajectories import BsplineTrajectory

        np, limits = self.np, self.limits
        problem = self.problem(ends.shape[1], CONTROL_POINTS, SPLINE_ORDER, duration)
        problem.AddDurationCost()
        problem.AddPositionBounds(*limits["position"])
        add = {
            "velocity": problem.AddVelocityBounds, "acceleration": problem.AddAccelerationBounds,
            "jerk": problem.AddJerkBounds,
        }  # fmt: skip
        for name in add.keys() & limits.keys():
            add[name](*limits[name])
        rest = np.zeros(ends.shape[1])
        for s, at in zip((0.0, 1.0), ends, strict=True):
            problem.AddPathPositionConstraint(at, at, s)
            problem.AddPathVelocityConstraint(rest, rest, s)
            problem.AddPathAccelerationConstraint(rest, rest, s)
        if "torque" in limits:
            times = np.linspace(0.0, 1.0, EFFORT_TIMES + 1)
            problem.AddEffortBoundsAtNormalizedTimes(self.plant, times, *limits["torque"])
        along = np.clip((np.arange(CONTROL_POINTS) - 2.0) / (CONTROL_POINTS - 5.0), 0.0, 1.0)
        basis = BsplineBasis(SPLINE_ORDER, CONTROL_POINTS, initial_parameter_value=0.0, final_parameter_value=duration)
        problem.SetInitialGuess(BsplineTrajectory(basis, ends[0][:, None] + np.outer(ends[1] - ends[0], along)))
        return problem, self.solver.Solve(problem.prog())

    def answer(self, raw: Any) -> dict[str, Any]:
        """Return the spline of q(t), and what SNOPT says."""
        problem, found = raw
        spline = problem.ReconstructTrajectory(found)
        return {
            "success": found.is_success(), "status": str(found.get_solution_result()).rpartition(".")[2],
            "knots": list(spline.basis().knots()), "degree": spline.basis().degree(),
            "points": [list(point[:, 0]) for point in spline.control_points()],
        }  # fmt: skip


METHOD = _Method
