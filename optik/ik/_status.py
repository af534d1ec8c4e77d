"""How a solve ended: the statuses of inverse kinematics, what to try for each, and their codes in kernels and batches."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class IKStatus(StrEnum):
    """How a solve ended."""

    SOLVED = "solved"
    MAX_ITERATIONS = "max_iterations"
    STALLED = "stalled"
    TIME_LIMIT = "time_limit"
    OUTSIDE_LIMITS = "outside_limits"
    UNREACHABLE = "unreachable"
    REJECTED = "rejected"
    IN_CONTACT = "in_contact"

    @property
    def advice(self) -> str:
        """What to try."""
        return _ADVICE[self]


_ADVICE: Mapping[IKStatus, str] = {
    IKStatus.SOLVED: "",
    IKStatus.MAX_ITERATIONS: "more iterations, restarts (max_restarts), or a start nearer to the target",
    IKStatus.STALLED: "restarts (max_restarts) or another start: this one leads to a local minimum or a joint limit",
    IKStatus.TIME_LIMIT: "a longer time limit, or a start nearer to the target",
    IKStatus.OUTSIDE_LIMITS: "restarts (max_restarts) or wider limits: the pose was met only with a joint outside its limits",
    IKStatus.UNREACHABLE: "a target within reach (the message says how far that is), or another tool",
    IKStatus.REJECTED: "another method: this one claimed a success that forward kinematics does not confirm",
    IKStatus.IN_CONTACT: "another target, or the object elsewhere: every solution that was found touches",
}
"""What to try, by status."""

STATUS_OF_CODE = tuple(IKStatus)
"""Status of every code: kernels and batches count statuses in the order in which `IKStatus` names them."""

SOLVED, MAX_ITERATIONS, STALLED, TIME_LIMIT, OUTSIDE_LIMITS, UNREACHABLE, REJECTED, IN_CONTACT = range(
    len(STATUS_OF_CODE)
)
"""Codes of the statuses, as kernels return them: compiled code knows no enumeration of texts."""
