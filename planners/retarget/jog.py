"""Jogging: joint velocities that hold for a time-out, after which the arm stops."""

from __future__ import annotations

from typing import NamedTuple

from numpy.typing import ArrayLike

from optik.check import check_number, real_array
from optik.types import Array


class Jog(NamedTuple):
    """Joint velocities (n,) [rad/s, m/s], and the time [s] after which the arm stops."""

    velocity: Array
    hold: float


class JogVelocity:
    """A source of `planners.stream` that commands joint velocities.

    Parameters
    ----------
    velocity : (n,) array, optional
        The first command [rad/s, m/s].
    timeout : float
        Time after a command at which the arm stops, if no other has come [s].

    Raises
    ------
    InvalidInput
        A time-out that is not above 0.
    """

    def __init__(self, velocity: ArrayLike | None = None, timeout: float = 0.2) -> None:
        self.timeout = check_number(timeout, "timeout", "seconds above 0", above=0.0)
        self._next: Jog | None = None
        if velocity is not None:
            self.set(velocity)

    def set(self, velocity: ArrayLike) -> None:
        """Command velocities.

        Parameters
        ----------
        velocity : (n,) array
            [rad/s, m/s]; the stream reduces them to the limits.
        """
        self._next = Jog(real_array(velocity, "velocity", "finite joint velocities", (...,)), self.timeout)

    def __call__(self, now: object) -> Jog | None:
        """Return the command that came since the last call."""
        command, self._next = self._next, None
        return command
