"""CasADi with IPOPT: the nonlinear programme as in its documentation, with default options."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers.ik.base import LoopPeer
from benchmarks.peers.models import quaternion_of
from optik.arm.robot import Robot
from optik.types import Array


class PlainCasADi(LoopPeer):
    """``nlpsol("ik", "ipopt", …)`` called as ``solver(x0=…, p=…, lbx=…, ubx=…, lbg=0, ubg=0)``, without output."""

    distribution = "casadi"
    package = "casadi"
    settings = (
        "nlpsol with ipopt, the pose as six equality constraints (position, and twice the vector part of the quaternion "
        "between), limits as bounds, called as solver(x0=…, p=…, …); default options of IPOPT, no output"
    )

    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        import casadi as ca

        q, target = ca.SX.sym("q", robot.n), ca.SX.sym("target", 7)
        p, h = _tool(ca, robot, q)
        problem = {"x": q, "p": target, "f": ca.SX(0.0), "g": _pose_error(ca, p, h, target)}
        options: dict[str, Any] = {"print_level": 0, "sb": "yes"} | (
            {} if iterations is None else {"max_iter": iterations}
        )
        solver = ca.nlpsol("ik", "ipopt", problem, {"print_time": False, "ipopt": options})
        rotated = ca.horzcat(*(_rotate(ca, h, ca.SX(column)) for column in np.eye(3)))
        self.pose: Any = ca.Function("pose", [q], [ca.vertcat(ca.horzcat(rotated, p), ca.DM([[0.0, 0.0, 0.0, 1.0]]))])
        lower, upper = robot.limits.lower, robot.limits.upper

        def call(target: Array, q0: Array) -> tuple[Array, int, bool]:
            p = np.concatenate([target[:3, 3], quaternion_of(target[:3, :3])])
            answer = solver(x0=q0, p=p, lbx=lower, ubx=upper, lbg=0.0, ubg=0.0)
            stats = solver.stats()
            return np.asarray(answer["x"]).ravel(), int(stats["iter_count"]), bool(stats["success"])

        self.call = call
        self.limits = robot.limits  # IPOPT relaxes bounds by 1e-8

    def fk(self, q: Array) -> Array | None:
        """Return the tool pose by the expression in IPOPT's programme."""
        return np.asarray(self.pose(q))


def _tool(ca: Any, robot: Robot, q: Any) -> tuple[Any, Any]:
    """Return expressions of the tool's position (3,) and unit quaternion (4,), scalar first."""
    p, h = ca.SX.zeros(3), ca.SX([1.0, 0.0, 0.0, 0.0])
    for i, fixed in enumerate((*robot.fixed, robot.tool)):
        p, h = p + _rotate(ca, h, ca.SX(fixed[:3, 3])), _product(ca, h, ca.SX(quaternion_of(fixed[:3, :3])))
        if i < robot.n and robot.prismatic[i]:
            p = p + q[i] * _rotate(ca, h, ca.SX([0.0, 0.0, 1.0]))
        elif i < robot.n:
            h = _product(ca, h, ca.vertcat(ca.cos(0.5 * q[i]), 0.0, 0.0, ca.sin(0.5 * q[i])))
    return p, h


def _pose_error(ca: Any, p: Any, h: Any, target: Any) -> Any:
    """Return expressions (6,) of the position error, and of twice the vector part of h_t* ∘ h, for a target (7,)."""
    between = _product(ca, ca.vertcat(target[3], -target[4:]), h)
    return ca.vertcat(p - target[:3], 2.0 * between[1:])


def _product(ca: Any, a: Any, b: Any) -> Any:
    return ca.vertcat(a[0] * b[0] - ca.dot(a[1:], b[1:]), a[0] * b[1:] + b[0] * a[1:] + ca.cross(a[1:], b[1:]))


def _rotate(ca: Any, h: Any, v: Any) -> Any:
    t = 2.0 * ca.cross(h[1:], v)
    return v + h[0] * t + ca.cross(h[1:], t)


METHOD = PlainCasADi
