"""Via points as limits on the coefficients of a joint path, at the grid points before them."""

from __future__ import annotations

import numpy as np

from optik import se3
from optik.arm.robot import Robot
from optik.types import Array, Indices
from planners.choice.programme import ChoicePlace, Statics
from planners.paths.control_curve import DEGREE, PASSED
from planners.paths.point_to_point import PointToPoint, Via
from planners.paths.poses import skew_vector

EXACT_WITHIN = 1e-6
"""Half width of the limits on each joint at a via configuration that is passed exactly [rad, m]; the residual is removed."""
VIA_FRACTION = 0.999
"""Fraction of a via point's tolerance that its path may use; the error of the motion uses the remaining part."""
PASSING_STEPS = 10
"""Most Newton steps onto the via points."""


class ViaLimits(Statics):
    """Limits at via points: √(1 + 3 x²) − 1 with x = distance / tolerance and angle / tolerance; if exact, each joint.

    Each via point stands at the grid point before it, whose window has all coefficients of its span.
    """

    def __init__(self, robot: Robot, path: PointToPoint, s: Array) -> None:
        self._robot, self._vias, self._size = robot, path.vias, s.size
        self._moves = robot.limits.lower < robot.limits.upper  # a locked joint's control points are given
        at = np.array([via.s for via in path.vias])
        self._rows = np.clip(np.searchsorted(s, at, side="right") - 1, 0, s.size - 2)
        self._basis = path.spline.basis(at)
        self.bends = 6 if any(via.tolerance is not None for via in path.vias) else 0
        self.count = max((2 if via.tolerance is not None else robot.n for via in path.vias), default=0)

    def values(self, place: ChoicePlace) -> Array:
        """Return the values (K + 1, count); 0 where there is no limit."""
        out, q = np.zeros((self._size, self.count)), self._basis.combine(place.p)[:, 0]
        for via, row, x in zip(self._vias, self._rows, q, strict=True):
            found = self._limit(via, x)[0]
            out[row, : found.size] = found
        return out

    def write(self, place: ChoicePlace, joints: Array, y: Array, columns: Array, bends: Array, begin: Indices) -> None:
        """Write the derivatives (K + 1, count, W) in the control points, and the factors of curvature (K + 1, 6, W)."""
        p = place.p
        columns[:], bends[:], n, q = 0.0, 0.0, p.shape[1], self._basis.combine(p)[:, 0]
        for i, (via, row, x) in enumerate(zip(self._vias, self._rows, q, strict=True)):
            _value, slope, bend = self._limit(via, x)
            for b in range(DEGREE + 1):
                point = int(self._basis.first[i]) + b
                if not 0 < point < len(p) - 1:  # start and goal are given
                    continue
                at, weight = point * n - int(begin[row]), self._basis.values[i, 0, b]
                columns[row, : len(slope), at : at + n] = weight * slope * self._moves
                for part, factor in enumerate(bend):
                    force = np.sqrt(max(float(y[row, part]), 0.0))
                    bends[row, 3 * part : 3 * part + 3, at : at + n] = force * weight * factor * self._moves

    def _limit(self, via: Via, q: Array) -> tuple[Array, Array, tuple[Array, ...]]:
        """Return the values of a via point, their derivatives in q (k, n), and factors (3, n) of their curvature."""
        if via.tolerance is None:
            return (q - via.q) / EXACT_WITHIN, np.eye(q.size) / EXACT_WITHIN, ()
        pose, J, inside = self._robot.fk(q), self._robot.jacobian(q), via.tolerance.scale(VIA_FRACTION)
        M = pose[:3, :3] @ via.pose[:3, :3].T
        parts = (
            (pose[:3, 3] - via.pose[:3, 3], inside.position, J[:3]),
            (0.5 * skew_vector(M[None])[0], np.sqrt(2.0 * (1.0 - np.cos(min(inside.rotation, np.pi)))), J[3:]),
        )
        squares = np.array([parts[0][0] @ parts[0][0] / parts[0][1] ** 2, (3.0 - np.trace(M)) / parts[1][1] ** 2])
        root, slopes, bends = np.sqrt(1.0 + 3.0 * squares), [], []
        for (off, most, rows), r, square in zip(parts, root, squares, strict=True):
            u = off / most  # the Hessian is 3/r Jᵀ (I − 3 u uᵀ / r²) J over the square of the tolerance
            slopes.append(3.0 / (most * r) * u @ rows)
            b = (1.0 - 1.0 / r) / square if square > 0.0 else 1.5
            bends.append(np.sqrt(3.0 / r) / most * (rows - b * np.outer(u, u @ rows)))
        return root - 1.0, np.stack(slopes), tuple(bends)


def pass_through(path: PointToPoint, p: Array) -> Array:
    """Return control points whose path passes all via points, by the least change of the inner ones."""
    limits, out = path.robot.limits, p.copy()
    out[1:-1] = limits.clip(out[1:-1])
    if not path.vias:
        return out
    at = np.array([via.s for via in path.vias])
    basis = path.spline.basis(at)
    for step in range(PASSING_STEPS):
        q = basis.combine(out)[:, 0]
        wanted = np.stack([_nearest_inside(path.robot, via, x) for via, x in zip(path.vias, q, strict=True)])
        if step == PASSING_STEPS - 1:  # a pose that is not reached inside the limits: by its first configuration
            wanted = np.where(np.abs(wanted - q).max(axis=1)[:, None] > PASSED, [via.q for via in path.vias], q)
        if np.abs(wanted - q).max() <= PASSED:
            break
        out = path.spline.move_inside(at, limits.clip(wanted), out, limits.lower, limits.upper)
    return out


def _nearest_inside(robot: Robot, via: Via, q: Array) -> Array:
    """Return a configuration near q that meets a via point, by one Newton step where it is missed."""
    if via.tolerance is None:
        return via.q
    e, inside = se3.error(robot.fk(q)[None], via.pose[None])[0], via.tolerance.scale(VIA_FRACTION)
    distance, angle = float(np.linalg.norm(e[:3])), float(np.linalg.norm(e[3:]))
    if distance <= inside.position and angle <= inside.rotation:
        return q
    e[:3] *= max(0.0, 1.0 - VIA_FRACTION * inside.position / distance) if distance > 0.0 else 0.0
    e[3:] *= max(0.0, 1.0 - VIA_FRACTION * inside.rotation / angle) if angle > 0.0 else 0.0
    return np.asarray(q + np.linalg.pinv(robot.jacobian(q)) @ e)
