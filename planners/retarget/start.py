"""Running motions of an arm: a motion, a trajectory, joints at rest, or a moving state that is brought to rest."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from optik.check import format_value, real_array
from optik.errors import InvalidInput
from planners.retarget.cubics import BRIEF_REST
from planners.retarget.engine import Retargeter, clip_joints
from planners.retarget.jog import Jog
from planners.trajectory import Trajectory, join, make_rest

AT_REST = 1e-9
"""Largest velocity of a joint at the end of a motion that ends at rest [rad/s, m/s]."""


def begin(engine: Retargeter, start: Any, argument: str) -> Trajectory:
    """Return a running motion that ends at rest; a moving state or end is continued by a stop."""
    robot, n = engine.robot, engine.robot.n
    curve = start if isinstance(start, Trajectory) else getattr(start, "trajectory", None)
    expected = f"a motion of {n} joints, {n} finite joint values, or a state (q, q̇, q̈) of shape (3, {n})"
    if curve is not None:
        X = np.array([curve(curve.end, order) for order in range(3)])
        rests = np.abs(X[1]).max() <= AT_REST
    else:
        X = real_array(start, argument, expected)
        X = np.stack([X, *np.zeros((2, X.size))]) if X.ndim == 1 else X
        rests = not X[1:].any()
    if X.shape != (3, n) or not np.isfinite(X).all():
        raise InvalidInput(argument, format_value(start, 60), expected)
    if curve is None:
        X = np.stack([clip_joints(robot, X[0], argument), *X[1:]])
    if rests:
        return curve or make_rest(X[0], 3.0 * BRIEF_REST)
    moving = scipy.interpolate.PPoly((X / [[1.0], [1.0], [2.0]])[::-1, None], np.array([0.0, BRIEF_REST]))
    stop = engine.run(Trajectory(moving), 0.0, Jog(np.zeros(n), 0.0))
    if not stop:
        raise InvalidInput(argument, f"a moving state: {stop.reason}", "a state that can be stopped within the limits")
    return stop.trajectory if curve is None else join(curve, stop.trajectory)
