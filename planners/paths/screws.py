"""Poses that move along screws fixed in them, with their twists and the derivatives of these; compiled.

Inside, twists are spatial vectors (ω, v) about the base's origin; a vector that is fixed in a body with velocity V changes by
V × it.
"""

from __future__ import annotations

from math import cos, sin

import numpy as np

from optik.compiled import compiled, inlined
from optik.types import Array

CHOOSE = np.array([[1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [1.0, 2.0, 1.0, 0.0], [1.0, 3.0, 3.0, 1.0]])
"""Binomial coefficients of Leibniz's rule, up to the third derivative."""


@inlined
def cross(a: Array, b: Array, factor: float, out: Array) -> None:
    """Add factor · a × b of motion vectors to out (6,)."""
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        out[x] += factor * (a[y] * b[z] - a[z] * b[y])
        out[3 + x] += factor * (a[y] * b[3 + z] - a[z] * b[3 + y] + a[3 + y] * b[z] - a[3 + z] * b[y])


@inlined
def to_spatial(p: Array, twist: Array, V: Array) -> None:
    """Write twists (3, 6), (v, ω) of a point at p and their derivatives, as spatial vectors V (3, 6)."""
    for order in range(3):
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            V[order, x] = twist[order, 3 + x]
            v = twist[order, x] - (twist[order, 3 + y] * p[z] - twist[order, 3 + z] * p[y])
            for m in range(order):  # derivatives of p are those of v
                w, u, c = twist[m], twist[order - 1 - m], CHOOSE[order, m]
                v -= c * (w[3 + y] * u[z] - w[3 + z] * u[y])
            V[order, 3 + x] = v


@inlined
def from_spatial(V: Array, p: Array, twist: Array, turns: bool) -> None:
    """Write spatial vectors V (3, 6) as twists (3, 6), (v, ω) of the point at p; v stays exactly where the point only turns."""
    for order in range(3):
        for x in range(3):
            twist[order, 3 + x] = V[order, x]
        if turns:
            continue
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            v = V[order, 3 + x] + V[order, y] * p[z] - V[order, z] * p[y]
            for m in range(order):
                u, c = twist[order - 1 - m], CHOOSE[order, m]
                v += c * (V[m, y] * u[z] - V[m, z] * u[y])
            twist[order, x] = v


@compiled
def _advance(T: Array, screw: Array, f: float) -> None:
    """Multiply a pose by exp(f · screw), in place; screw (6,) is (v, ω) with |ω| 1 or 0."""
    v, w = screw[:3], screw[3:]
    turns = w[0] * w[0] + w[1] * w[1] + w[2] * w[2] > 0.0
    s, c = (sin(f), 1.0 - cos(f)) if turns else (0.0, 0.0)
    rest = f - s if turns else 0.0
    wv = w[0] * v[0] + w[1] * v[1] + w[2] * v[2]
    E, t, R = np.empty((3, 3)), np.empty(3), T[:3, :3].copy()
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        for b in range(3):
            E[x, b] = c * w[x] * w[b] + (1.0 - c if x == b else 0.0)
        turn = w[y] * v[z] - w[z] * v[y]
        t[x] = (s if turns else f) * v[x] + c * turn + rest * wv * w[x]
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        E[y, x] += s * w[z]
        E[x, y] -= s * w[z]
    for x in range(3):
        for b in range(3):
            T[x, b] = R[x, 0] * E[0, b] + R[x, 1] * E[1, b] + R[x, 2] * E[2, b]
        T[x, 3] += R[x, 0] * t[0] + R[x, 1] * t[1] + R[x, 2] * t[2]


@compiled
def move_along(screws: Array, f: Array, poses: Array, twists: Array, fields: Array) -> None:
    """Move poses (k, 4, 4) and twists (k, 3, 6), in place, along screws (D, 6) by f (k, 4, D) with its derivatives.

    fields (k, D, 4, 6) are the tool's spatial twists by a unit of each coordinate, and their derivatives along the path.
    """
    V, turns = np.empty((3, 6)), True
    for d in range(screws.shape[0]):
        turns = turns and screws[d, 0] == 0.0 and screws[d, 1] == 0.0 and screws[d, 2] == 0.0
    for k in range(poses.shape[0]):
        T = poses[k]
        to_spatial(T[:3, 3], twists[k], V)
        for d in range(screws.shape[0]):
            E = fields[k, d]
            E[:] = 0.0
            for x in range(3):
                for b in range(3):
                    E[0, x] += T[x, b] * screws[d, 3 + b]
                    E[0, 3 + x] += T[x, b] * screws[d, b]
            for x in range(3):
                y, z = (x + 1) % 3, (x + 2) % 3
                E[0, 3 + x] += T[y, 3] * E[0, z] - T[z, 3] * E[0, y]
            for order in range(1, 4):
                for m in range(order):
                    cross(V[order - 1 - m], E[m], CHOOSE[order - 1, m], E[order])
            for order in range(3):
                for m in range(order + 1):
                    for x in range(6):
                        V[order, x] += CHOOSE[order, m] * E[m, x] * f[k, order + 1 - m, d]
            _advance(T, screws[d], f[k, 0, d])
        from_spatial(V, T[:3, 3], twists[k], turns)
