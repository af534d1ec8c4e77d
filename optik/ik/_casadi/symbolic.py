"""CasADi expressions of a robot's tool pose and Jacobian, of a task's error, and of a preference."""

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
"""c in the Hessian JᵀJ + c·E·I, with E the sum of squares. Measurements do not distinguish values from 0.1 to 1."""
_FLOOR = 1e-10
"""Least curvature [m², rad²]: it keeps the Hessian positive definite in the null space of the task."""
_HALF_TURN = 1e-9
"""Added to (2 cos ½θ)² so that derivatives are finite at half a turn; near the target it shortens e by a fraction of 1e-10."""


class Model(NamedTuple):
    """Expressions of a robot's tool pose p (3,), R (3, 3) and geometric Jacobian J (6, n), rows (v, ω), in the base frame.

    Their symbols are the configuration q (n,) and the target (12,): the first three rows of its pose, row by row, which
    `pose_parameters` fills.
    """

    q: Any
    target: Any
    p: Any
    R: Any
    J: Any


def build_model(robot: Robot) -> Model:
    """Build the model of a robot as the product of its transforms, without their zeros."""
    q, target = ca.SX.sym("q", robot.n), ca.SX.sym("target", 12)
    p, R = ca.SX.zeros(3), ca.SX.eye(3)
    arm, follow = robot.axes, robot.linkage
    x = q if follow is None else ca.mtimes(ca.DM(follow.matrix), q) + ca.DM(follow.offset)
    axes = []
    for i in range(arm.n):
        p, R = _attach(p, R, arm.fixed[i])
        if arm.prismatic[i]:
            p = p + x[i] * R[:, 2]
        else:
            c, s = ca.cos(x[i]), ca.sin(x[i])
            R = ca.horzcat(c * R[:, 0] + s * R[:, 1], c * R[:, 1] - s * R[:, 0], R[:, 2])
        axes.append((p, R[:, 2]))
    p, R = _attach(p, R, robot.tool)
    columns = [
        ca.vertcat(z, ca.SX.zeros(3)) if slides else ca.vertcat(ca.cross(z, p - o), z)
        for (o, z), slides in zip(axes, arm.prismatic, strict=True)
    ]
    J = ca.horzcat(*columns) if follow is None else ca.mtimes(ca.horzcat(*columns), ca.DM(follow.matrix))
    return Model(q, target, ca.densify(p), ca.densify(R), ca.densify(J))


def pose_parameters(target: Array, out: Array) -> None:
    """Write a target pose into the parameters of a model."""
    out[:] = target[:3].ravel()


def task_rows(task: Task) -> list[int]:
    """Return the indices of the components that a task constrains; for an axis, the two components across it."""
    return [i for i in range(6) if task.mask[i]]


def error_components(m: Model, task: Task) -> Any:
    """Return the errors of the task's components along the axes of its frame, before its box is subtracted.

    A rotation error with a box is that of `optik.task.task_error`. Without a box it is the chord 2 sin ½θ instead of the
    angle θ, with the same single zero.
    """
    position, D = _relative_pose(m, task)
    exact = any(task.box[3:])
    free = [k for k in range(3) if not task.mask[3 + k]]
    turn = _axis_error(D, free[0], exact) if len(free) == 1 else _rotation_error(D, exact)
    return ca.vertcat(position, turn)[task_rows(task)]


def cost(m: Model, task: Task) -> Any:
    """Return E, half the sum of squares of the task's error outside its box: ½|Δp|² + ¼|R − R_t|² for a pose.

    ¼|R − R_t|² is ½(2 sin ½θ)². Without a box on the rotation E is smooth everywhere.
    """
    rows, e = task_rows(task), error_components(m, task)
    smooth = _is_smooth(task)
    total = ca.SX(0.0)
    for i, row in enumerate(rows):
        if row < 3 or not smooth:
            beyond = e[i] if task.box[row] == 0.0 else ca.fmax(ca.fabs(e[i]) - task.box[row], 0.0)
            total += 0.5 * beyond**2
    if smooth and all(task.mask[3:]):
        total += 0.25 * ca.sumsqr(m.R - _target_pose(m)[1])
    elif smooth and any(task.mask[3:]):  # the distance between the tip of the tool's axis and of the target's
        k = task.mask[3:].index(False)
        total += 0.5 * ca.sumsqr(_relative_pose(m, task)[1][:, k] - ca.SX.eye(3)[:, k])
    return total


def _is_smooth(task: Task) -> bool:
    """Return whether the rotation error vanishes only at the target rotation or axis: no box, no single component."""
    return not any(task.box[3:]) and sum(task.mask[3:]) != 1


