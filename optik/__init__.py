"""optik: where a serial arm's tool is, and which joints put it there."""

from optik import errors, ik
from optik.errors import OptikError
from optik.ik import IKResult, IKStatus, Tolerance, solve_ik
from optik.robot import DHRow, JointLimits, Robot, load

__version__ = "0.1.0"

__all__ = [
    "DHRow",
    "IKResult",
    "IKStatus",
    "JointLimits",
    "OptikError",
    "Robot",
    "Tolerance",
    "errors",
    "ik",
    "load",
    "robots",
    "solve_ik",
]


def robots() -> tuple[str, ...]:
    """Names of the robots that come with optik."""
    from optik.registry import names

    return names("optik.robots")
