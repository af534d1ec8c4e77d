"""Statuses of inverse kinematics, the advice for each, and their codes in kernels and batches."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class IKStatus(StrEnum):
    """Outcome of a solve."""

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
        """What to try next, in words; empty for SOLVED."""
        return _ADVICE[self]


_ADVICE: Mapping[IKStatus, str] = {
    IKStatus.SOLVED: "",
    IKStatus.MAX_ITERATIONS: "more iterations, restarts (max_restarts), or an initial guess nearer to the target",
    IKStatus.STALLED: "restarts (max_restarts) or another initial guess: this one leads to a local minimum or a joint limit",
    IKStatus.TIME_LIMIT: "a longer time_limit, or an initial guess nearer to the target",
    IKStatus.OUTSIDE_LIMITS: "restarts (max_restarts) or wider limits: the pose was met only with a joint outside its limits",
    IKStatus.UNREACHABLE: "a target within reach, or another tool",
    IKStatus.REJECTED: "another method: forward kinematics does not confirm the success that this one reported",
    IKStatus.IN_CONTACT: "another target, or another place for the object: every solution that was found collides",
}
"""Advice by status."""

STATUS_OF_CODE = tuple(IKStatus)
"""Status of each code, in the order of `IKStatus`."""

SOLVED, MAX_ITERATIONS, STALLED, TIME_LIMIT, OUTSIDE_LIMITS, UNREACHABLE, REJECTED, IN_CONTACT = range(
    len(STATUS_OF_CODE)
)
"""Codes of the statuses, which kernels return: compiled code cannot use an enumeration of strings."""
