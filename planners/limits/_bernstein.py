"""Proofs that polynomials on the pieces of a motion stay above a value, by their Bernstein coefficients."""

from __future__ import annotations

from functools import lru_cache
from math import comb, perm

import numpy as np

from optik.types import Array
from planners.trajectory import Trajectory

SPLITS, MOST_PARTS = 40, 200_000
"""Largest numbers of halvings of a piece, and of parts that are left at one time."""
ROUNDING = 1e-13
"""Rounding of a polynomial's value, as a fraction of its largest coefficient."""


@lru_cache
def _to_bernstein(degree: int) -> Array:
    return np.array(
        [[comb(j, i) / comb(degree, i) if i <= j else 0.0 for i in range(degree + 1)] for j in range(degree + 1)]
    )


@lru_cache
def _halves(degree: int) -> tuple[Array, Array]:
    left = np.array([[comb(j, i) / 2.0**j if i <= j else 0.0 for i in range(degree + 1)] for j in range(degree + 1)])
    return left, left[::-1, ::-1].copy()


def on_pieces(trajectory: Trajectory, order: int) -> Array:
    """Return the coefficients (6 − order, m, n), lowest power first, of a derivative in the fraction of each piece."""
    h, c = np.diff(trajectory.knots)[:, None], trajectory.padded[::-1]
    return np.array([perm(p, order) * c[p] * h ** (p - order) for p in range(order, 6)])


def multiply(a: Array, b: Array) -> Array:
    """Return the coefficients of products of polynomials."""
    out = np.zeros((a.shape[0] + b.shape[0] - 1, *a.shape[1:]))
    for i, x in enumerate(a):
        out[i : i + b.shape[0]] += x * b
    return out


def proves_above(c: Array, least: float, where: Array | None = None) -> bool:
    """Return whether polynomials (d + 1, m) are proved to be at least `least`, wherever the polynomials `where` are above 0."""
    slack = ROUNDING * np.abs(c).max(initial=0.0)
    b = _to_bernstein(c.shape[0] - 1) @ c - (least - slack)
    w = None if where is None else _to_bernstein(where.shape[0] - 1) @ where
    for _ in range(SPLITS):
        open_ = b.min(axis=0) < 0.0
        if w is not None:
            open_ &= w.max(axis=0) > 0.0
        if not open_.any():
            return True
        b = b[:, open_]
        ends = np.minimum(b[0], b[-1]) < 0.0
        if w is not None:
            w = w[:, open_]
            ends = ((b[0] < 0.0) & (w[0] > 0.0)) | ((b[-1] < 0.0) & (w[-1] > 0.0))
        if ends.any() or 2 * b.shape[1] > MOST_PARTS:
            return False
        b = np.concatenate([half @ b for half in _halves(b.shape[0] - 1)], axis=1)
        if w is not None:
            w = np.concatenate([half @ w for half in _halves(w.shape[0] - 1)], axis=1)
    return False
