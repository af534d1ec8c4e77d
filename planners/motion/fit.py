"""Scale a motion in time until it reaches a limit and exceeds none, test the static torque, and match a given start."""

from __future__ import annotations

from math import factorial

import numpy as np
import scipy

from optik.arm.robot import Robot
from optik.errors import NoSolution
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.torque import TorqueBounds
from planners.following.joint_path import JointPath
from planners.limits import MotionLimits, check_names, kind_of
from planners.limits.inputs import TorqueRatios
from planners.paths.base import Path
from planners.trajectory import State, Trajectory, shift_pieces
from planners.trajectory.curve import quintic

FIRST_MARGIN = 1e-12
"""Relative margin of a second slow-down, needed if rounding still exceeds a limit; ten times as much for each further one."""
SPARE = 1e-6
"""Largest fraction of the duration that a scaled motion may be too slow: gravity does not scale with a power of the speed."""
MOST_SPEED_UPS = 4
"""Most times that such a motion is sped up again; each adds a few digits."""


def stretch_factor(motion: MotionAnalysis, limits: MotionLimits, enforced: tuple[str, ...] | None = None) -> float:
    """Return the least factor by which a motion from rest to rest is stretched in time to respect the limits."""
    if enforced is not None:
        check_names(enforced, "enforced")
    bounds = limits.bounds(motion.robot.n)
    chosen = [kind for kind in limits.kinds if enforced is None or kind.name in enforced]
    return max((kind.stretch_factor(motion, bounds[kind.name]) for kind in chosen), default=0.0)


def is_within(motion: MotionAnalysis, limits: MotionLimits, names: tuple[str, ...]) -> bool:
    """Say whether a motion respects these limits, as the certificate judges them."""
    bounds = limits.bounds(motion.robot.n)
    chosen = [kind for kind in limits.kinds if kind.name in names and kind.is_given(bounds[kind.name])]
    return all(float(np.nanmax(kind.judge(motion, bounds[kind.name]).ratio)) <= 1.0 for kind in chosen)


def fit_to_limits(
    robot: Robot,
    trajectory: Trajectory,
    limits: MotionLimits,
    enforced: tuple[str, ...] | None = None,
    path: Path | None = None,
) -> Trajectory:
    """Return a motion from rest to rest, scaled in time to reach a limit and exceed none."""
    return fit(MotionAnalysis(robot, trajectory, path), limits, enforced).trajectory


def fit(motion: MotionAnalysis, limits: MotionLimits, enforced: tuple[str, ...] | None = None) -> MotionAnalysis:
    """Return a motion from rest to rest, scaled in time to reach a limit and exceed none, with its analysis."""
    factor = stretch_factor(motion, limits, enforced)
    if not factor > 0.0:
        return motion
    margin = 0.0
    while True:
        if not np.isfinite(factor):
            raise NoSolution("a limit is exceeded at any speed", advice="another path, or higher limits")
        motion = motion.slowed(factor * (1.0 + margin))
        factor = stretch_factor(motion, limits, enforced)
        if factor <= 1.0:
            break
        margin = 10.0 * margin if margin else FIRST_MARGIN  # rounding in the scaled motion may still exceed a limit
    for _ in range(MOST_SPEED_UPS):
        if not 0.0 < factor < 1.0 - SPARE:
            break
        closer = motion.slowed(factor)
        factor = stretch_factor(closer, limits, enforced)
        if factor > 1.0:
            break
        motion = closer
    return motion


PEAKS = np.array([[1.875, 1.0, 0.1], [5.78, 3.95, 1.0], [60.0, 36.0, 9.0]])
"""Largest velocity, acceleration and jerk of the quintic from a unit of q, q̇ or q̈ to standstill at 0, in unit time."""
FADE_FRACTION = 1e-3
"""Fraction of the jerk limits that the correction of the initial state may use: the time lost is negligible."""
SAME_POSITION = 1e-14
"""Largest difference of positions [rad or m] that is rounding."""


