"""Proved bounds on the derivatives of the tool along a curve of the joints, for all paths in joint space."""

from __future__ import annotations

import numpy as np

from optik import kinematics
from optik.arm.robot import Robot
from optik.types import Array
from planners.paths.poses import rotation_derivative_norms
from planners.trajectory.curve import BINOMIAL, bells


def tool_twists(robot: Robot, joints: Array) -> Array:
    """Return the twists and their first two derivatives (k, 3, 6) of joints and their first three derivatives (k, 4, n)."""
    twists = np.empty((len(joints), 3, 6))
    q, derivatives = np.ascontiguousarray(joints[:, 0]), np.ascontiguousarray(joints[:, 1:])
    kinematics.tool_motion_batch(robot.chain, q, derivatives, twists)
    return twists


def tool_bounds(robot: Robot, most: Array, width: Array, twists: Array) -> Array:
    """Return bounds (m, 2, 4) on the derivatives of position and rotation on pieces of a curve of the joints.

    The fourth is by reach alone. A lower one is at most its largest sample, plus half the distance of the samples times the
    bound above it.

    Shapes and units: most (m, 5, n), bounds on the joints and their derivatives; width (m,) of the pieces; twists
    (m c, 3, 6) at equal distances on each piece, both ends included [per unit of s].
    """
    bounds = reach_bounds(robot, most)
    norms = np.stack([
        np.linalg.norm(twists[:, :, :3], axis=2), rotation_derivative_norms(*np.swapaxes(twists[:, :, 3:], 0, 1))
    ], axis=1)  # fmt: skip
    samples = norms.reshape(len(width), -1, 2, 3)
    half = 0.5 * width[:, None] / (samples.shape[1] - 1)
    for k in (2, 1, 0):
        between = (1.0 + 1e-12) * samples[..., k].max(axis=1) + half * bounds[:, :, k + 1]
        bounds[:, :, k] = np.minimum(bounds[:, :, k], between)
    return bounds


def reach_bounds(robot: Robot, most: Array) -> Array:
    """Return bounds (m, 2, 4) for any motion with such rates: a link turns at most at the sum of those before it."""
    # A link vector t behind joint i gives |t_xy| Bᵢ + |t_z| Bᵢ₋₁, the Bell polynomials of the sums of |q⁽ᵐ⁾| of the
    # revolute joints up to i, since joint i does not move points on its own axis; a prismatic joint gives a product.
    if (follow := robot.linkage) is not None:
        robot, most = robot.axes, follow.spread_bounds(most)
    k = len(most)
    turning = np.where(robot.prismatic, 0.0, most)
    turning[:, 0] = 0.0
    sums = np.concatenate([np.zeros((k, 5, 1)), np.cumsum(turning, axis=2)], axis=2)
    turns = np.empty((robot.n + 1, k, 5))
    for i in range(robot.n + 1):
        bells(np.ascontiguousarray(sums[:, :, i]), turns[i])
    links = np.concatenate([robot.fixed, robot.tool[None]])[:, :3, 3]
    position = np.zeros((k, 5))
    for i, link in enumerate(links):
        position += float(np.hypot(link[0], link[1])) * turns[i] + abs(link[2]) * turns[max(i - 1, 0)]
        if i < robot.n and robot.prismatic[i]:
            for m in range(5):
                for j in range(m + 1):
                    position[:, m] += BINOMIAL[m, j] * most[:, j, i] * turns[i][:, m - j]
    return np.stack([position[:, 1:], turns[-1][:, 1:]], axis=1)
