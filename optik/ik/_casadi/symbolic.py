"""Symbolic model: a robot's tool and Jacobian as CasADi expressions, a task's error in them, and the preference."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from optik.arm.robot import Robot
from optik.ik._null_space import RANK_FLOOR
from optik.task import Task
from optik.types import Array

HESSIAN_DAMPING = 0.3
"""c in the Hessian JᵀJ + c·E·I, E the sum of squares: 0.1 to 1 measured alike."""

_FLOOR = 1e-10
"""Least curvature of the Hessian [m², rad²]: it keeps it positive definite along a direction that the task leaves free."""

_HALF_TURN = 1e-9
"""Added to (2 cos ½θ)², so that no derivative is infinite at half a turn; at the target it shortens e by 1e-10 of it."""


class Model(NamedTuple):
    """A robot's tool against a target, in symbols.

    Attributes
    ----------
    q : (n,) symbol
        Configuration.
    target : (12,) symbol
        The target's first three rows, row by row; `pose_parameters` fills them.
    p, R : (3,), (3, 3) expressions
        Position and rotation of the tool at q, base frame.
    J : (6, n) expression
        Geometric Jacobian (v, ω) at the tool point, base frame.
    """

    q: Any
    target: Any
    p: Any
    R: Any
    J: Any


def model(robot: Robot) -> Model:
    """Build the model of a robot: the product of its transforms, zeros left out."""
    q, target = ca.SX.sym("q", robot.n), ca.SX.sym("target", 12)
    p, R = ca.SX.zeros(3), ca.SX.eye(3)
    axes = []
    for i in range(robot.n):
        p, R = _attach(p, R, robot.fixed[i])
        if robot.prismatic[i]:
            p = p + q[i] * R[:, 2]
        else:
            c, s = ca.cos(q[i]), ca.sin(q[i])
            R = ca.horzcat(c * R[:, 0] + s * R[:, 1], c * R[:, 1] - s * R[:, 0], R[:, 2])
        axes.append((p, R[:, 2]))
    p, R = _attach(p, R, robot.tool)
    columns = [
        ca.vertcat(z, ca.SX.zeros(3)) if slides else ca.vertcat(ca.cross(z, p - o), z)
        for (o, z), slides in zip(axes, robot.prismatic, strict=True)
    ]
    return Model(q, target, ca.densify(p), ca.densify(R), ca.densify(ca.horzcat(*columns)))


def pose_parameters(target: Array, out: Array) -> None:
    """Write a target pose into the parameters of a model."""
    out[:] = target[:3].ravel()


def task_rows(task: Task) -> list[int]:
    """Indices of the components that a task asks for; of the pair of an axis, those across it."""
    return [i for i in range(6) if task.mask[i]]


def components(m: Model, task: Task) -> Any:
    """Error of the task's components, before the box, along the axes of its frame.

    Along a rotation component with a box it is that of `optik.task.task_error`; without one it is the chord
    2 sin ½θ instead of the angle θ: the same zero, and no other.
    """
    position, D = _relative(m, task)
    exact = any(task.box[3:])
    free = [k for k in range(3) if not task.mask[3 + k]]
    turn = _swing(D, free[0], exact) if len(free) == 1 else _turn(D, exact)
    return ca.vertcat(position, turn)[task_rows(task)]


def cost(m: Model, task: Task) -> Any:
    """Half the sum of squares E of the task's error outside its box: ½|Δp|² and ½(2 sin ½θ)² = ¼|R − R_t|² for a pose.

    With no box on the rotation it is smooth everywhere.
    """
    rows, e = task_rows(task), components(m, task)
    smooth = _smooth(task)
    total = ca.SX(0.0)
    for i, row in enumerate(rows):
        if row < 3 or not smooth:
            beyond = e[i] if task.box[row] == 0.0 else ca.fmax(ca.fabs(e[i]) - task.box[row], 0.0)
            total += 0.5 * beyond**2
    if smooth and all(task.mask[3:]):
        total += 0.25 * ca.sumsqr(m.R - _target(m)[1])
    elif smooth and any(task.mask[3:]):  # the distance between the tip of the tool's axis and of the target's
        k = task.mask[3:].index(False)
        total += 0.5 * ca.sumsqr(_relative(m, task)[1][:, k] - ca.SX.eye(3)[:, k])
    return total


def _smooth(task: Task) -> bool:
    """Whether the rotation error is zero only where the whole rotation (or axis) is met: no box, no lone component."""
    return not any(task.box[3:]) and sum(task.mask[3:]) != 1


def descent(m: Model, task: Task) -> tuple[Any, Any, Any]:
    """`cost` E, its gradient, and its Gauss–Newton Hessian JᵀJ + c·E·I, J the task's rows.

    E is a function of the tool's pose alone: its derivatives there are a force and a torque, and Jᵀ turns them into the
    gradient. J is the geometric Jacobian where it is that of the error as the error vanishes, which is cheaper.
    """
    p, R = ca.SX.sym("p", 3), ca.SX.sym("R", 3, 3)
    f = cost(m._replace(p=p, R=R), task)
    force, pull = ca.gradient(f, p), ca.gradient(f, R)
    torque = sum((ca.cross(R[:, k], pull[:, k]) for k in range(3)), ca.SX.zeros(3))
    f, force, torque = ca.substitute([f, force, torque], [p, R], [m.p, m.R])
    rows = along(m, task) if _smooth(task) else ca.jacobian(components(m, task), m.q)
    if any(task.box):  # what is inside the box pulls at nothing
        outside = ca.fabs(components(m, task)) > np.array(task.box)[task_rows(task)]
        rows = ca.diag(outside) @ rows
    H = rows.T @ rows + (HESSIAN_DAMPING * f + _FLOOR) * ca.SX.eye(m.q.numel())
    return f, m.J.T @ ca.vertcat(force, torque), H


def along(m: Model, task: Task) -> Any:
    """Rows of the geometric Jacobian that a task asks for, along the axes of its frame."""
    J = m.J
    if task.frame == "target" and not all(task.mask):
        back = _target(m)[1].T
        J = ca.vertcat(back @ J[:3, :], back @ J[3:, :])
    return J[task_rows(task), :]


def preference_cost(m: Model, task: Task, robot: Robot, weights: Mapping[str, float], posture: Any) -> Any:
    """Weighted sum of what to prefer, in symbols: the same function as `optik.ik._null_space.cost`."""
    total = ca.SX(0.0)
    for name, weight in weights.items():
        if name == "posture":
            total += 0.5 * weight * ca.sumsqr(m.q - posture)
        elif name == "limits":
            middle, half = robot.limits.middle, robot.limits.half
            for i in np.flatnonzero(robot.limits.bounded):
                total += 0.5 * weight * ((m.q[int(i)] - middle[i]) / half[i]) ** 2
        else:
            rows = along(m, task)
            total -= weight * _log_root_det(rows @ rows.T + RANK_FLOOR * ca.SX.eye(rows.size1()))
    return total


def _log_root_det(A: Any) -> Any:
    """Log sqrt(det A) of a positive definite matrix: the sum of the logs of its Cholesky factor's diagonal."""
    n = A.size1()
    L = ca.SX.zeros(n, n)
    total = ca.SX(0.0)
    for j in range(n):
        L[j, j] = ca.sqrt(A[j, j] - ca.sumsqr(L[j, :j]))
        for i in range(j + 1, n):
            L[i, j] = (A[i, j] - ca.dot(L[i, :j], L[j, :j])) / L[j, j]
        total += ca.log(L[j, j])
    return total


