"""A stretch of another path of the tool."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np

from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput
from optik.types import Array
from planners.paths.base import Path, PiecewisePath, fields


class Stretch(PiecewisePath):
    """A path of the tool from one path parameter to another.

    Parameters
    ----------
    path : Path
        The whole path, not one in joint space.
    begin, until : float
        Its path parameters at the start and the end [m, or rad].

    Raises
    ------
    InvalidInput
        A path in joint space, or path parameters that do not increase inside it.
    """

    name: ClassVar[str] = "stretch"

    def __init__(self, path: Path, begin: float, until: float) -> None:
        if not isinstance(path, Path) or type(path).configurations is not Path.configurations:
            raise InvalidInput("path", repr(path)[:60], "a path of the tool")
        ends = (check_number(x, name, "a path parameter") for x, name in ((begin, "begin"), (until, "until")))
        self.path, (self.begin, self.until) = path, ends
        if not 0.0 <= self.begin < self.until <= path.end:
            allowed = f"path parameters that increase in [0, {path.end:.6g}]"
            raise InvalidInput("begin, until", f"{begin:.6g}, {until:.6g}", allowed)
        self.unit, self.turns_only, self.segments = path.unit, path.turns_only, path.segments
        inside = (path.breaks > self.begin) & (path.breaks < self.until)
        self._breaks = np.concatenate([[self.begin], path.breaks[inside], [self.until]]) - self.begin
        middle = 0.5 * (self._breaks[1:] + self._breaks[:-1]) + self.begin
        self._pieces = np.clip(np.searchsorted(path.breaks, middle) - 1, 0, path.breaks.size - 2)

    @property
    def end(self) -> float:
        """Length of the stretch [m, or rad]."""
        return float(self._breaks[-1])

    @property
    def breaks(self) -> Array:
        """Breaks of the whole path inside, and both ends."""
        return self._breaks

    def _evaluate(self, x: Array, order: int) -> Array:
        return self.path._evaluate(np.clip(x + self.begin, self.begin, self.until), order)

    def piece_bounds(self) -> Array:
        """Return bounds (k − 1, 2, 4) of the pieces of the whole path."""
        return np.asarray(self.path.known_bounds[self._pieces])

    def least_on_pieces(self, values: Array) -> Array:
        """Return values of the pieces between breaks: those of the whole path."""
        return np.asarray(self.path.least_on_pieces(values)[self._pieces])

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files."""
        return {"path": self.name, "whole": self.path.to_dict(), "begin": self.begin, "until": self.until}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """Return the path that `to_dict` wrote."""
        from planners.paths import path_of

        whole, begin, until = fields(data, cls.name, "whole", "begin", "until")
        return cls(path_of(whole, robot), begin, until)


METHOD = Stretch
