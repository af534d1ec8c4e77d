"""Bounds on how fast a tool's motion can change between instants, from the joints' polynomials alone; proved, compiled.

The tool is at p = Σ_l R_l f_l, the sum over the arm's links of fixed vectors turned by all joints before them. If the joints
before link l turn with |q̇| + … ≤ S₁, |q̈| + … ≤ S₂ and so on, then |dᵏR_l/dtᵏ| ≤ B_k(S₁, …, S_k), the complete Bell polynomial:
it holds for one joint by Faà di Bruno's formula, and products of rotations add their S (Bell polynomials are of binomial
type). A joint that slides adds R_j z q_j, by Leibniz's rule.
"""

from __future__ import annotations

from functools import cached_property
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik import kinematics
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.types import Array
from planners.trajectory import Trajectory

Bools = NDArray[np.bool_]

BINOMIAL = np.array([[comb(k, i) for i in range(6)] for k in range(6)], dtype=np.float64)


@compiled
def bell(S: Array, B: Array) -> None:
    """Complete Bell polynomials B (6,) of S (6,), S[0] not used: B_k = Σ_i C(k−1, i) B_{k−1−i} S_{i+1}."""
    B[0] = 1.0
    for k in range(1, 6):
        B[k] = 0.0
        for i in range(k):
            B[k] += BINOMIAL[k - 1, i] * B[k - 1 - i] * S[i + 1]


@compiled
def tool_bounds(links: Array, prismatic: Bools, D: Array, position: Array, rotation: Array, spin: Array) -> None:
    """Bounds of intervals from bounds D (k, 6, n) on |dⁱq/dtⁱ|, i = 0…5.

    links (n + 1,) are the lengths of the fixed vectors, the base's first, the tool's last. Into position (k, 6) and
    rotation (k, 6), |dⁱp/dtⁱ| and ‖dⁱR/dtⁱ‖₂ for i = 1…5, and spin (k,), |d⁴ω/dt⁴|.
    """
    n = prismatic.shape[0]
    S, B = np.empty(6), np.empty(6)
    for k in range(D.shape[0]):
        for i in range(6):
            S[i] = position[k, i] = 0.0
        spin[k] = 0.0
        bell(S, B)
        for j in range(n):
            if prismatic[j]:
                for i in range(1, 6):
                    for m in range(i + 1):
                        position[k, i] += BINOMIAL[i, m] * B[m] * D[k, i - m, j]
            else:
                for m in range(5):
                    spin[k] += BINOMIAL[4, m] * B[m] * D[k, 5 - m, j]
                for i in range(1, 6):
                    S[i] += D[k, i, j]
                bell(S, B)
            for i in range(1, 6):
                position[k, i] += links[j + 1] * B[i]
        for i in range(6):
            rotation[k, i] = B[i]


@compiled
def joint_bounds(derivatives: Array, h: Array, D: Array) -> None:
    """Bounds D (k, 6, n) on |dⁱq/dtⁱ| over [t, t + h] from the derivatives (k, 6, n) of quintics at t: their Taylor sums."""
    for k in range(h.shape[0]):
        for i in range(6):
            for j in range(derivatives.shape[2]):
                total, factor = 0.0, 1.0
                for m in range(6 - i):
                    total += abs(derivatives[k, i + m, j]) * factor
                    factor *= h[k] / (m + 1)
                D[k, i, j] = total


@compiled
def instants(c: Array, piece: NDArray[np.int64], u: Array, out: Array) -> None:
    """Derivatives of order 0 to 5 (k, 6, n) of quintic pieces c (6, m, n), highest power first, u (k,) after their start."""
    for k in range(u.shape[0]):
        for j in range(c.shape[2]):
            for order in range(6):
                value = 0.0
                for power in range(5, order - 1, -1):
                    factor = 1.0
                    for i in range(order):
                        factor *= power - i
                    value = value * u[k] + factor * c[5 - power, piece[k], j]
                out[k, order, j] = value


class Instants(NamedTuple):
    """A motion at instants t (k,).

    ``joints`` (k, 6, n) are the derivatives of q of order 0 to 5, ``poses`` (k, 4, 4) the tool's, ``motion`` (k, 3, 6) its
    twist and that one's first two derivatives in the base frame.
    """

    t: Array
    joints: Array
    poses: Array
    motion: Array


