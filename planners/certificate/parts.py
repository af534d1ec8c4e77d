"""Parts of a motion with limits of their own: the old limits until the motion can respect the new ones."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from optik.check import check_number
from optik.errors import InvalidInput
from planners.certificate.analysis import MotionAnalysis
from planners.limits import Extreme, MotionLimits, ToolExtreme
from planners.splice import cut_after, cut_before


class LimitedPart(NamedTuple):
    """A part of a motion, its start time [s], and its limits."""

    motion: MotionAnalysis
    begin: float
    limits: MotionLimits


def limited_parts(
    motion: MotionAnalysis, limits: MotionLimits, before: tuple[MotionLimits, float] | None
) -> tuple[LimitedPart, ...]:
    """Return the whole motion as one part, or its parts before and after the time at which the limits change."""
    if before is None:
        return (LimitedPart(motion, 0.0, limits),)
    expected = "limits of the same kinds, and the time of a knot inside the motion"
    if not isinstance(before, tuple | list) or len(before) != 2 or not isinstance(before[0], MotionLimits):
        raise InvalidInput("before", repr(before)[:60], expected)
    old, t = before[0], check_number(before[1], "before", expected, above=0.0)
    trajectory, path = motion.trajectory, motion.path if motion.has_path else None
    knots = trajectory.knots
    t = float(knots[int(np.abs(knots - t).argmin())]) if np.abs(knots - t).min() <= 1e-12 * trajectory.end else t
    if old.names != limits.names or t not in knots:
        raise InvalidInput("before", f"limits on {', '.join(old.names)} until {t:.9g} s", expected)
    if t >= trajectory.end:
        return (LimitedPart(motion, 0.0, old),)
    first, second = (
        MotionAnalysis(motion.robot, part, path) for part in (cut_after(trajectory, t), cut_before(trajectory, t))
    )
    return LimitedPart(first, 0.0, old), LimitedPart(second, t, limits)


def judge_parts(motion: MotionAnalysis, parts: tuple[LimitedPart, ...]) -> dict[str, Any]:
    """Return the peak values of each kind of limit over the parts; infinite if a derivative jumps between two parts."""
    n = motion.robot.n
    found: dict[str, Any] = {}
    for kind in parts[-1].limits.kinds:
        each: list[Any] = [kind.judge(part.motion, part.limits.bounds(n)[kind.name]) for part in parts]
        each = [x._replace(time=x.time + part.begin) for x, part in zip(each, parts, strict=True)]
        found[kind.name] = each[0] if len(each) == 1 else _select_worse(*each)
    if len(parts) > 1:
        k = int(np.searchsorted(motion.trajectory.knots, parts[1].begin))
        jump = motion.jumps[:3, k].any(axis=0)
        for kind in parts[-1].limits.kinds if jump.any() else ():
            if (
                kind.order > 2
            ):  # a jump of the acceleration is an infinite rate; one of a joint moves the torques of all
                worst, where = found[kind.name], jump if kind.name == "jerk" else jump.any()
                ratio = np.where(where & ~np.isnan(worst.ratio), np.inf, worst.ratio)
                found[kind.name] = worst._replace(ratio=ratio)
    return found


def _select_worse(first: Any, second: Any) -> Extreme | ToolExtreme:
    """Return for each joint the peak with the larger ratio, or with the larger value if neither is limited."""
    free = np.isnan(first.ratio) & np.isnan(second.ratio)
    a, b = (np.where(free, x.value, np.nan_to_num(x.ratio, nan=-1.0, posinf=np.inf)) for x in (first, second))
    chosen = [np.where(a >= b, x, y) for x, y in zip(first, second, strict=True)]
    return Extreme(*chosen) if isinstance(first, Extreme) else ToolExtreme(*(float(x) for x in chosen))
