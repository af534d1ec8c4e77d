"""The symbolic model: a robot's tool pose as CasADi expressions of its configuration, and the pose error in them."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from optik.robot import Robot
from optik.se3 import log_so3

Array = NDArray[np.float64]


def quaternion(R: Array) -> Array:
    """Unit quaternion (4,), scalar first, of a rotation matrix."""
    w = log_so3(R)
    angle = float(np.linalg.norm(w))
    return np.concatenate([[np.cos(0.5 * angle)], 0.5 * np.sinc(0.5 * angle / np.pi) * w])


def tool(robot: Robot, q: Any) -> tuple[Any, Any]:
    """Position (3,) and unit quaternion (4,), scalar first, of the tool at the symbolic configuration q (n,).

    Rotations are carried as quaternions of half angles, so every expression is smooth everywhere.
    """
    p, h = ca.SX.zeros(3), ca.SX([1.0, 0.0, 0.0, 0.0])
    for i in range(robot.n):
        p, h = _attach(p, h, robot.fixed[i])
        if robot.prismatic[i]:
            p = p + q[i] * _rotate(h, ca.SX([0.0, 0.0, 1.0]))
        else:
            half = 0.5 * q[i]
            h = _product(h, ca.vertcat(ca.cos(half), 0.0, 0.0, ca.sin(half)))
    return _attach(p, h, robot.tool)


def residual(robot: Robot, q: Any, target: Any) -> Any:
    """Pose error (6,) between the tool at q and the target, given as position and quaternion (7,).

    The rotation part is twice the vector part of h_t* ∘ h: it vanishes only at the target rotation (unlike
    vee(RᵀR_t), which also vanishes at half turns), and equals the rotation vector to third order.
    """
    p, h = tool(robot, q)
    t = target[3:]
    conjugate = ca.vertcat(t[0], -t[1:])
    return ca.vertcat(p - target[:3], 2.0 * _product(conjugate, h)[1:])


def target_parameters(target: Array) -> Array:
    """The (7,) parameters of `residual` for a target pose (4, 4)."""
    return np.concatenate([target[:3, 3], quaternion(target[:3, :3])])


def _attach(p: Any, h: Any, T: Array) -> tuple[Any, Any]:
    return p + _rotate(h, ca.SX(T[:3, 3])), _product(h, ca.SX(quaternion(T[:3, :3])))


def _product(a: Any, b: Any) -> Any:
    return ca.vertcat(
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


def _rotate(h: Any, v: Any) -> Any:
    t = 2.0 * ca.cross(h[1:], v)
    return v + h[0] * t + ca.cross(h[1:], t)
