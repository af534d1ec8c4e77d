"""Another library's torques of an arm with masses, and their rates."""

from typing import Any

import numpy as np

Array = Any


class Torques:
    """Torques by Pinocchio: with motors and viscous friction, without Coulomb friction.

    The model is built joint by joint from the arm's fixed poses and the bodies of its joint frames.
    """

    def __init__(self, fixed: Array, prismatic: Array, load: Any) -> None:
        import pinocchio as pin

        self._pin, self.viscous = pin, np.array(load.viscous)
        mass, com, tensor, motor, gravity = (np.array(x) for x in load.bodies)
        model, joint = pin.Model(), 0
        for i in range(len(mass)):
            kind = pin.JointModelPZ() if prismatic[i] else pin.JointModelRZ()
            joint = model.addJoint(joint, kind, pin.SE3(np.array(fixed[i])), f"joint{i}")
            model.appendBodyToJoint(joint, pin.Inertia(float(mass[i]), com[i], tensor[i]), pin.SE3.Identity())
        model.gravity.linear = gravity
        model.armature = motor
        self._model, self._data = model, model.createData()

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        return self._pin.rnea(self._model, self._data, q, dq, ddq) + self.viscous * dq

    def rate(self, q: Array, dq: Array, ddq: Array, dddq: Array) -> Array:
        """dτ/dt by the partial derivatives of the inverse dynamics."""
        by_q, by_dq, mass = self._pin.computeRNEADerivatives(self._model, self._data, q, dq, ddq)
        mass = np.triu(mass) + np.triu(mass, 1).T
        return by_q @ dq + by_dq @ ddq + mass @ dddq + self.viscous * ddq
