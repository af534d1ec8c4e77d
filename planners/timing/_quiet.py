"""A motion that leaves an elastic mode at rest: s(t) averaged over one period of the mode.

The mean over w = 1/f is a filter with zeros at f and its multiples. s̄̇ = (s(t) − s(t − w)) / w, and so for each derivative.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from optik.errors import NoSolution
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.following.joint_path import JointPath
from planners.limits import MotionLimits
from planners.motion.motion import stretch_analysed
from planners.timing.base import refit
from planners.trajectory import Trajectory
from planners.trajectory.curve import quintic_through

BASES = ((7.0, "acceleration"), (1.0, "jerk"))
"""Jerk limits of the base motions over the given ones, and the limit that is reduced where the jerk exceeds its own: after the
mean it is at most the change of the acceleration within w, over w."""
MEAN_APART = 1e-4
"""Least time [s] between knots of the mean: in shorter pieces rounding dominates the jerk."""
ROUNDS, SPARE, CLOSE = 8, 0.999, 1.002
"""Most rounds in which the limits of the base motion are scaled, the fraction of a limit that is aimed at, and the excess at
which they end: a stretch by it moves the zero of the filter as little."""
Run = Callable[[JointPath, MotionLimits], tuple[MotionAnalysis, Any]]
"""The law of the base motion."""


def plan_quiet(
    run: Run, joint_path: JointPath, limits: MotionLimits, enforced: tuple[str, ...], frequency: float
) -> tuple[MotionAnalysis, Any]:
    """Return the shortest averaged motion of the base motions, and the optimum of its base motion."""
    best: tuple[MotionAnalysis, Any] | None = None
    for factor, reduced in BASES:
        base = limits.scale(factor, ("jerk",))
        found = _fit_base(run, joint_path, (limits, base), enforced, 1.0 / frequency, reduced)
        if found is not None and (best is None or found[0].trajectory.end < best[0].trajectory.end):
            best = found
    if best is None:
        raise NoSolution(
            f"no motion averaged over {1.0 / frequency:.4g} s respects the limits",
            advice="a higher frequency, higher limits, or no quiet=",
        )
    return best


def _fit_base(
    run: Run,
    joint_path: JointPath,
    both: tuple[MotionLimits, MotionLimits],
    enforced: tuple[str, ...],
    w: float,
    reduced: str,
) -> tuple[MotionAnalysis, Any] | None:
    """Return the averaged motion whose base limits are scaled until it respects the limits; None if they cannot be."""
    (limits, base), bounds = both, both[0].bounds(joint_path.robot.n)
    kinds = [kind for kind in limits.kinds if kind.name in enforced and kind.is_given(bounds[kind.name])]
    for _ in range(ROUNDS):
        try:
            analysis, optimum = run(joint_path, base)
        except NoSolution:
            return None
        law = average(joint_path, analysis.trajectory, w)
        motion = MotionAnalysis(
            joint_path.robot, refit(joint_path, law, limits.arrays(joint_path.robot.n)["jerk"]), joint_path.path
        )
        ratios = {kind.name: float(np.nanmax(kind.judge(motion, bounds[kind.name]).ratio)) for kind in kinds}
        if max(ratios.values()) <= CLOSE:
            return stretch_analysed(motion, limits, enforced) if max(ratios.values()) > 1.0 else motion, optimum
        for name, ratio in ratios.items():
            if ratio > 1.0:
                base = base.scale(SPARE / ratio, (reduced if name == "jerk" else name,))
    return None


def average(joint_path: JointPath, motion: Trajectory, w: float) -> Any:
    """Return the piecewise quintic s̄(t), the mean of the path parameter of a motion over the last w seconds."""
    t, s, end = motion.knots, motion.s, motion.end
    assert s is not None
    q1, q2 = joint_path(s, 1), joint_path(s, 2)
    square = np.einsum("ki,ki->k", q1, q1)
    v = np.einsum("ki,ki->k", q1, motion(t, 1)) / square
    a = np.einsum("ki,ki->k", q1, motion(t, 2) - q2 * v[:, None] ** 2) / square
    v[[0, -1]], a[[0, -1]] = 0.0, 0.0
    along = quintic_through(t, s[:, None], v[:, None], a[:, None])
    total = along.antiderivative()

    def at(x: Array, order: int) -> Array:
        """Return the integral of s, s, or ṡ, which is constant before and after the motion."""
        inside = np.clip(x, 0.0, end)
        if order < 0:
            return np.asarray(total(inside)[:, 0] + np.maximum(x - end, 0.0) * s[-1])
        return np.asarray(along(inside, order)[:, 0])

    knots = np.unique(np.concatenate([t, t + w]))
    knots = knots[np.diff(knots, prepend=-1.0) > MEAN_APART]
    knots[-1] = end + w
    p, v, a = ((at(knots, order) - at(knots - w, order)) / w for order in (-1, 0, 1))
    p[0], p[-1], v[[0, -1]], a[[0, -1]] = s[0], s[-1], 0.0, 0.0
    mean = quintic_through(knots, *(x[:, None] for x in (np.clip(p, s[0], s[-1]), v, a)))
    return scipy.interpolate.PPoly(mean.c[:, :, 0], knots)
