"""IKPy: SciPy's bounded least squares on position and rotation matrix, with finite differences (Manceron)."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers.ik.base import Solutions, SolverPeer, one
from optik.arm.robot import Robot
from optik.arm.urdf_writer import roll_pitch_yaw
from optik.types import Array


class IKPy(SolverPeer):
    """``Chain.inverse_kinematics_frame(target, q0, orientation_mode="all")``."""

    distribution = "ikpy"
    package = "ikpy"
    settings = (
        "a Chain of URDFLinks with limits; inverse_kinematics_frame(target, initial_position=start, orientation_mode=all), "
        "otherwise its defaults: least_squares with finite differences; smaller tolerances solve no more and take longer"
    )
    budgeted = True

    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        from ikpy.chain import Chain
        from ikpy.link import OriginLink, URDFLink

        links = [OriginLink()]
        for i in range(robot.n):
            axis = {"translation": [0.0, 0.0, 1.0]} if robot.prismatic[i] else {"rotation": [0.0, 0.0, 1.0]}
            kind = "prismatic" if robot.prismatic[i] else "revolute"
            bounds = (float(robot.limits.lower[i]), float(robot.limits.upper[i]))
            links.append(
                URDFLink(robot.joint_names[i], *_origin(robot.fixed[i]), bounds=bounds, joint_type=kind, **axis)
            )
        links.append(URDFLink("tool", *_origin(robot.tool), joint_type="fixed"))
        chain = Chain(links, active_links_mask=[False, *[True] * robot.n, False])
        budget = {} if iterations is None else {"optimizer_budget": iterations}

        def call(target: Array, q0: Array) -> Array:
            start = np.concatenate([[0.0], q0, [0.0]])
            q = chain.inverse_kinematics_frame(target, initial_position=start, orientation_mode="all", **budget)
            return np.asarray(q[1:-1])

        self.chain: Any = chain
        self.call = call

    def read(self, raw: Any) -> Solutions:
        """Return the final configuration of the optimiser; IKPy does not report whether it reached the target."""
        return Solutions(one(raw))

    def fk(self, q: Array) -> Array | None:
        """Return the tool pose by the chain of IKPy."""
        return np.asarray(self.chain.forward_kinematics([0.0, *q, 0.0]))


def _origin(T: Array) -> tuple[Array, tuple[float, float, float]]:
    """Return the translation and roll, pitch, yaw of a fixed transform."""
    return T[:3, 3], roll_pitch_yaw(T[:3, :3])


METHOD = IKPy
