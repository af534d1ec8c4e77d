"""What a peer of timing is: an outside time law, given the same joint path and limits, judged by our certificate."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from benchmarks.peers.ik.base import Absent, built_or_absent
from benchmarks.timing_suite import TIMING_PEERS
from optik.registry import load_method
from optik.types import Array
from planners.following.follow import JointPath
from planners.trajectory import Trajectory


class TimingPeer(ABC):
    """An outside time law for some limits. Its file names itself ``METHOD`` and imports its package in ``__init__``.

    Parameters
    ----------
    limits : dict
        ``velocity``, ``acceleration`` and ``jerk``, each (n,), infinity where free.

    Attributes
    ----------
    distribution : str
        What ``pip install`` calls it.
    package : str
        What ``import`` calls it.
    settings : str
        How it is set up and called, for the report.
    keeps : tuple of str
        Which limits it promises to keep.

    Raises
    ------
    ModuleNotFoundError
        Its package is not installed.
    """

    distribution: ClassVar[str]
    package: ClassVar[str]
    settings: ClassVar[str]
    keeps: ClassVar[tuple[str, ...]]

    @abstractmethod
    def __init__(self, limits: dict[str, Array]) -> None:
        """Build for some limits; all that can be done once is done here."""

    @abstractmethod
    def call(self, joint_path: JointPath) -> Any:
        """Time a joint path from rest to rest; this is what is timed.

        Raises
        ------
        NoSolution
            The peer found no motion.
        """

    @abstractmethod
    def trajectory(self, joint_path: JointPath, raw: Any) -> Trajectory:
        """The motion that a call has returned. Not timed."""


def build_timing_peer(name: str, limits: dict[str, Array]) -> TimingPeer | Absent:
    """Build a peer for some limits, or say why it cannot be.

    Raises
    ------
    UnknownName
        No such peer; the nearest names are offered.
    """
    peer: TimingPeer | Absent = built_or_absent(load_method(TIMING_PEERS, name, "peer of timing"), limits)
    return peer


METHOD_BASE = TimingPeer
"""What the METHOD of every module here, and of every plug-in, is a subclass of."""
