"""Bounds on torques and their rates within intervals of time: values at both ends, and a bound on the fourth derivative.

Inside a piece the torque τ of a joint is smooth. At both ends of an interval of length h it and its rate are known exactly. For
the cubic H through these four numbers,

    |τ − H| ≤ h⁴ / 384 · max|τ⁗|        and        |τ̇ − Ḣ| ≤ √3 h³ / 216 · max|τ⁗|

(Birkhoff and Priver, Hermite interpolation errors for derivatives, J. Math. Phys. 46, 1967; both constants are sharp), and the
extrema of a cubic and of its parabola are exact.

The fourth derivative. By d'Alembert's principle the torque of joint i is the sum over the masses dm that it carries, at x,

    τ_i = Σ ∫ ∂x/∂q_i · (ẍ − g) dm + motor_i q̈_i + viscous_i q̇_i.

In link l, x = c_l + ρ with the centre of mass c_l and ρ fixed in the link; terms of one factor ρ integrate to zero. So

    τ_i = Σ_l  m_l ∂c_l/∂q_i · (c̈_l − g)  +  ∫ (z_i × ρ) · ρ̈ dm      (the second part for a revolute joint i only).

A vector of length 1 that is fixed in link l is turned by the joints 1 to l: its kth derivative is at most B_k(S_1 to S_k),
the complete Bell polynomial of S_i = Σ |dⁱq_j/dtⁱ| over the revolute ones of them; see `planners.certificate.bounds`. So
|c_l⁽ᵏ⁾| is at most Σ_j |d_j| B_k(S of joints before j) + |c| B_k(S of joint l), with d_j the fixed vector before joint j; one
that slides adds z_j q_j, by Leibniz's rule. For a revolute joint i, ∂c_l/∂q_i = z_i × (c_l − p_i), where z_i turns with joints
before i and each part of c_l − p_i with these and further ones: a product of rotations, whose derivatives have the bounds of
that part alone. So has z_i × ρ, and ∫ |ρ|² dm is half of the trace of the inertia about the centre of mass. Leibniz's rule
gives the bound on τ⁗. As q⁽⁶⁾ = 0 in quintics, the motors' inertia adds nothing to it, and viscous friction |q⁽⁵⁾|.
Of gravity alone, −Σ m_l ∂c_l/∂q_i · g, only the fourth derivative of ∂c_l/∂q_i remains.
"""

from __future__ import annotations

import numpy as np

from optik.arm.inertia import Load
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.types import Array, Flags
from planners.curve import BINOMIAL, bell

VALUE_REMAINDER = 1.0 / 384.0
"""Largest distance of a function from its cubic Hermite interpolant, over h⁴ and its fourth derivative."""
RATE_REMAINDER = float(np.sqrt(3.0)) / 216.0
"""Largest distance of a function's derivative from that of its cubic Hermite interpolant, over h³ and its fourth derivative."""

Sizes = tuple[Array, Flags, Array, Array, Array, Array, float]
"""Sizes of an arm and its load: lengths of the fixed vectors before the joints (n,) [m], prismatic joints (n,), masses (n,)
[kg], distances of the centres of mass from the joints' origins (n,) [m], halves of the traces of the inertias (n,) [kg·m²],
viscous friction (n,) [N·m·s/rad, N·s/m], and the size of gravity [m/s²]."""


def sizes(robot: Robot, load: Load) -> Sizes:
    """Return the sizes of an arm and its load."""
    mass, com, tensor, _motor, gravity = load.bodies
    lengths = np.linalg.norm(robot.fixed[:, :3, 3], axis=1)
    half = 0.5 * np.trace(tensor, axis1=1, axis2=2)
    return (
        lengths, np.asarray(robot.prismatic), mass, np.linalg.norm(com, axis=1), half, load.viscous,
        float(np.linalg.norm(gravity)),
    )  # fmt: skip


