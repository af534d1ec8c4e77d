"""Path speed and active constraint of each segment of a motion."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.parts import LimitedPart
from planners.limits._motion import plain


class Binding(NamedTuple):
    """Path speed and active constraint of each of the m segments of a motion.

    ``t`` and ``s`` (m + 1,) are times [s] and path parameters [m, or rad] of their ends, ``speed`` (m,) is the mean of ds/dt.
    ``ratio`` (m,) is the peak ratio to a limit on the segment [1], 0 where nothing is limited; ``limit`` (m,) names that limit
    and ``joint`` (m,) its joint, ``"tool"`` for limits of the tool.
    """

    t: Array
    s: Array
    speed: Array
    ratio: Array
    limit: tuple[str, ...]
    joint: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files; None for infinite and undefined numbers."""
        numbers = {k: plain(getattr(self, k)) for k in ("t", "s", "speed", "ratio")}
        return numbers | {"limit": list(self.limit), "joint": list(self.joint)}


def active_constraints(motion: MotionAnalysis, parts: tuple[LimitedPart, ...], places: Array) -> Binding:
    """Return the peak ratio of every segment, its limit and its joint, with the path parameter (m + 1,) at the knots.

    Joint ratios are exact; tool ratios are taken at both ends of each segment.
    """
    t, n, kinds = motion.trajectory.knots, motion.robot.n, parts[-1].limits.kinds
    each = [[kind.piece_ratios(part.motion, part.limits.bounds(n)[kind.name]) for kind in kinds] for part in parts]
    ratios = np.concatenate([np.concatenate(rows, axis=1) for rows in each], axis=0)
    columns = [(kind.name, subject) for kind in kinds for subject in kind.subjects(motion.robot)]
    which = ratios.argmax(axis=1)
    return Binding(
        t=t,
        s=places,
        speed=np.diff(places) / np.diff(t),
        ratio=ratios[np.arange(len(which)), which],
        limit=tuple(columns[i][0] for i in which),
        joint=tuple(columns[i][1] for i in which),
    )