def cost_derivatives(m: Model, task: Task) -> tuple[Any, Any, Any]:
    """Return `cost` E, its gradient, and its Gauss–Newton Hessian JᵀJ + c·E·I, with J the task's rows.

    E depends only on the tool pose. Its derivatives with respect to the pose are a force and a torque, and Jᵀ maps them
    to the gradient. J is the geometric Jacobian, which is cheaper, if it equals the error's Jacobian at zero error.
    """
    p, R = ca.SX.sym("p", 3), ca.SX.sym("R", 3, 3)
    f = cost(m._replace(p=p, R=R), task)
    force, pull = ca.gradient(f, p), ca.gradient(f, R)
    torque = sum((ca.cross(R[:, k], pull[:, k]) for k in range(3)), ca.SX.zeros(3))
    f, force, torque = ca.substitute([f, force, torque], [p, R], [m.p, m.R])
    rows = task_jacobian(m, task) if _is_smooth(task) else ca.jacobian(error_components(m, task), m.q)
    if any(task.box):  # components inside the box contribute nothing
        outside = ca.fabs(error_components(m, task)) > np.array(task.box)[task_rows(task)]
        rows = ca.diag(outside) @ rows
    H = rows.T @ rows + (HESSIAN_DAMPING * f + _FLOOR) * ca.SX.eye(m.q.numel())
    return f, m.J.T @ ca.vertcat(force, torque), H


def task_jacobian(m: Model, task: Task) -> Any:
    """Return the rows of the geometric Jacobian that a task constrains, along the axes of its frame."""
    J = m.J
    if task.frame == "target" and not all(task.mask):
        back = _target_pose(m)[1].T
        J = ca.vertcat(back @ J[:3, :], back @ J[3:, :])
    return J[task_rows(task), :]


def preference_cost(m: Model, task: Task, robot: Robot, weights: Mapping[str, float], posture: Any) -> Any:
    """Return the weighted sum of the preference: the function of `optik.ik._null_space.cost`."""
    total = ca.SX(0.0)
    for name, weight in weights.items():
        if name == "posture":
            total += 0.5 * weight * ca.sumsqr(m.q - posture)
        elif name == "limits":
            middle, half = robot.limits.middle, robot.limits.half
            for i in np.flatnonzero(robot.limits.bounded):
                total += 0.5 * weight * ((m.q[int(i)] - middle[i]) / half[i]) ** 2
        else:
            rows = task_jacobian(m, task)
            total -= weight * _log_root_det(rows @ rows.T + RANK_FLOOR * ca.SX.eye(rows.size1()))
    return total


def _log_root_det(A: Any) -> Any:
    """Return log √det A of a positive definite matrix: the sum of the logarithms of its Cholesky factor's diagonal."""
    n = A.size1()
    L = ca.SX.zeros(n, n)
    total = ca.SX(0.0)
    for j in range(n):
        L[j, j] = ca.sqrt(A[j, j] - ca.sumsqr(L[j, :j]))
        for i in range(j + 1, n):
            L[i, j] = (A[i, j] - ca.dot(L[i, :j], L[j, :j])) / L[j, j]
        total += ca.log(L[j, j])
    return total


def _target_pose(m: Model) -> tuple[Any, Any]:
    T = ca.reshape(m.target, 4, 3).T
    return T[:, 3], T[:, :3]


def _relative_pose(m: Model, task: Task) -> tuple[Any, Any]:
    """Return the position error (3,) along the task's axes, and the rotation error as a matrix (3, 3)."""
    p, R = _target_pose(m)
    if task.frame == "target":
        return R.T @ (p - m.p), R.T @ m.R
    return p - m.p, m.R @ R.T


def _rotation_error(D: Any, exact: bool) -> Any:
    """Return the error (3,) of the rotation D: minus its axis times 2 sin ½θ, or times θ if exact."""
    root = ca.sqrt(1.0 + ca.trace(D) + _HALF_TURN)  # 2 cos ½θ
    v = ca.vertcat(D[1, 2] - D[2, 1], D[2, 0] - D[0, 2], D[0, 1] - D[1, 0]) / root
    if not exact:
        return v
    s = ca.sqrt(ca.sumsqr(v) + 1e-16)
    return v * (2.0 * ca.atan2(s, root) / s)


def _axis_error(D: Any, k: int, exact: bool) -> Any:
    """Return the error (3,) of axis k of the rotation D: zero along the axis, with the length 2 sin ½φ, or φ if exact."""
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
    """Return position and rotation after a fixed transform, without the terms that are zero up to rounding."""
    exact = np.where(np.abs(T) < 1e-15, 0.0, np.where(np.abs(np.abs(T) - 1.0) < 1e-15, np.sign(T), T))
    return p + R @ ca.sparsify(ca.SX(exact[:3, 3])), ca.densify(R @ ca.sparsify(ca.SX(exact[:3, :3])))
