"""Peers that iterate from one start: the result of a call and its readers."""

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
        """Return the last configuration of the iteration."""
        return one(raw[0] if self.limits is None else self.limits.clip(raw[0]))

    def iterations(self, raw: Any) -> int | None:
        """Return the number of iterations."""
        return int(raw[1])

    def claims(self, raw: Any) -> bool | None:
        """Say whether the method reports convergence."""
        return bool(raw[2])
