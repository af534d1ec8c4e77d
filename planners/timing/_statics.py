"""Static torque along a path, of gravity and Coulomb friction: it decides whether any motion along the path exists."""

from __future__ import annotations

import numpy as np
import scipy

from optik.errors import NoSolution
from optik.types import Array
from planners.certificate.bounds import MotionBounds
from planners.certificate.torque import TorqueBounds
from planners.following.joint_path import JointPath
from planners.limits import MotionLimits
from planners.limits._motion import TorqueRatios
from planners.trajectory import Trajectory

STATIC_EXCESS = 1e-3
"""Largest excess of the bound on the static torque over the largest value found, as a fraction of it: if the limit is between
both, the time law decides."""


def static_torque(joint_path: JointPath, bound: Array, since: float = 0.0) -> TorqueRatios:
    """Return bounds on the static torque on a joint path: of gravity, and of Coulomb friction in the path's direction.

    Where a joint rests or reverses, as all joints do at both ends, friction counts on both sides.
    """
    along = Trajectory(scipy.interpolate.PPoly(joint_path.coefficients, joint_path.nodes))
    bounds = MotionBounds(joint_path.robot, along)
    begin = int(np.searchsorted(along.knots[1:-1], since, side="right"))
    pieces, knots = np.arange(begin, along.knots.size - 1), along.knots[begin:]
    first, last = (bounds.joints_at(pieces, s) for s in (knots[:-1], knots[1:]))
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
    """Raise NoSolution if gravity and friction alone exceed the torque limits along a path, and those are enforced."""
    if limits.torque is None or "torque" not in enforced:
        return
    given = limits.bounds(joint_path.robot.n)["torque"]
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
