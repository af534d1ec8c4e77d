"""The interface of a timing peer: a time law of another package, with the same joint path and limits as optik's laws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from benchmarks.peers.ik.base import Absent, built_or_absent
from benchmarks.peers.laws import TIMING_PEERS
from optik.registry import load_method
from optik.types import Array
from planners.following.follow import JointPath
from planners.limits import MotionLimits
from planners.trajectory import Trajectory


class TimingPeer(ABC):
    """A time law of another package for given limits; its file binds the class to ``METHOD``.

    Parameters
    ----------
    limits : dict
        ``velocity``, ``acceleration`` and ``jerk``, arrays (n,) [rad/s^k, m/s^k]; infinity where unlimited. In a suite also
        ``torque`` (n,) or, lower side first, (2, n) [N·m, N], of the arm that the joint path has.

    Attributes
    ----------
    distribution : str
        Name of its distribution, for ``pip install``.
    package : str
        Name of its package, for ``import``; imported in ``__init__`` only.
    settings : str
        How it is set up and called, for the report.
    enforced : tuple of str
        Limits that it promises to keep.

    Raises
    ------
    ModuleNotFoundError
        Its package is not installed.
    """

    distribution: ClassVar[str]
    package: ClassVar[str]
    settings: ClassVar[str]
    enforced: ClassVar[tuple[str, ...]]

    @abstractmethod
    def __init__(self, limits: dict[str, Array]) -> None:
        """Prepare everything that does not depend on the path."""

    @abstractmethod
    def call(self, joint_path: JointPath) -> Any:
        """Compute the motion along a joint path from rest to rest; the timed part.

        Parameters
        ----------
        joint_path : JointPath
            The path in joint space.

        Returns
        -------
        Any
            The result, for `trajectory`.

        Raises
        ------
        NoSolution
            The peer found no motion.
        """

    def took_ms(self, raw: Any) -> float | None:
        """Return the time of a call that was measured in a worker process.

        Parameters
        ----------
        raw : Any
            Return value of `call`.

        Returns
        -------
        float or None
            [ms]; None where the call itself is to be timed.
        """
        return None

    @abstractmethod
    def trajectory(self, joint_path: JointPath, raw: Any) -> Trajectory:
        """Return the trajectory of a call's motion. Not timed.

        Parameters
        ----------
        joint_path : JointPath
            The path in joint space.
        raw : Any
            Return value of `call`.

        Returns
        -------
        Trajectory
            The motion.
        """


def peer_limits(limits: MotionLimits, n: int) -> dict[str, Array]:
    """Return the limits in the form that peers take."""
    return limits.arrays(n) | {"torque": limits.bounds(n)["torque"]}


def build_timing_peer(name: str, limits: dict[str, Array]) -> TimingPeer | Absent:
    """Build a timing peer for given limits."""
    peer: TimingPeer | Absent = built_or_absent(load_method(TIMING_PEERS, name, "peer of timing"), limits)
    return peer


METHOD_BASE = TimingPeer
"""Base class of the METHOD of every module here, and of every plug-in."""
