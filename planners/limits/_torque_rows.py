"""Rows of torque and of its rate along a joint path: coefficients of the monomials of ṡ, s̈ and s⃛."""

from __future__ import annotations

import numpy as np

from optik import dynamics
from optik.arm.inertia import Load
from optik.types import Array
from planners.limits._points import PathPoints


def torque_rows(at: PathPoints, load: Load) -> Array:
    """Torque of every joint, without Coulomb friction: τ = p s̈ + c ṡ² + f ṡ + g.

    p = M q', c = M q'' + C(q, q') q', f is the viscous friction times q', and g the torque of gravity.
    """
    found = _coefficients(at, load)
    return np.stack([found[:, 0], found[:, 1], load.viscous * at.q(1), found[:, 2]], axis=-1)


def torque_rate_rows(at: PathPoints, load: Load) -> Array:
    """Rate of the torque of every joint, without Coulomb friction: τ̇ = p s⃛ + d ṡ s̈ + c' ṡ³ + g' ṡ + f (q' s̈ + q'' ṡ²).

    d = p' + 2 c; f is the viscous friction, and the other letters as in `torque_rows`.
    """
    found = _coefficients(at, load)
    friction = (load.viscous * at.q(1), load.viscous * at.q(2))
    return np.stack([found[:, 0], found[:, 3], found[:, 4], found[:, 5], *friction], axis=-1)


def _coefficients(at: PathPoints, load: Load) -> Array:
    """What `optik.dynamics.path_torques` finds at the points (k, 6, n), found once for each load."""
    kept = at.torques.get(id(load))
    if kept is None:
        path = np.stack([at.q(order) for order in range(4)])
        kept = np.empty((path.shape[1], 6, path.shape[2]))
        dynamics.path_torques(at.joint_path.robot.chain, load.bodies, path, kept)
        at.torques[id(load)] = kept
    return kept
