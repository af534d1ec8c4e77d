"""Kinematics, dynamics and inverse kinematics of serial arms."""

from optik import errors as errors
from optik import ik as ik
from optik.arm.group import Group
from optik.arm.inertia import Inertia, Payload
from optik.arm.library import load
from optik.arm.limits import JointLimits, VelocityByPosition
from optik.arm.robot import DHRow, Robot
from optik.arm.shapes import Shapes
from optik.errors import OptikError
from optik.ik import IKResult, IKStatus, Tolerance, solve_ik, solve_ik_batch
from optik.ik.start import choose_start
from optik.scene import Scene
from optik.task import Task

__version__ = "0.1.0"

__all__ = [
    "DHRow", "Group", "IKResult", "IKStatus", "Inertia", "JointLimits", "OptikError", "Payload", "Robot", "Scene",
    "Shapes", "Task", "Tolerance", "VelocityByPosition", "choose_start", "load", "robots", "solve_ik",
    "solve_ik_batch",
]  # fmt: skip


def robots() -> tuple[str, ...]:
    """Return the names of the robots that come with optik or with installed packages."""
    from optik.registry import names

    return names("optik.robots")
