"""A path in one file: a helix about the vertical through a point beside the start; the tool keeps its orientation.

Try it: ``optik plan path examples/plugins/spiral.py --set radius=0.03 --set turns=1.5 --set rise=0.04``.
"""

from __future__ import annotations

import numpy as np

from optik import se3
from optik.check import check_number
from planners import Path
from planners.paths.base import fields

EXAMPLES = {"up": {"radius": 0.03, "turns": 1.5, "rise": 0.04}, "flat": {"radius": 0.02, "turns": 0.8, "rise": 0.0}}
"""Data, without the start, of the paths that the contract tests try."""


class Spiral(Path):
    """A helix that begins at `start`; its axis is vertical and `radius` away along the base's −x.

    Parameters
    ----------
    start : (4, 4) array
        T_base_tool at s = 0 [m].
    radius : float
        Distance from the axis [m].
    turns : float
        How many [1].
    rise : float
        Height of the end above the start [m].
    """

    def __init__(self, start, radius, turns, rise):
        self.start = se3.nearest_pose(se3.check_pose(start, "start"))
        self.radius = check_number(radius, "radius", "metres above 0", above=0.0)
        self.turns = check_number(turns, "turns", "a number above 0", above=0.0)
        self.rise = check_number(rise, "rise", "metres")
        self._end = float(np.hypot(2.0 * np.pi * self.turns * self.radius, self.rise))
        self._rate = 2.0 * np.pi * self.turns / self._end  # angle per metre of the path

    @property
    def end(self):
        """Length [m]."""
        return self._end

    def _evaluate(self, s, order):
        """Poses (k, 4, 4) at s (k,), or twists (k, 6) and their derivatives; s is the length, so that |v| = 1."""
        w = self._rate
        phase = w * s + 0.5 * np.pi * order  # a derivative of cos and sin is a quarter of a turn
        p = np.zeros((s.size, 3))
        p[:, 0], p[:, 1] = np.cos(phase), np.sin(phase)
        p *= self.radius * w**order
        if order == 0:
            T = np.tile(self.start, (s.size, 1, 1))
            T[:, :3, 3] += p - np.array([self.radius, 0.0, 0.0])
            T[:, 2, 3] += self.rise / self._end * s
            return T
        p[:, 2] = self.rise / self._end if order == 1 else 0.0
        return np.hstack([p, np.zeros_like(p)])

    def derivative_bounds(self):
        """Bounds (2, 4) on the derivatives of position and rotation: exact ones."""
        position = self.radius * self._rate ** np.arange(1, 5)
        position[0] = 1.0
        return np.array([position, np.zeros(4)])

    def to_dict(self):
        """Plain data for files."""
        return {
            "path": self.name, "start": self.start.tolist(),
            "radius": self.radius, "turns": self.turns, "rise": self.rise,
        }  # fmt: skip

    @classmethod
    def from_dict(cls, data, robot=None):
        """The path that `to_dict` wrote."""
        return cls(*fields(data, cls.name, "start", "radius", "turns", "rise"))


METHOD = Spiral
