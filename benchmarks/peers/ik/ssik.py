"""ssik: branches in closed form by code that it generates for one arm, with its native backend."""

from __future__ import annotations

import importlib.util
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

import numpy as np

from benchmarks.peers.ik.base import Solutions, SolverPeer, need_revolute, none
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array


class SSIK(SolverPeer):
    """The module that ``ssik build`` generates for the arm, called as ``solve(target, max_solutions=1)``."""

    distribution = "ssik"
    package = "ssik"
    settings = (
        "the module that `ssik build` generates for the arm, with the limits of the arm, native backend; "
        "solve(target, max_solutions=1), otherwise its defaults: one branch inside the limits, without the other "
        "2π-multiples of joints with a range above 2π"
    )
    takes_start = False

    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        from ssik import Manipulator

        need_revolute(robot, 6, 7)
        self.robot = robot
        transforms = np.concatenate([robot.fixed, robot.tool[None]])
        arm = Manipulator.from_transforms(transforms, limits=np.stack([robot.limits.lower, robot.limits.upper], axis=1))
        if arm.dispatch_plan.needs_symbolic_precompute:
            raise InvalidInput("robot", f"the class {arm.solver_name}", "an arm whose module is generated in seconds")
        self.arm: Any = arm
        self.call = partial(_module(arm).solve, max_solutions=1)

    def read(self, raw: Any) -> Solutions:
        """Return the branches inside the limits."""
        return Solutions(np.array([solution.q for solution in raw]) if raw else none(self.robot), bool(raw))

    def fk(self, q: Array) -> Array | None:
        """Return the tool pose by ssik's own model of the arm."""
        return np.asarray(self.arm.fk(q))


def _module(arm: Any) -> ModuleType:
    """Return the module that ``ssik build`` would generate from a URDF, generated from the arm."""
    from ssik.core.codegen import emit_artifact

    with TemporaryDirectory() as folder:
        file = Path(folder) / "arm_ik.py"
        emit_artifact(
            kb=arm.kinbody, plan=arm.dispatch_plan, module_name="arm_ik", output_path=str(file), arm_label="arm"
        )
        spec = importlib.util.spec_from_file_location("arm_ik", file)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return module


METHOD = SSIK
