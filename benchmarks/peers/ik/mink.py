"""mink: Pink's differential inverse kinematics on MuJoCo models, as a loop to convergence (Zakka)."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.peers.ik.base import LOOP_ITERATIONS, LOOP_TOLERANCE, TASK_DAMPING, LoopPeer, frame_task_loop
from benchmarks.peers.models import quaternion_of
from optik.arm.robot import Robot
from optik.types import Array


class Mink(LoopPeer):
    """``solve_ik(configuration, [frame_task], dt=1, …)`` and ``integrate_inplace`` until the error of the task is small."""

    distribution = "mink"
    package = "mink"
    settings = (
        "solve_ik(configuration, [FrameTask(lm_damping=1e-3)], dt=1, solver=daqp) and integrate_inplace in a loop, at most "
        f"{LOOP_ITERATIONS} times, until the error is < {LOOP_TOLERANCE:g}; ConfigurationLimit with a gain of 0.5, as Pink has "
        "it (with its default of 0.95 the loop stays at limits); no velocity limits, no restarts"
    )

    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        import mink
        import mujoco

        model = mujoco.MjModel.from_xml_string(mjcf(robot))
        limits = [mink.ConfigurationLimit(model, gain=0.5)]
        task = mink.FrameTask("tool", "site", position_cost=1.0, orientation_cost=1.0, lm_damping=TASK_DAMPING)
        self.configuration: Any = mink.Configuration(model)
        self.call = frame_task_loop(
            self.configuration,
            task,
            mink.SE3.from_matrix,
            mink.solve_ik,
            mink.NoSolutionFound,
            iterations,
            limits=limits,
        )
        self.limits = robot.limits  # the quadratic programme keeps them to rounding

    def fk(self, q: Array) -> Array | None:
        """Return the tool pose by MuJoCo."""
        self.configuration.update(q)
        return np.asarray(self.configuration.get_transform_frame_to_world("tool", "site").as_matrix())


def mjcf(robot: Robot) -> str:
    """Return a MuJoCo model of an arm with the site ``tool``; numbers have all their digits, masses are placeholders."""
    parts = ['<mujoco><compiler angle="radian" autolimits="true"/><worldbody>']
    for i in range(robot.n):
        kind = "slide" if robot.prismatic[i] else "hinge"
        lower, upper = float(robot.limits.lower[i]), float(robot.limits.upper[i])
        limit = f' range="{lower!r} {upper!r}"' if np.isfinite([lower, upper]).all() else ""
        parts.append(
            f'<body name="link{i + 1}" {_placement(robot.fixed[i])}><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
            f'<joint name="joint{i + 1}" type="{kind}" axis="0 0 1"{limit}/>'
        )
    parts.append(f'<site name="tool" {_placement(robot.tool)}/>')
    return "\n".join([*parts, "</body>" * robot.n, "</worldbody></mujoco>"])


def _placement(T: Array) -> str:
    """Return position and unit quaternion, scalar first, as XML attributes."""
    h = quaternion_of(T[:3, :3])
    return " ".join(f'{name}="{" ".join(repr(float(x)) for x in v)}"' for name, v in (("pos", T[:3, 3]), ("quat", h)))


METHOD = Mink