class MotionBounds:
    """A trajectory cut into intervals, each with bounds on the derivatives of the tool's motion.

    Parameters
    ----------
    robot : Robot
        The arm.
    trajectory : Trajectory
        Its motion.
    """

    def __init__(self, robot: Robot, trajectory: Trajectory) -> None:
        self.robot = robot
        self._c = trajectory.padded
        self.knots: Array = trajectory.knots
        self.links: Array = np.linalg.norm([*robot.fixed[:, :3, 3], robot.tool[:3, 3]], axis=1)

    @cached_property
    def ends(self) -> tuple[Instants, Instants]:
        """The motion at the first and at the last instant of every piece."""
        piece = np.arange(self.knots.size - 1)
        return self.at(piece, self.knots[:-1]), self.at(piece, self.knots[1:])

    def joints_at(self, piece: NDArray[np.int64], t: Array) -> Array:
        """Derivatives (k, 6, n) of the joints at t (k,), by given pieces."""
        joints = np.empty((t.size, 6, self.robot.n))
        instants(self._c, piece, t - self.knots[piece], joints)
        return joints

    def at(self, piece: NDArray[np.int64], t: Array) -> Instants:
        """The motion at t (k,), by given pieces."""
        joints = self.joints_at(piece, t)
        robot = self.robot
        poses, motion = np.empty((t.size, 4, 4)), np.empty((t.size, 3, 6))
        q = np.ascontiguousarray(joints[:, 0])
        kinematics.fk_batch(robot.chain, q, poses)
        kinematics.tool_motion_batch(robot.chain, q, np.ascontiguousarray(joints[:, 1:4]), motion)
        return Instants(t, joints, poses, motion)

    def between(self, left: Instants, h: Array) -> tuple[Array, Array, Array]:
        """Bounds over [t, t + h]: on |dⁱp/dtⁱ| and ‖dⁱR/dtⁱ‖₂ (k, 6), and on |d⁴ω/dt⁴| (k,)."""
        D = np.empty_like(left.joints)
        joint_bounds(left.joints, h, D)
        position, rotation, spin = np.empty((h.size, 6)), np.empty((h.size, 6)), np.empty(h.size)
        tool_bounds(self.links, self.robot.prismatic, D, position, rotation, spin)
        return position, rotation, spin


def hermite_bound(left: Array, left_rate: Array, right: Array, right_rate: Array, h: Array, fourth: Array) -> Array:
    """Bound (k,) on the norm over [0, h] of curves with values and rates (k, d) at both ends and |f⁗| ≤ fourth (k,).

    A curve is within fourth · h⁴ / 384 of the cubic through its ends (de Boor, A Practical Guide to Splines, ch. IV; the
    bound holds for vectors, along every direction), and the cubic within the hull of its Bézier points.
    """
    bound = np.empty(h.size)
    left, left_rate, right, right_rate = (np.ascontiguousarray(x) for x in (left, left_rate, right, right_rate))
    _bezier_bounds(left, left_rate, right, right_rate, h, np.ascontiguousarray(fourth), bound)
    return bound


@compiled
def bezier_bound(left: Array, left_rate: Array, right: Array, right_rate: Array, h: float, fourth: float) -> float:
    """`hermite_bound` of one curve, with values and rates (d,)."""
    third, p0, p1, p2, p3 = h / 3.0, 0.0, 0.0, 0.0, 0.0
    for i in range(left.shape[0]):
        a, b = left[i], right[i]
        c, d = a + third * left_rate[i], b - third * right_rate[i]
        p0, p1, p2, p3 = p0 + a * a, p1 + b * b, p2 + c * c, p3 + d * d
    return float(np.sqrt(max(p0, p1, p2, p3)) + fourth * h**4 / 384.0)


@compiled
def _bezier_bounds(
    left: Array, left_rate: Array, right: Array, right_rate: Array, h: Array, fourth: Array, bound: Array
) -> None:
    for k in range(h.shape[0]):
        bound[k] = bezier_bound(left[k], left_rate[k], right[k], right_rate[k], h[k], fourth[k])
