"""Tolerance, status and result of a solve, and results of a batch; codes of the statuses for kernels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from optik.check import check_number
from optik.content import compare_by_content
from optik.errors import InvalidInput
from optik.types import Array, Flags


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


@dataclass(frozen=True)
class Tolerance:
    """Largest position and rotation error of a solution, by our own forward kinematics.

    Parameters
    ----------
    position : float
        Distance [m].
    rotation : float
        Angle [rad].
    """

    position: float = 1e-6
    rotation: float = 1e-6

    def __post_init__(self) -> None:
        for field in ("position", "rotation"):
            value = check_number(getattr(self, field), f"tolerance.{field}", "a number above 0", above=0.0)
            object.__setattr__(self, field, value)

    @classmethod
    def of(cls, value: ToleranceLike) -> Tolerance:
        """Return a tolerance that may be given as a pair.

        Parameters
        ----------
        value : Tolerance, or (2,) tuple of float
            The tolerance, or its position [m] and rotation [rad].

        Returns
        -------
        Tolerance

        Raises
        ------
        InvalidInput
            Neither of these.
        """
        if isinstance(value, Tolerance):
            return value
        if not isinstance(value, tuple | list) or len(value) != 2:
            raise InvalidInput(
                "tolerance", repr(value)[:60], "Tolerance(position [m], rotation [rad]), or the two numbers"
            )
        return cls(*value)

    def __iter__(self) -> Iterator[float]:
        return iter((self.position, self.rotation))

    def scale(self, factor: float) -> Tolerance:
        """Return the tolerance times a factor.

        Parameters
        ----------
        factor : float
            The factor, above 0.

        Returns
        -------
        Tolerance
            The scaled tolerance.
        """
        return Tolerance(factor * self.position, factor * self.rotation)


ToleranceLike: TypeAlias = Tolerance | tuple[float, float]
"""A tolerance, or its position [m] and rotation [rad]."""


IK_TOLERANCE = Tolerance()
"""Tolerance of IK methods by default: 1 µm, and the angle that moves a point at 1 m by 1 µm."""


@compare_by_content
class IKResult(NamedTuple):
    """Result of one solve; ``bool(result)`` is success.

    Attributes
    ----------
    q : (n,) array
        Configuration [rad, m]; on failure the best one found inside the limits.
    status : IKStatus
        Outcome; ``status.advice`` says what to try next.
    iterations : int
        Number of iterations of all attempts.
    restarts : int
        Number of attempts after the first.
    position_error, rotation_error : float
        Errors at q by our own forward kinematics [m, rad].
    trace : (k + 1, 6) array or None
        On request, the error twists (p_t − p, log(R_t Rᵀ)) in the base frame [m, rad] before the first and after each of
        the k iterations of the attempt that found q.
    message : str
        The method's own description of the outcome.
    """

    q: Array
    status: IKStatus
    iterations: int
    restarts: int
    position_error: float
    rotation_error: float
    trace: Array | None = None
    message: str = ""

    def __bool__(self) -> bool:
        return self.status is IKStatus.SOLVED

    def __str__(self) -> str:
        lines = [
            f"{self.status}: {self.iterations} iterations, {self.restarts} restarts",
            f"q = {np.array2string(self.q, formatter={'float': '{:.3g}'.format}, max_line_width=120, threshold=40)} [rad, m]",
            f"position error {1e3 * self.position_error:.3g} mm, rotation error {self.rotation_error:.3g} rad",
        ]
        return "\n".join([*lines, *filter(None, [self.message, self.status.advice and f"try: {self.status.advice}"])])


@compare_by_content
class IKBatch(NamedTuple):
    """Results of a batch of N solves, with the fields of `IKResult`.

    Attributes
    ----------
    q : (N, n) array
        Configurations [rad, m]; on failure the best ones found inside the limits.
    status : (N,) array of uint8
        Indices into ``tuple(IKStatus)``; 0 is solved.
    iterations, restarts : (N,) array of int32
        Numbers of iterations and of attempts after the first.
    position_error, rotation_error : (N,) array
        Errors at q by our own forward kinematics [m, rad].
    """

    q: Array
    status: NDArray[np.uint8]
    iterations: NDArray[np.int32]
    restarts: NDArray[np.int32]
    position_error: Array
    rotation_error: Array

    def __str__(self) -> str:
        counts = np.bincount(self.status, minlength=len(STATUS_OF_CODE))
        others = [f"{count} {STATUS_OF_CODE[code]}" for code, count in enumerate(counts) if count and code != SOLVED]
        return f"{counts[SOLVED]} of {len(self.status)} solved{': ' if others else ''}{', '.join(others)}"

    @property
    def solved(self) -> Flags:
        """Whether each solve succeeded, (N,)."""
        return np.asarray(self.status == SOLVED)

    def result(self, i: int) -> IKResult:
        """Return the result of one solve.

        Parameters
        ----------
        i : int
            Index of the solve.

        Returns
        -------
        IKResult
            Its result; q is a view.
        """
        return IKResult(
            self.q[i], STATUS_OF_CODE[self.status[i]], int(self.iterations[i]), int(self.restarts[i]),
            float(self.position_error[i]), float(self.rotation_error[i]),
        )  # fmt: skip

    @classmethod
    def empty(cls, N: int, n: int) -> IKBatch:
        """Allocate the arrays for the results of N solves.

        Parameters
        ----------
        N : int
            Number of solves.
        n : int
            Number of joints.

        Returns
        -------
        IKBatch
            Uninitialised arrays.
        """
        count = (np.empty(N, np.int32), np.empty(N, np.int32))
        return cls(np.empty((N, n)), np.empty(N, np.uint8), *count, np.empty(N), np.empty(N))
