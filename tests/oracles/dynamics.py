"""Another library's dynamics of a robot, joint by joint, and torques along a joint path from it."""

from __future__ import annotations

from typing import Any

import numpy as np

Array = Any


def model_of(robot: Any, load: Any) -> Any:
    """Pinocchio's model of an arm that moves a load, without friction."""
    import pinocchio

    mass, com, tensor, motor, gravity = load.bodies
    model = pinocchio.Model()
    model.gravity.linear = gravity
    parent = 0
    for i, T in enumerate(robot.fixed):
        joint = pinocchio.JointModelPZ() if robot.prismatic[i] else pinocchio.JointModelRZ()
        parent = model.addJoint(parent, joint, pinocchio.SE3(T[:3, :3], T[:3, 3]), f"joint{i}")
        body = pinocchio.Inertia(float(mass[i]), com[i], tensor[i])
        model.appendBodyToJoint(parent, body, pinocchio.SE3.Identity())
    model.armature = motor
    return model


def torques(model: Any, q: Array, dq: Array, ddq: Array) -> Array:
    """Torques (k, n) at states, by the recursive Newton-Euler algorithm."""
    import pinocchio

    data = model.createData()
    return np.array([pinocchio.rnea(model, data, *state).copy() for state in zip(q, dq, ddq, strict=True)])


def path_torques(model: Any, joint_path: Any, s: Array) -> tuple[Array, Array, Array]:
    """p, c and g (k, n) of τ = p s̈ + c ṡ² + g at places of a joint path."""
    q, q1, q2 = (joint_path(s, order) for order in range(3))
    still = np.zeros_like(q)
    g = torques(model, q, still, still)
    return torques(model, q, still, q1) - g, torques(model, q, q1, q2) - g, g


def path_rates(model: Any, joint_path: Any, s: Array, apart: float) -> tuple[Array, Array, Array]:
    """Derivatives of p, c and g in s, by central differences of the fourth order."""
    beside = [path_torques(model, joint_path, s + k * apart) for k in (-2, -1, 1, 2)]
    p, c, g = ((b[0] - 8.0 * b[1] + 8.0 * b[2] - b[3]) / (12.0 * apart) for b in zip(*beside, strict=True))
    return p, c, g
