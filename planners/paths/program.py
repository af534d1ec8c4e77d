"""The path of a program: sections one after another, each for its arm, with a stop at the end of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self

import numpy as np

from optik.arm.plain import read_list
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array, Indices
from planners.paths import path_of
from planners.paths.base import Path, PiecewisePath, fields

SAME_PLACE = 1e-12
"""Fraction of the path's length that is rounding."""


class ProgramPath(PiecewisePath):
    """Paths one after another: the tool stops at the end of each, where its pose, but no derivative, is continuous.

    At a change of the tool also the pose jumps, because that of another point counts. s counts on from section to section.

    Parameters
    ----------
    sections : sequence of Path
        At least one, in their order.
    robots : sequence of Robot
        The arm of each section.

    Raises
    ------
    InvalidInput
        No section, or another number of arms.
    """

    name: ClassVar[str] = "program"

    def __init__(self, sections: Sequence[Path], robots: Sequence[Robot]) -> None:
        self.sections, self.robots = tuple(sections), tuple(robots)
        if not self.sections or len(self.robots) != len(self.sections):
            got = f"{len(self.sections)}, {len(self.robots)} arms"
            raise InvalidInput("sections", got, "at least one, each with its arm")
        self.starts: Array = np.concatenate([[0.0], np.cumsum([path.end for path in self.sections])])
        counts = [path.segments if path.name == "joint_curve" else 1 for path in self.sections]
        self.firsts: Indices = np.concatenate([[0], np.cumsum(counts)])
        self.segments = int(self.firsts[-1])
        self.unit = "rad" if any(path.unit == "rad" for path in self.sections) else "m"

    @property
    def end(self) -> float:
        """Sum of the lengths of the sections, each in its unit [m, or rad]."""
        return float(self.starts[-1])

    @property
    def breaks(self) -> Array:
        """Breaks of all sections, and the stops."""
        inner = [a + path.breaks[:-1] for a, path in zip(self.starts[:-1], self.sections, strict=True)]
        return np.append(np.concatenate(inner), self.end)

    def find_sections(self, span: tuple[float, float]) -> range:
        """Return the sections that a part of the path covers; at a stop it begins with the one after.

        Parameters
        ----------
        span : (2,) tuple of float
            Path parameters of begin and end [m, or rad].

        Returns
        -------
        range
            From 0.
        """
        slack = SAME_PLACE * self.end
        first = int(np.searchsorted(self.starts[1:-1], span[0] + slack, side="right"))
        last = int(np.searchsorted(self.starts[1:-1], span[1] - slack, side="left"))
        return range(first, max(first, last) + 1)

    def _evaluate(self, x: Array, order: int) -> Array:
        which = np.clip(np.searchsorted(self.starts, x, side="right") - 1, 0, len(self.sections) - 1)
        out = np.empty((x.size, 4, 4) if order == 0 else (x.size, 6))
        for i, (start, path) in enumerate(zip(self.starts, self.sections, strict=False)):
            at = which == i
            if at.any():
                out[at] = path(np.minimum(x[at] - start, path.end), order)
        return out

    def least_on_pieces(self, values: Array) -> Array:
        """Return values of the pieces between breaks."""
        parts = zip(self.sections, self.firsts[:-1], self.firsts[1:], strict=True)
        return np.concatenate([
            path.least_on_pieces(values[a:b] if path.segments == b - a else np.full(path.segments, values[a]))
            for path, a, b in parts
        ])  # fmt: skip

    def piece_bounds(self) -> Array:
        """Return bounds (k − 1, 2, 4) between breaks."""
        return np.concatenate([path.piece_bounds() for path in self.sections])

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files: the sections, and each arm once."""
        arms = list(dict.fromkeys(self.robots))
        return {
            "path": self.name, "sections": [path.to_dict() for path in self.sections],
            "arms": [arm.to_dict() for arm in arms], "arm": [arms.index(arm) for arm in self.robots],
        }  # fmt: skip

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """Return the path that `to_dict` wrote."""
        sections, arms, which = (read_list(part, "path") for part in fields(data, cls.name, "sections", "arms", "arm"))
        robots = [Robot.from_dict(arm) for arm in arms]
        robots = [robot if arm == robot and robot is not None else arm for arm in robots]
        if len(which) != len(sections) or any(type(i) is not int or not 0 <= i < len(robots) for i in which):
            expected = f"the number of an arm for each of the {len(sections)} sections"
            raise InvalidInput("arm", repr(which)[:60], expected)
        each = [robots[i] for i in which]
        return cls([path_of(part, arm) for part, arm in zip(sections, each, strict=True)], each)


METHOD = ProgramPath
