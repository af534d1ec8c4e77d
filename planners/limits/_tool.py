"""Limits on the speed of the tool."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from optik.types import Array
from planners.certificate.examined import Examined
from planners.limits._extreme import ToolExtreme
from planners.limits._points import PathPoints
from planners.limits.base import Limit


class ToolSpeedLimit(Limit):
    """A limit on the Euclidean norm of a part of the tool's twist: proved bounds judge it.

    Attributes
    ----------
    part : slice
        Rows of the twist (v, ω).
    """

    part: ClassVar[slice]
    order: ClassVar[int] = 1
    subject: ClassVar[str | None] = "tool"

    def rows(self, at: PathPoints, bound: Array) -> Array:
        """Norm of the path's twist per unit of s, over the bound; see `Limit.rows`.

        Parameters
        ----------
        at : PathPoints
            Points of the joint path.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        (k, m, order) array
            [as 1 over the monomials].
        """
        if not np.isfinite(bound[0]):
            return np.zeros((at.s.size, 1, 1))
        return np.asarray(np.linalg.norm(at.twist[:, self.part], axis=1)[:, None, None] / bound[0])

    def judge(self, motion: Examined, bound: Array) -> ToolExtreme:
        """The proved bound on the speed; see `Limit.judge`.

        Parameters
        ----------
        motion : Examined
            The motion.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        ToolExtreme
            Value, ratio and time.
        """
        value, time = self._proved(motion)
        return ToolExtreme(value, value / float(bound[0]) if np.isfinite(bound[0]) else float("nan"), time)

    @abstractmethod
    def _proved(self, motion: Examined) -> tuple[float, float]:
        """Proved bound on the speed over the motion, and when it is nearly reached [s]."""

    def piece_ratios(self, motion: Examined, bound: Array) -> Array:
        """The larger of the speeds at both ends of each piece over the bound; see `Limit.piece_ratios`.

        Parameters
        ----------
        motion : Examined
            The motion.
        bound : (m,) array
            What `Limit.array` returned [as its units].

        Returns
        -------
        (pieces, m) array
            Ratios [1].
        """
        speed = np.maximum(*(np.linalg.norm(side.motion[:, 0, self.part], axis=1) for side in motion.bounds.ends))
        return np.asarray(speed[:, None] / bound)
