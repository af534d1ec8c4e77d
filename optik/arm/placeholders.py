"""Limits of a URDF that are probably no limits: one effort for all joints that does not hold the arm, and velocities of 0."""

from __future__ import annotations

import warnings

import numpy as np

from optik.arm.model import ArmDynamics, ArmModel
from optik.arm.urdf_tree import Joint, join_names
from optik.errors import RobotModelWarning

HELD_CONFIGURATIONS = 64
"""Number of random configurations in which an arm is held against gravity."""

LEAST_HELD = 0.5
"""Fraction of them below which an effort is probably none."""


def warn_of_placeholders(arm: ArmModel, joints: list[Joint]) -> None:
    """Warn of one effort on all joints that the arm's weight mostly exceeds, and of velocities of 0 beside other limits."""
    torque, problems = arm.limits.torque, list[str]()
    same = torque is not None and arm.n > 1 and torque.min() == torque.max()
    if torque is not None and same and arm.inertia is not None:
        q = arm.limits.sample(np.random.default_rng(0), HELD_CONFIGURATIONS)
        held = (np.abs(ArmDynamics(**arm._arguments()).gravity_torques(q)) <= torque).all(axis=1).mean()
        if held < LEAST_HELD:
            words = f"it holds the arm against gravity in {held:.0%} of {HELD_CONFIGURATIONS} random configurations"
            advice = "with_limits(torque=None) ignores it"
            problems.append(f"effort {torque[0]:g} on all joints: a placeholder? {words}; {advice}")
    limits = {joint.name: joint.element["limit"] for joint in joints if "limit" in joint.element}
    still = [name for name, limit in limits.items() if float(limit.get("velocity", "nan")) == 0.0]
    if still and (arm.limits.velocity is not None or same):
        problems.append(f"velocity 0 of joint {join_names(still)}: read as unknown; with_limits(velocity=) sets it")
    for problem in problems:
        warnings.warn(RobotModelWarning(arm.name, problem), stacklevel=5)