def _target(m: Model) -> tuple[Any, Any]:
    T = ca.reshape(m.target, 4, 3).T
    return T[:, 3], T[:, :3]


def _relative(m: Model, task: Task) -> tuple[Any, Any]:
    """Position error (3,) along the task's axes, and the rotation D (3, 3) that the task wants to be the identity."""
    p, R = _target(m)
    if task.frame == "target":
        return R.T @ (p - m.p), R.T @ m.R
    return p - m.p, m.R @ R.T


def _turn(D: Any, exact: bool) -> Any:
    """Error (3,) against the rotation D: minus its axis times 2 sin ½θ, or times θ where exact."""
    root = ca.sqrt(1.0 + ca.trace(D) + _HALF_TURN)  # 2 cos ½θ
    v = ca.vertcat(D[1, 2] - D[2, 1], D[2, 0] - D[0, 2], D[0, 1] - D[1, 0]) / root
    if not exact:
        return v
    s = ca.sqrt(ca.sumsqr(v) + 1e-16)
    return v * (2.0 * ca.atan2(s, root) / s)


def _swing(D: Any, k: int, exact: bool) -> Any:
    """Error (3,) of the axis k alone, as `task_error` has it: across it, zero along it; its length 2 sin ½φ or φ."""
    i, j = (k + 1) % 3, (k + 2) % 3
    if exact:
        s = ca.sqrt(D[i, k] ** 2 + D[j, k] ** 2 + 1e-16)
        scale = ca.atan2(s, D[k, k]) / s
    else:
        scale = ca.sqrt(2.0 / (1.0 + D[k, k] + _HALF_TURN))
    e = ca.SX.zeros(3)
    e[i], e[j] = D[j, k] * scale, -D[i, k] * scale
    return e


def _attach(p: Any, R: Any, T: Array) -> tuple[Any, Any]:
    """Append a fixed transform; what is zero up to rounding is left out of the expressions."""
    exact = np.where(np.abs(T) < 1e-15, 0.0, np.where(np.abs(np.abs(T) - 1.0) < 1e-15, np.sign(T), T))
    return p + R @ ca.sparsify(ca.SX(exact[:3, 3])), ca.densify(R @ ca.sparsify(ca.SX(exact[:3, :3])))
