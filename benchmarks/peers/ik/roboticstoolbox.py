"""Robotics Toolbox for Python: ik_LM, its compiled Levenberg–Marquardt iteration with restarts (Haviland and Corke)."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from benchmarks.peers.ik.base import Solutions, SolverPeer, one
from optik.arm.robot import Robot
from optik.types import Array


class RoboticsToolbox(SolverPeer):
    """``ETS.ik_LM(target, q0)`` with a tolerance at which errors are below 1e-6 m and rad."""

    distribution = "roboticstoolbox-python"
    package = "roboticstoolbox"
    budgeted = True
    random = True
    settings = (
        "ETS of the arm's fixed transforms, limits set; ik_LM(target, q0=start, tol=1e-13), otherwise its defaults (Chan's "
        "damping with k = 1, 30 iterations, 100 searches): faster and more reliable here than Wampler, Sugihara or smaller k"
    )

    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        from roboticstoolbox import ET, ETS

        elements = []
        for i in range(robot.n):
            joint = ET.tz if robot.prismatic[i] else ET.Rz
            elements += [ET.SE3(np.array(robot.fixed[i])), joint(qlim=[robot.limits.lower[i], robot.limits.upper[i]])]
        self.ets: Any = ETS([*elements, ET.SE3(np.array(robot.tool))])
        budget = {} if iterations is None else {"ilimit": iterations - 1, "slimit": 1}  # it takes ilimit + 1
        self.call = partial(self.ets.ik_LM, tol=1e-13, **budget)

    def read(self, raw: Any) -> Solutions:
        """Return the configuration, whether or not the method reports success, and the iterations over all searches."""
        return Solutions(one(raw[0]), bool(raw.success), int(raw.iterations))

    def fk(self, q: Array) -> Array | None:
        """Return the tool pose by the ETS."""
        return np.asarray(self.ets.fkine(q).A)


METHOD = RoboticsToolbox
