"""The interface of a timing peer: a time law of another package, with the same joint path and limits as optik's laws."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

from benchmarks.peers.base import Peer
from optik.types import Array
from planners.following.follow import JointPath
from planners.limits import MotionLimits
from planners.trajectory import Trajectory


class TimingPeer(Peer):
    """A time law of another package for given limits.

    Parameters
    ----------
    limits : dict
        ``velocity``, ``acceleration`` and ``jerk``, arrays (n,) [rad/s^k, m/s^k]; infinity where unlimited. In a suite also
        ``torque`` (n,) or, lower side first, (2, n) [N·m, N], of the arm that the joint path has.

    Attributes
    ----------
    enforced : tuple of str
        Limits that it promises to keep.
    """

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
            The result, for `read`.

        Raises
        ------
        NoSolution
            The peer found no motion.
        """

    @abstractmethod
    def read(self, joint_path: JointPath, raw: Any) -> Trajectory:
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

    @classmethod
    def facts(cls, **options: Any) -> dict[str, Any]:
        """Return the facts for the report."""
        return super().facts() | {"enforced": list(cls.enforced)}


def peer_limits(limits: MotionLimits, n: int) -> dict[str, Array]:
    """Return the limits in the form that peers take."""
    return limits.arrays(n) | {"torque": limits.bounds(n)["torque"]}


METHOD_BASE = TimingPeer
"""Base class of the METHOD of every module here, and of every plug-in."""
