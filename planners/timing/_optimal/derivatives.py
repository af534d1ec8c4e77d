"""Derivatives of a joint path at many points, and distances of a motion from it between them; compiled."""

from __future__ import annotations

import numpy as np

from optik.compiled import compiled
from optik.types import Array
from planners.following.follow import JointPath


def derivatives(joint_path: JointPath, s: Array) -> Array:
    """Return q, q', q'' and q''' at increasing path parameters, clamped to the path; at a node the right-hand values."""
    out = np.empty((4, s.size, joint_path.robot.n))
    _derivatives(joint_path.nodes, joint_path.coefficients, np.ascontiguousarray(s), out)
    return out


def distances(joint_path: JointPath, s: Array, state: Array, tau: Array, ends: Array) -> Array:
    """Return the largest distances of the joints from q(s) in intervals, at quarters of their durations.

    The joints follow quintics in time through q, q̇ and q̈ at the grid points, from `ends` (3, K + 1, n) with q, q' and q'', and
    from ṡ and s̈ (K + 1, 2); s(t) is the quintic through the same states.
    """
    out = np.empty(tau.size)
    _distances(joint_path.nodes, joint_path.coefficients, s, state, tau, ends, out)
    return out


@compiled
def _piece(x: Array, s: float, k: int) -> int:
    """Return the piece that contains s, from piece k on."""
    while k < x.shape[0] - 2 and s >= x[k + 1]:
        k += 1
    return k


@compiled
def _derivatives(x: Array, c: Array, s: Array, out: Array) -> None:
    k, n = 0, c.shape[2]
    for i in range(s.shape[0]):
        at = min(max(s[i], x[0]), x[-1])
        k = _piece(x, at, k)
        u = at - x[k]
        for j in range(n):
            c0, c1, c2, c3, c4 = c[0, k, j], c[1, k, j], c[2, k, j], c[3, k, j], c[4, k, j]
            out[0, i, j] = c[5, k, j] + u * (c4 + u * (c3 + u * (c2 + u * (c1 + u * c0))))
            out[1, i, j] = c4 + u * (2.0 * c3 + u * (3.0 * c2 + u * (4.0 * c1 + u * 5.0 * c0)))
            out[2, i, j] = 2.0 * c3 + u * (6.0 * c2 + u * (12.0 * c1 + u * 20.0 * c0))
            out[3, i, j] = 6.0 * c2 + u * (24.0 * c1 + u * 60.0 * c0)


@compiled
def _between(h: float, move: float, v0: float, a0: float, v1: float, a1: float, u: float) -> float:
    """Return the displacement of the quintic in time at a fraction u of its duration h."""
    P, V, A = move - h * (v0 + 0.5 * h * a0), h * (v1 - v0 - h * a0), h * h * (a1 - a0)
    c3, c4, c5 = 10.0 * P - 4.0 * V + 0.5 * A, -15.0 * P + 7.0 * V - A, 6.0 * P - 3.0 * V + 0.5 * A
    return u * h * (v0 + 0.5 * u * h * a0) + u**3 * (c3 + u * (c4 + u * c5))


@compiled
def _distances(x: Array, c: Array, s: Array, state: Array, tau: Array, ends: Array, out: Array) -> None:
    k = 0
    for i in range(tau.shape[0]):
        h, v, a, w, b = tau[i], state[i, 0], state[i, 1], state[i + 1, 0], state[i + 1, 1]
        out[i] = 0.0
        k = _piece(x, s[i], k)
        for part in range(1, 4):
            place = min(max(s[i] + _between(h, s[i + 1] - s[i], v, a, w, b, 0.25 * part), x[0]), x[-1])
            p = _piece(x, place, 0 if place < x[k] else k)
            d = place - x[p]
            for j in range(c.shape[2]):
                q0, q1, r0, r1 = ends[0, i, j], ends[0, i + 1, j], ends[1, i, j], ends[1, i + 1, j]
                a0, a1 = r0 * a + ends[2, i, j] * v * v, r1 * b + ends[2, i + 1, j] * w * w
                q = q0 + _between(h, q1 - q0, r0 * v, a0, r1 * w, a1, 0.25 * part)
                on = c[5, p, j] + d * (
                    c[4, p, j] + d * (c[3, p, j] + d * (c[2, p, j] + d * (c[1, p, j] + d * c[0, p, j])))
                )
                out[i] = max(out[i], abs(q - on))
