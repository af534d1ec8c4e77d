"""Torque and its rate along a joint path as rows over the derivatives of s(t): plain and slow."""

from __future__ import annotations

from typing import Any

import numpy as np

from optik.dynamics import torques_batch
from optik.types import Array
from planners.curve import composed, monomials
from planners.limits._points import PathPoints


def torque_rows(at: PathPoints, load: Any) -> Array:
    """Coefficients of the torque, without Coulomb friction.

    Parameters
    ----------
    at : PathPoints
        Points of the joint path.
    load : Load
        The masses of the arm.

    Returns
    -------
    (k, n, 4) array
        Over s̈, ṡ², ṡ and 1 [N·m, N] over the monomials.
    """
    return _fitted(at, load, 2)


def torque_rate_rows(at: PathPoints, load: Any) -> Array:
    """Coefficients of the torque's rate, without Coulomb friction.

    Parameters
    ----------
    at : PathPoints
        Points of the joint path.
    load : Load
        The masses of the arm.

    Returns
    -------
    (k, n, 6) array
        Over s⃛, ṡ s̈, ṡ³, ṡ, s̈ and ṡ² [N·m/s, N/s] over the monomials.
    """
    return _fitted(at, load, 3)


def _fitted(at: PathPoints, load: Any, order: int) -> Array:
    """Through as many rates as there are monomials: the torques there, solved for the coefficients."""
    rates = np.array([[1.0, 0, 0], [2, 0, 0], [0.5, 0, 0], [1, 1, 0], [2, -1, 0], [1, 0, 1], [0, 0, 0]])
    rates = rates[:6] if order == 3 else rates[[0, 1, 3, 6]]
    q, *d = (at.q(i) for i in range(4))
    found = []
    for row in rates:
        states = np.ascontiguousarray(np.stack([q, *composed(d, [np.full((1, 1), x) for x in row])], axis=1))
        out = np.empty((len(q), 2, q.shape[1]))
        torques_batch(at.joint_path.robot.chain, load.bodies, load.viscous, states, out)
        found.append(out[:, order - 2])
    products = np.stack(monomials(tuple(rates.T[:order]), full=True), axis=1)
    return np.asarray(np.einsum("ij,jkn->kni", np.linalg.inv(products), np.stack(found)))