@compiled
def fourth_bounds(arm: Sizes, D: Array, still: bool, work: Array, out: Array) -> None:
    """Compute bounds on |τ⁗| of every joint within an interval.

    Shapes and units: D (6, n) [rad/s^i, m/s^i], work (2, n + 1, 7) [1], out (n,) [N·m/s⁴, N/s⁴].
    """
    lengths, prismatic, mass, com, half, viscous, gravity = arm
    n = mass.shape[0]
    B, P = work[0], work[1]  # of links 0 to n: derivatives of unit vectors, and of the joints' origins
    S, motion = np.zeros(7), 0.0 if still else 1.0
    for k in range(7):
        B[0, k] = P[0, k] = 0.0
    B[0, 0] = 1.0
    for i in range(n):
        for k in range(7):
            P[i + 1, k] = P[i, k] + lengths[i] * B[i, k]
        if prismatic[i]:
            for k in range(7):
                B[i + 1, k] = B[i, k]
                for m in range(max(0, k - 5), k + 1):
                    P[i + 1, k] += BINOMIAL[k, m] * B[i, m] * D[k - m, i]
        else:
            for k in range(1, 6):
                S[k] += D[k, i]
            bell(S, B[i + 1])
        out[i] = motion * viscous[i] * D[5, i]
    A, V = np.empty(5), np.empty(5)
    for link in range(n):
        b, p = B[link + 1], P[link + 1]
        spin = 0.0
        for m in range(5):
            A[m] = motion * mass[link] * (p[m + 2] + com[link] * b[m + 2])
            spin += motion * BINOMIAL[4, m] * b[m] * b[6 - m]
        A[0] += mass[link] * gravity
        for i in range(link + 1):
            for m in range(5):
                V[m] = B[i, m] if prismatic[i] else p[m] - P[i + 1, m] + com[link] * b[m]
            total = 0.0 if prismatic[i] else half[link] * spin
            for m in range(5):
                total += BINOMIAL[4, m] * V[m] * A[4 - m]
            out[i] += total


@compiled
def cubic_range(a: float, b: float, c: float, d: float, h: float) -> tuple[float, float]:
    """Return the least and the greatest value on [0, h] of the cubic with given values and rates at both ends.

    Shapes and units: a, b [as the cubic], c, d [as the cubic, over s], h [s]. Returns [as the cubic].
    """
    low, high = min(a, b), max(a, b)
    one, two = a + h * c / 3.0, b - h * d / 3.0  # inner Bézier points: the cubic is within the hull of all four
    if low <= min(one, two) and max(one, two) <= high:
        return low, high
    p = h * c  # of x in [0, 1]: a + p x + q x² + r x³
    q, r = 3.0 * (b - a) - h * (2.0 * c + d), 2.0 * (a - b) + h * (c + d)
    root = q * q - 3.0 * p * r
    if root < 0.0:
        return low, high
    s = -(q + np.copysign(np.sqrt(root), q))
    for x in (s / (3.0 * r) if r != 0.0 else -1.0, p / s if s != 0.0 else -1.0):
        if 0.0 < x < 1.0:
            y = a + x * (p + x * (q + x * r))
            low, high = min(low, y), max(high, y)
    return low, high


@compiled
def slope_range(a: float, b: float, c: float, d: float, h: float) -> tuple[float, float]:
    """Return the least and the greatest rate on [0, h] of the cubic of `cubic_range`.

    Shapes and units: a, b [as the cubic], c, d [as the cubic, over s], h [s]. Returns [as the cubic, over s].
    """
    low, high = min(c, d), max(c, d)
    q, r = 3.0 * (b - a) / h - 2.0 * c - d, 2.0 * (a - b) / h + c + d  # of x in [0, 1]: c + 2 q x + 3 r x²
    if r != 0.0:
        x = -q / (3.0 * r)
        if 0.0 < x < 1.0:
            y = c + x * (2.0 * q + 3.0 * r * x)
            low, high = min(low, y), max(high, y)
    return low, high


@compiled
def direction(rates: Array, h: float) -> int:
    """Return the proved sign of a joint's velocity in an interval, from its Bernstein coefficients; 0 if it may change.

    Shapes and units: rates (5,) [rad/s^i, m/s^i], h [s].
    """
    factor, b = 1.0, np.zeros(5)
    for k in range(5):
        for j in range(k, 5):
            b[j] += BINOMIAL[j, k] / BINOMIAL[4, k] * rates[k] * factor
        factor *= h / (k + 1)
    least, most = b.min(), b.max()
    if least >= 0.0 and most > 0.0:
        return 1
    return -1 if most <= 0.0 and least < 0.0 else 0
