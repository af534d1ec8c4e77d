"""Peers that iterate from one start: what a call of them returns, and how it is read."""

from __future__ import annotations

from typing import Any, ClassVar

from benchmarks.peers.ik.base import Peer, one
from optik.arm.limits import JointLimits
from optik.types import Array


class LoopPeer(Peer):
    """A peer whose call returns a configuration (n,) [rad, m], the number of iterations and whether it converged.

    Attributes
    ----------
    limits : JointLimits or None
        To which the configuration is clamped, for a method that keeps limits to rounding; None for one that ignores them.
    """

    budgeted: ClassVar[bool] = True
    limits: JointLimits | None = None

    def answers(self, raw: Any) -> Array:
        """The configuration at which the iteration ended."""
        return one(raw[0] if self.limits is None else self.limits.clip(raw[0]))

    def iterations(self, raw: Any) -> int | None:
        """Number of iterations."""
        return int(raw[1])

    def claims(self, raw: Any) -> bool | None:
        """Whether the method says that it converged."""
        return bool(raw[2])
