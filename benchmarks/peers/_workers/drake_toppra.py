"""The method that `serve.py` serves for Drake's ``Toppra``: the fastest s(t) within velocities and accelerations."""

from typing import Any

GRID = 501
"""Number of equal grid points, as for the other TOPP-RA. With Drake's own choice of 130 to 190 points, accelerations exceed
their limits by up to 1.6 % between the points instead of 0.2 %, in a quarter of the time."""


class _Method:
    """``Toppra`` on a cubic spline through the samples, with its interpolation scheme for accelerations.

    Limits of joints need nothing of the plant but its number of joints, so its bodies slide on the world's x axis.
    """

    def __init__(self, model: dict[str, Any]) -> None:
        import numpy as np
        from pydrake.multibody.optimization import Toppra
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.multibody.tree import PrismaticJoint, SpatialInertia
        from pydrake.trajectories import PiecewisePolynomial

        self.np, self.Toppra, self.PiecewisePolynomial = np, Toppra, PiecewisePolynomial
        self.limits = {name: np.array(values) for name, values in model["limits"].items()}
        self.plant = MultibodyPlant(0.0)
        for k in range(len(self.limits["velocity"])):
            body = self.plant.AddRigidBody(f"body{k}", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
            joint = PrismaticJoint(f"joint{k}", self.plant.world_frame(), body.body_frame(), [1.0, 0.0, 0.0])
            self.plant.AddJoint(joint)
        self.plant.Finalize()

    def prepared(self, places: list[float], samples: list[Any]) -> tuple[Any, ...]:
        """Return the arguments of `call` as arrays: path parameters (k,), and configurations there as columns (n, k)."""
        return self.np.array(places), self.np.array(samples).T.copy()

    def call(self, places: Any, samples: Any) -> Any:
        """Build and solve spline and programme, as users write them for each path; the timed call."""
        path = self.PiecewisePolynomial.CubicWithContinuousSecondDerivatives(places, samples)
        problem = self.Toppra(path, self.plant, self.np.linspace(places[0], places[-1], GRID))
        velocity, acceleration = self.limits["velocity"], self.limits["acceleration"]
        problem.AddJointVelocityLimit(-velocity, velocity)
        problem.AddJointAccelerationLimit(-acceleration, acceleration)
        return problem.SolvePathParameterization(0.0, 0.0)

    def answer(self, raw: Any) -> dict[str, Any] | None:
        """Return the times of the grid points, with s and ṡ there; nothing if it found no motion."""
        if raw is None:
            return None
        t = raw.get_segment_times()
        rate = raw.MakeDerivative()
        return {
            "t": list(t), "s": [float(raw.value(one)[0, 0]) for one in t],
            "speed": [float(rate.value(one)[0, 0]) for one in t],
        }  # fmt: skip


METHOD = _Method
