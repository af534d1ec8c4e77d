"""Derivatives of the torques along a joint path in the path: spatial vectors about the base's origin; compiled.

Joint j at q_j + η(s) displaces the links from j on by the field E = η S_j, with S_j the joint's screw. A vector X that is fixed
in one of them changes by E × X, the momentum H of the links from m on by E ×* H + I E', with their inertia I; and variation
and derivative along the path commute. So every coefficient of `optik.dynamics.path_torques` is linear in E and its derivatives.

Motion vectors are (ω, v), force vectors (moment, force).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.compiled import compiled, inlined
from optik.dynamics import Bodies
from optik.kinematics import Chain, axis_of, frames
from optik.types import Array
from planners.paths.screws import CHOOSE, cross


class Bundle(NamedTuple):
    """Links and composites of an arm on a path, each with its derivatives along it.

    S (n, 4, 6) screws of the joints, V (n, 3, 6) velocities of the links; of the links from i on: mass (n,), first moment C
    (n, 3, 3) and inertia J (n, 3, 3, 3) about the origin, and momentum H (n, 3, 6).
    """

    S: Array
    V: Array
    mass: Array
    C: Array
    J: Array
    H: Array


@inlined
def _cross_force(a: Array, f: Array, factor: float, out: Array) -> None:
    """Add factor · a ×* f of a motion and a force vector to out (6,)."""
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        out[x] += factor * (a[y] * f[z] - a[z] * f[y] + a[3 + y] * f[3 + z] - a[3 + z] * f[3 + y])
        out[3 + x] += factor * (a[y] * f[3 + z] - a[z] * f[3 + y])


@inlined
def _inertia(mass: float, C: Array, J: Array, a: Array, factor: float, out: Array) -> None:
    """Add factor · I a, of the inertia with these parts or their derivatives, to out (6,)."""
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        turn = J[x, 0] * a[0] + J[x, 1] * a[1] + J[x, 2] * a[2]
        out[x] += factor * (turn + C[y] * a[3 + z] - C[z] * a[3 + y])
        out[3 + x] += factor * (mass * a[3 + x] - C[y] * a[z] + C[z] * a[y])


@inlined
def _dot(a: Array, b: Array) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5])


@compiled
def move(chain: Chain, path: Array, at: int, T: Array, S: Array, V: Array) -> None:
    """Write the screws of the axes and the velocities of the links, with their derivatives, at one point of a path."""
    prismatic = chain[1]
    n = S.shape[0]
    frames(chain, path[0, at], T)
    S[:], V[:] = 0.0, 0.0
    for i in range(n):
        j, factor = axis_of(chain, i)
        if prismatic[i]:
            for x in range(3):
                S[i, 0, 3 + x] = T[i, x, 2]
        else:
            for x in range(3):
                y, z = (x + 1) % 3, (x + 2) % 3
                S[i, 0, x] = T[i, x, 2]
                S[i, 0, 3 + x] = T[i, y, 3] * T[i, z, 2] - T[i, z, 3] * T[i, y, 2]
        for order in range(4):
            for m in range(order):  # S' = V × S, and its derivatives
                cross(V[i, order - 1 - m], S[i, m], CHOOSE[order - 1, m], S[i, order])
            if order < 3:
                for x in range(6):
                    V[i, order, x] = V[i - 1, order, x] if i > 0 else 0.0
                    for m in range(order + 1):
                        V[i, order, x] += CHOOSE[order, m] * S[i, m, x] * (factor * path[order + 1 - m, at, j])


@compiled
def _compose(bodies: Bodies, T: Array, bundle: Bundle) -> None:
    """Write mass, first moment, inertia and momentum of the links from each joint on, with their derivatives."""
    mass, com, tensor, _motor, _gravity = bodies
    _S, V, total, C, J, H = bundle
    n = mass.shape[0]
    p, D = np.empty((3, 3)), np.empty((3, 3, 3))
    C[:], J[:], H[:] = 0.0, 0.0, 0.0
    for i in range(n - 1, -1, -1):
        R, w = T[i, :3, :3], V[i]
        for x in range(3):
            for c in range(3):
                D[0, x, c] = 0.0
                for a in range(3):
                    for b in range(3):
                        D[0, x, c] += R[x, a] * tensor[i, a, b] * R[c, b]
        for x in range(3):
            p[0, x] = T[i, x, 3] + R[x, 0] * com[i, 0] + R[x, 1] * com[i, 1] + R[x, 2] * com[i, 2]
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            p[1, x] = w[0, 3 + x] + w[0, y] * p[0, z] - w[0, z] * p[0, y]
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            p[2, x] = w[1, 3 + x] + w[1, y] * p[0, z] - w[1, z] * p[0, y] + w[0, y] * p[1, z] - w[0, z] * p[1, y]
        for order in range(1, 3):  # I' = ω × I + (ω × I)ᵀ of the inertia about the centre of mass
            D[order] = 0.0
            for m in range(order):
                u = w[order - 1 - m]
                for c in range(3):
                    for x in range(3):
                        y, z = (x + 1) % 3, (x + 2) % 3
                        turned = CHOOSE[order - 1, m] * (u[y] * D[m, z, c] - u[z] * D[m, y, c])
                        D[order, x, c] += turned
                        D[order, c, x] += turned
        total[i] = mass[i] + (total[i + 1] if i < n - 1 else 0.0)
        for order in range(3):
            for m in range(order + 1):  # of the point mass at p
                weight = CHOOSE[order, m] * mass[i]
                square = p[m, 0] * p[order - m, 0] + p[m, 1] * p[order - m, 1] + p[m, 2] * p[order - m, 2]
                for x in range(3):
                    D[order, x, x] += weight * square
                    for c in range(3):
                        D[order, x, c] -= weight * p[m, x] * p[order - m, c]
            for x in range(3):
                C[i, order, x] = mass[i] * p[order, x] + (C[i + 1, order, x] if i < n - 1 else 0.0)
                for c in range(3):
                    J[i, order, x, c] = D[order, x, c] + (J[i + 1, order, x, c] if i < n - 1 else 0.0)
            if i < n - 1:
                for x in range(6):
                    H[i, order, x] = H[i + 1, order, x]
            for m in range(order + 1):  # H = I V; only the inertia itself has a mass
                _inertia(mass[i] if m == 0 else 0.0, mass[i] * p[m], D[m], w[order - m], CHOOSE[order, m], H[i, order])


@inlined
def _weight(C: Array, gravity: Array, mass: float, out: Array) -> None:
    """Write the wrench of gravity on masses with this first moment, or its derivative, into out (6,)."""
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        out[x] = C[y] * gravity[z] - C[z] * gravity[y]
        out[3 + x] = mass * gravity[x]


@inlined
def _lift(screw: Array, C: Array, mass: float, gravity: Array, factor: float, out: Array) -> None:
    """Add the vector u to out (6,) for which u · E is the change of screw · (wrench of gravity) by a displacement E."""
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        out[3 + x] += factor * mass * (gravity[y] * screw[z] - gravity[z] * screw[y])
        a, b = gravity[x] * screw[y] - gravity[y] * screw[x], gravity[z] * screw[x] - gravity[x] * screw[z]
        out[x] += factor * (C[y] * a - C[z] * b)


@compiled
def _upper(bundle: Bundle, gravity: Array, j: int, out: Array) -> None:
    """Write the changes of torques of the joints up to j with joint j: the links that move are those from j on.

    Shapes and units: out (6, n, n, 4) [as torque over powers of s].
    """
    S, _V, mass, C, J, H = bundle
    A, B, E = np.zeros((3, 6)), np.zeros((2, 6)), np.zeros((4, 6))
    for jet in range(4):
        A[:], B[:], E[:] = 0.0, 0.0, 0.0
        for k in range(jet, 4):
            for x in range(6):
                E[k, x] = CHOOSE[k, jet] * S[j, k - jet, x]
        for order in range(3):
            for m in range(order + 1):
                c = CHOOSE[order, m]
                _cross_force(E[m], H[j, order - m], c, A[order])
                _inertia(mass[j] if m == 0 else 0.0, C[j, m], J[j, m], E[1 + order - m], c, A[order])
        for order in range(2):
            for m in range(order + 1):  # u × g with the change u = ω × C + M v of the first moment
                e = E[order - m]
                u0 = e[1] * C[j, m, 2] - e[2] * C[j, m, 1] + (mass[j] * e[3] if m == 0 else 0.0)
                u1 = e[2] * C[j, m, 0] - e[0] * C[j, m, 2] + (mass[j] * e[4] if m == 0 else 0.0)
                u2 = e[0] * C[j, m, 1] - e[1] * C[j, m, 0] + (mass[j] * e[5] if m == 0 else 0.0)
                B[order, 0] += u1 * gravity[2] - u2 * gravity[1]
                B[order, 1] += u2 * gravity[0] - u0 * gravity[2]
                B[order, 2] += u0 * gravity[1] - u1 * gravity[0]
        for i in range(j + 1):
            c = _dot(S[i, 0], A[1])
            out[0, i, j, jet] = _dot(S[i, 0], A[0])
            out[1, i, j, jet] = c
            out[2, i, j, jet] = -_dot(S[i, 0], B[0])
            out[3, i, j, jet] = _dot(S[i, 1], A[0]) + 3.0 * c
            out[4, i, j, jet] = _dot(S[i, 1], A[1]) + _dot(S[i, 0], A[2])
            out[5, i, j, jet] = -_dot(S[i, 1], B[0]) - _dot(S[i, 0], B[1])


@compiled
def _lower(bundle: Bundle, gravity: Array, i: int, u: Array, out: Array) -> None:
    """Write the changes of the torque of joint i with the joints before it: the links from i on move with them as one body.

    Each coefficient is Σ u_k · E⁽ᵏ⁾. Shapes and units: u (6, 4, 6) [workspace], out (6, n, n, 4) [as torque over powers of s].
    """
    S, _V, mass, C, J, H = bundle
    u[:] = 0.0
    W, dW = np.empty(6), np.empty(6)
    _weight(C[i, 0], gravity, mass[i], W)
    _weight(C[i, 1], gravity, 0.0, dW)
    s, s1 = S[i, 0], S[i, 1]
    _inertia(mass[i], C[i, 0], J[i, 0], s, 1.0, u[0, 1])  # p = (I S) · E'
    _inertia(0.0, C[i, 1], J[i, 1], s, 1.0, u[1, 1])  # c = (I' S − S ×* H) · E' + (I S) · E''
    _cross_force(s, H[i, 0], -1.0, u[1, 1])
    u[1, 2] = u[0, 1]
    _cross_force(s, W, -1.0, u[2, 0])
    _lift(s, C[i, 0], mass[i], gravity, -1.0, u[2, 0])
    _cross_force(s, H[i, 0], 1.0, u[3, 1])  # d = (S ×* H + I S') · E' + 3 c
    _inertia(mass[i], C[i, 0], J[i, 0], s1, 1.0, u[3, 1])
    u[3] += 3.0 * u[1]
    _inertia(0.0, C[i, 2], J[i, 2], s, 1.0, u[4, 1])  # c' by the product rule
    _inertia(0.0, C[i, 1], J[i, 1], s1, 1.0, u[4, 1])
    _cross_force(s1, H[i, 0], -1.0, u[4, 1])
    _cross_force(s, H[i, 1], -1.0, u[4, 1])
    u[4, 2] = u[1, 1]
    _inertia(0.0, C[i, 1], J[i, 1], s, 1.0, u[4, 2])
    _inertia(mass[i], C[i, 0], J[i, 0], s1, 1.0, u[4, 2])
    u[4, 3] = u[0, 1]
    _cross_force(s1, W, -1.0, u[5, 0])
    _cross_force(s, dW, -1.0, u[5, 0])
    _lift(s, C[i, 1], 0.0, gravity, -1.0, u[5, 0])
    _lift(s1, C[i, 0], mass[i], gravity, -1.0, u[5, 0])
    u[5, 1] = u[2, 0]
    for j in range(i):
        for what in range(6):
            for jet in range(4):
                value = 0.0
                for k in range(jet, 4):
                    value += CHOOSE[k, jet] * _dot(u[what, k], S[j, k - jet])
                out[what, i, j, jet] = value


@compiled
def torque_changes(chain: Chain, bodies: Bodies, path: Array, out: Array) -> None:
    """Write the derivatives of the coefficients of `optik.dynamics.path_torques` in q, q', q'' and q'''.

    Shapes and units: path (4, k, n) [as q over powers of s], out (k, 6, n, n, 4) [as torque over powers of s]: coefficient,
    torque, joint and order of the joint's derivative.
    """
    _mass, _com, _tensor, motor, gravity = bodies
    k, n = path.shape[1], path.shape[2]
    T, u = np.empty((n, 4, 4)), np.empty((6, 4, 6))
    S, V, mass = np.empty((n, 4, 6)), np.empty((n, 3, 6)), np.empty(n)
    bundle = Bundle(S, V, mass, np.empty((n, 3, 3)), np.empty((n, 3, 3, 3)), np.empty((n, 3, 6)))
    for at in range(k):
        move(chain, path, at, T, S, V)
        _compose(bodies, T, bundle)
        for i in range(n):
            _upper(bundle, gravity, i, out[at])
            _lower(bundle, gravity, i, u, out[at])
            out[at, 0, i, i, 1] += motor[i]
            out[at, 1, i, i, 2] += motor[i]
            out[at, 3, i, i, 2] += 3.0 * motor[i]
            out[at, 4, i, i, 3] += motor[i]
