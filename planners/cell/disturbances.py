"""What goes wrong while a simulated drive executes a plan, on purpose: for tests and experiments."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf


@dataclass(frozen=True)
class Stall:
    """A joint stands still, whatever it is sent: something blocks it.

    Attributes
    ----------
    joint : str or int
        Its name or its index.
    at, until : float
        From when to when, on the drive's clock (`SimulatedDrive.clock`) [s].
    """

    joint: str | int
    at: float
    until: float = inf


@dataclass(frozen=True)
class LostEncoder:
    """A joint's encoder is lost: it reads NaN from then on, or, frozen, what it read last.

    Attributes
    ----------
    joint : str or int
        Its name or its index.
    at, until : float
        From when to when, on the drive's clock [s].
    frozen : bool
        Whether it goes on reading what it read last.
    """

    joint: str | int
    at: float
    until: float = inf
    frozen: bool = False


@dataclass(frozen=True)
class LateHost:
    """The host sends nothing for some ticks, and then what it has missed.

    Attributes
    ----------
    at : float
        When it falls silent, on the drive's clock [s].
    ticks : int
        For how many ticks.
    """

    at: float
    ticks: int


@dataclass(frozen=True)
class WrongSetpoint:
    """The host sends one set-point that is off by some amount; NaN for one that is no number.

    Attributes
    ----------
    at : float
        When: the first set-point whose time on the drive's clock is not before [s].
    joint : str or int
        Its name or its index.
    by : float
        How far off [rad, m].
    """

    at: float
    joint: str | int
    by: float


Disturbance = Stall | LostEncoder | LateHost | WrongSetpoint
"""What can be given as ``disturbances`` of a simulated drive."""
