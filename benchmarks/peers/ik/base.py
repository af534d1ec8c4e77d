"""What a peer is: an outside IK method built for one arm, called as its users call it, judged by us."""

from __future__ import annotations

import importlib.metadata
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from benchmarks.speed_suite import PEERS
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.registry import load_method
from optik.types import Array


class Peer(ABC):
    """An outside method for one robot. Its file names itself ``METHOD`` and imports its package in ``__init__``.

    Attributes
    ----------
    distribution : str
        What ``pip install`` calls it.
    package : str
        What ``import`` calls it.
    settings : str
        How it is set up and called, for the report.
    takes_start : bool
        Whether ``call`` takes (target, q0), else (target).
    call : callable
        The timed part, a whole call from Python.

    Raises
    ------
    ModuleNotFoundError
        Its package is not installed.
    InvalidInput
        An arm that it cannot take.
    """

    distribution: ClassVar[str]
    package: ClassVar[str]
    settings: ClassVar[str]
    takes_start: ClassVar[bool] = True
    call: Callable[..., Any]

    @abstractmethod
    def __init__(self, robot: Robot) -> None:
        """Build for an arm; all that can be done once is done here."""

    @abstractmethod
    def answers(self, raw: Any) -> Array:
        """Configurations (k, n) that a call has returned, k = 0 for none; any good one counts. Not timed."""

    def iterations(self, raw: Any) -> int | None:
        """How many iterations a call took, where it says so."""
        return None


@dataclass(frozen=True)
class Absent:
    """A peer that could not be run here, and why."""

    why: str


def build_peer(name: str, robot: Robot) -> Peer | Absent:
    """Build a peer for a robot, or say why it cannot be.

    Raises
    ------
    UnknownName
        No such peer; the nearest names are offered.
    """
    try:
        peer: Peer | Absent = built_or_absent(load_method(PEERS, name, "peer"), robot)
    except InvalidInput as error:
        return Absent(f"does not take {robot.name}: {error.got}, where it takes {error.expected}")
    return peer


def built_or_absent(kind: Any, *arguments: Any) -> Any:
    """Build what a class with ``package`` and ``distribution`` describes, or say why its package is not here."""
    try:
        return kind(*arguments)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != kind.package:
            raise
        return Absent(f"not installed: pip install {kind.distribution}")
    except ImportError as error:  # installed, but not for this machine
        return Absent(f"cannot be imported here: {error}")


def version_of(name: str, folder: str = PEERS) -> str | None:
    """Installed version of a peer; None where it is not installed."""
    kind: Any = load_method(folder, name, "peer")
    try:
        return importlib.metadata.version(kind.distribution)
    except importlib.metadata.PackageNotFoundError:
        return None


def need_revolute(robot: Robot, least: int, most: int) -> None:
    """Refuse arms with sliding joints or another number of joints.

    Raises
    ------
    InvalidInput
        The arm is another.
    """
    wanted = f"arms of {least} to {most} turning joints" if least < most else f"arms of {least} turning joints"
    if robot.prismatic.any():
        raise InvalidInput("robot", f"{int(robot.prismatic.sum())} sliding joints", wanted)
    if not least <= robot.n <= most:
        raise InvalidInput("robot", f"{robot.n} joints", wanted)


def zero_frames(robot: Robot) -> Array:
    """Joint frames and the tool frame (n + 1, 4, 4) in the base frame at q = 0."""
    return robot.frames(np.zeros(robot.n))


def one(q: Any) -> Array:
    """The only answer, as (1, n)."""
    return np.asarray(q, dtype=np.float64).reshape(1, -1)


def none(robot: Robot) -> Array:
    """No answer, as (0, n)."""
    return np.empty((0, robot.n))


METHOD_BASE = Peer
"""What the METHOD of every module here, and of every plug-in, is a subclass of."""
