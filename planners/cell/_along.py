"""The error split of an execution, at its end and along its path."""

from __future__ import annotations

import numpy as np

from optik.ik import IKSolver
from optik.types import Array
from planners.cell._answers import ik_answers
from planners.cell.drives.base import Execution
from planners.cell.errors import split_configurations
from planners.cell.outcome import PathSplit


def split_along(execution: Execution, solver: IKSolver, true_spot: Array, samples: int) -> PathSplit:
    """Split the tool's error at the steps of the plant that are nearest to the samples of the path.

    At each instant the place on the path is that which is nearest to the planned tool. The point that the executed tool should
    have had there lies on the line to the true spot, as far along it as the place is along the planned line.
    """
    robot, path, t = execution.robot, execution.plan.path, execution.t
    motion = execution.plan.trajectory if execution.motion is None else execution.motion
    binding = execution.plan.certificate.binding
    wanted = np.interp(np.linspace(0.0, path.end, samples), binding.s, binding.t)
    chosen = np.unique(np.append(np.clip(np.searchsorted(t, wanted), 0, t.size - 1), t.size - 1))
    # without a motion of its own, the arm stood at the end of the plan already
    planned = motion(
        np.minimum(t[chosen], motion.end) if execution.motion is not None else motion.end * np.ones(chosen.size)
    )
    s = path.nearest(robot.fk(planned))
    s[-1] = path.end  # an execution ends where its motion does, and that is the end of the path
    poses = path.pose(s)
    answers = ik_answers(solver, poses, planned[0])
    off = true_spot - path.pose(path.end)[:3, 3]
    desired = poses[:, :3, 3] + (s / path.end)[:, None] * off
    split = split_configurations(robot, desired, poses[:, :3, 3], answers, planned, execution.q[chosen])
    return PathSplit(t[chosen], s, split)