def match_start(trajectory: Trajectory, start: State, limits: MotionLimits) -> Trajectory:
    """Return the motion with exactly this start q, q̇, q̈ (n,) each, which is close to its own.

    q(s) differs from a measured or refitted state by noise or rounding. The difference is added as a quintic that fades to 0
    at the first knot at which its jerk is at most `FADE_FRACTION` of the limits, else at the last. A difference of position
    that is rounding is added as a constant: to fade it out over a short time would need jerk.
    """
    off = np.array([x - trajectory(0.0, order) for order, x in enumerate(start)])
    off[0, np.abs(off[0]) <= SAME_POSITION] = 0.0
    knots, c = trajectory.knots, trajectory.padded.copy()
    jerk = limits.arrays(trajectory.n)["jerk"]
    ends = knots[1:, None]
    peaks = sum(PEAKS[2, i] * np.abs(off[i]) / ends ** (3 - i) for i in range(3)) / jerk
    little = np.flatnonzero(np.max(peaks, axis=1) <= FADE_FRACTION)
    count = int(little[0]) + 1 if little.size else knots.size - 1
    still = np.zeros((1, trajectory.n))
    over = quintic(knots[[0, count]], (off[:1], off[1:2], off[2:]), (still, still, still)).c
    c[:, :count] += shift_pieces(np.repeat(over, count, axis=1), knots[:count])
    c[5] += np.where(off[0] == 0.0, start[0] - trajectory(0.0), 0.0)
    for order, x in enumerate(start):
        c[5 - order, 0] = x / factorial(order)
    return Trajectory(scipy.interpolate.PPoly(c, knots, extrapolate=True), trajectory.s)


STATIC_EXCESS = 1e-3
"""Largest excess of the bound on the static torque over the largest value found, as a fraction of it: if the limit is between
both, the time law decides."""


def static_torque(joint_path: JointPath, bound: Array, since: float = 0.0) -> TorqueRatios:
    """Return bounds on the static torque on a joint path: of gravity, and of Coulomb friction in the path's direction.

    Where a joint rests or reverses, as all joints do at both ends, friction counts on both sides.
    """
    along = Trajectory(scipy.interpolate.PPoly(joint_path.coefficients, joint_path.nodes))
    motion = MotionAnalysis(joint_path.robot, along)
    begin = int(np.searchsorted(along.knots[1:-1], since, side="right"))
    pieces, knots = np.arange(begin, along.knots.size - 1), along.knots[begin:]
    first, last = (motion.joints_at(pieces, s) for s in (knots[:-1], knots[1:]))
    torques = TorqueBounds(joint_path.robot, knots, first, last, still=True)
    found = torques.bound_ratios(bound, rate=False, excess=STATIC_EXCESS)
    for model, ends in zip(torques.models, torques.ends, strict=True):
        resting = [(along.end, ends.right[-1, 0])] + ([] if since > 0.0 else [(0.0, ends.left[0, 0])])
        for s, value in resting:
            found = _include_rest(found, bound, s, value, model[1].coulomb)
    return found


def _include_rest(found: TorqueRatios, bound: Array, s: float, value: Array, friction: Array) -> TorqueRatios:
    """Return the larger of the given ratios and those of a state of rest at s, with friction on both sides."""
    down, up = (value - friction) / bound[0], (value + friction) / bound[1]
    ratio = np.maximum(down, up)
    return TorqueRatios(
        np.maximum(found.ratio, ratio),
        np.maximum(found.found, ratio),
        np.where(ratio > found.found, s, found.time),
        np.where(ratio > found.found, up >= down, found.upper),
    )


def check_statics(joint_path: JointPath, limits: MotionLimits, enforced: tuple[str, ...], since: float = 0.0) -> None:
    """Raise NoSolution if an enforced limit is exceeded along a path however slowly the arm moves."""
    bounds = limits.bounds(joint_path.robot.n)
    for name in limits.extra or ():
        if name in enforced:
            kind_of(name).check_still(joint_path, bounds[name])
    if limits.torque is None or "torque" not in enforced:
        return
    given = bounds["torque"]
    bound = np.stack([-given, given]) if given.ndim == 1 else given
    found = static_torque(joint_path, bound, since)
    ratio = np.where(np.isfinite(bound[1]), found.found, 0.0)
    i = int(ratio.argmax())
    if ratio[i] <= 1.0:
        return
    limit = abs(float(bound[1 if found.upper[i] else 0, i]))
    robot, s = joint_path.robot, float(found.time[i])
    force = "N" if robot.prismatic[i] else "N·m"
    raise NoSolution(
        f"the limit of {limit:.6g} {force} on the torque of {robot.joint_names[i]} is below the {ratio[i] * limit:.6g} {force} "
        f"that gravity and friction need at s = {s:.6g} {joint_path.path.unit}, however slowly the arm moves",
        s=s, joint=robot.joint_names[i], advice="another path, a lighter payload, or a higher limit",
    )  # fmt: skip
