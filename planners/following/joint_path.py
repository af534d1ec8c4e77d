"""JointPath: configurations along a path, quintic between nodes with exact derivatives, and how far the tool is off."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optik import kinematics, se3
from optik.arm.robot import Robot
from optik.types import Array
from planners.curve import Curve
from planners.following import march
from planners.hermite import through
from planners.paths.base import Path

Ints = NDArray[np.int64]

APART = 2e-4
"""Least distance of equal samples that are spline nodes [m or rad]: 1e-16 of rounding in q becomes 60e-16 / APART³ = 1e-3
in the third derivative."""


CLOSE = 1e-6
"""A proved deviation [m, rad] below this is not looked at more closely: controllers keep 1e-5 at best."""

PARTS = 16
"""In which other pieces are proved: the remainder is 65,536 times as small there."""


class IKRecord(NamedTuple):
    """What the IK method itself did at each sample (k,), before the polish: errors [m, rad], iterations, and where."""

    position_error: Array
    rotation_error: Array
    iterations: Ints
    s: Array = np.empty(0)


class JointPath(Curve):
    """Configurations q(s) along a path: quintic Hermite between polished samples with exact q', q''.

    Attributes
    ----------
    robot : Robot
        The arm.
    path : Path
        What it follows; s has its unit.
    knots : (k,) array
        The samples in s, the path's breaks, and what had to be added between them.
    nodes : (m,) array
        The knots that the spline passes through: of samples only those at least `APART` from each other, so that
        rounding in q does not show in q'''.
    q : (k, n) array
        Configurations at the knots.
    derivatives : (k, 3, n) array
        Exact q', q'', q''' there, but where the arm is singular, those of the motion between the knots around; at a break of
        the path, where q''' jumps, one of its two values.
    ik : IKRecord
        What the method left before the polish, at the samples.
    """

    parameter = "s"

    def __init__(
        self, robot: Robot, path: Path, knots: Array, q: Array, derivatives: Array, ik: IKRecord,
        nodes: NDArray[np.bool_] | None = None,
    ) -> None:  # fmt: skip
        self.robot, self.path, self.knots, self.q, self.derivatives, self.ik = robot, path, knots, q, derivatives, ik
        self._chosen: Any = apart(knots) if nodes is None else np.flatnonzero(nodes)
        self.nodes = knots[self._chosen]
        self._orders = [through(self.nodes, q[self._chosen], *np.swapaxes(derivatives[self._chosen, :2], 0, 1))]

    @property
    def end(self) -> float:
        """Last s: the path's own end, or where the good part of it ends."""
        return float(self.knots[-1])

    @property
    def coefficients(self) -> Array:
        """Coefficients (6, m − 1, n) of q between the nodes, highest power first, in s from each piece's first node on."""
        view: Array = self._orders[0].c.view()
        view.setflags(write=False)
        return view

    def _evaluate(self, x: Array, order: int) -> Array:
        while len(self._orders) <= order:
            self._orders.append(self._orders[-1].derivative())
        values: Array = self._orders[order](x)
        return values

    @cached_property
    def singular_values(self) -> Array:
        """Smallest singular value (k,) of the Jacobian at the knots."""
        values, robot = np.empty(len(self.knots)), self.robot
        kinematics.singular_values_batch(robot.chain, self.q, values)
        return values

    @cached_property
    def deviation(self) -> tuple[float, float]:
        """Worst distance [m] and angle [rad] to the path at the same s, on seven points between any two nodes."""
        s = (self.nodes[:-1, None] + np.diff(self.nodes)[:, None] * (np.arange(1, 8) / 8.0)).ravel()
        e = se3.error(self.robot.fk(self(s)), self.path.pose(s))
        return float(np.linalg.norm(e[:, :3], axis=1).max()), float(np.linalg.norm(e[:, 3:], axis=1).max())

    @cached_property
    def bound(self) -> tuple[float, float]:
        """Proved bound on distance [m] and angle [rad] to the path at the same s, everywhere, but for rounding."""
        i = self._chosen
        out = deviation_bounds(self.robot, self.path, self.nodes, self.q[i], self.derivatives[i])
        return float(out[:, 0].max()), float(out[:, 1].max())


def apart(knots: Array, keep: ArrayLike = ()) -> Ints:
    """Indices of knots that stand `APART`; both ends and those to keep always."""
    if len(knots) < 2 or np.diff(knots).min() >= APART:
        return np.arange(len(knots))
    kept = np.isin(knots, keep)
    kept[[0, -1]] = True
    fixed = knots[kept]
    chosen, last = [0], knots[0]
    for i in range(1, len(knots)):
        following = fixed[np.searchsorted(fixed, knots[i], side="right") :][:1]
        if kept[i] or (knots[i] - last >= APART and not (following - knots[i] < APART).any()):
            chosen.append(i)
            last = knots[i]
    return np.array(chosen)


def deviation_bounds(robot: Robot, path: Path, s: Array, q: Array, dq: Array, pieces: Array | None = None) -> Array:
    """Proved bounds (k − 1, 2) on distance and angle to the path of the quintics between nodes s (k,), everywhere.

    A piece that does not look close enough is proved in parts, by what it is off between them and less of a remainder.
    """

    def bounds(s: Array, q: Array, dq: Array) -> Array:
        out = np.empty((len(s) - 1, 2))
        march.pieces_bound(
            robot.chain,
            s,
            q,
            dq,
            path.pose(s),
            path.twist(s),
            fourth_bounds(path, s, pieces),
            out,
        )
        return out

    out = bounds(s, q, dq)
    far = np.flatnonzero(out.max(axis=1) > CLOSE)
    if far.size:
        at = s[far, None] + np.diff(s)[far, None] * (np.arange(PARTS + 1) / PARTS)
        at[:, -1] = s[far + 1]
        curve, flat = through(s, q, dq[:, 0], dq[:, 1]), at.ravel()
        parts = bounds(flat, curve(flat), np.stack([curve(flat, order) for order in (1, 2, 3)], axis=1))
        whole = np.append(parts, parts[-1:], axis=0).reshape(len(far), PARTS + 1, 2)[
            :, :PARTS
        ]  # not from piece to piece
        out[far] = np.minimum(out[far], whole.max(axis=1))
    return out


def fourth_bounds(path: Path, s: Array, pieces: Array | None = None) -> Array:
    """Bounds (k, 2) on the fourth derivatives of position and rotation from each of the nodes s (k,) to the next.

    The largest of all pieces of the path that the interval touches: derivatives up to the third have no jumps, so a
    remainder of fourth order holds across breaks. ``pieces`` are the path's `piece_bounds`, where they are at hand.
    """
    breaks, fourth = path.breaks, np.asarray((path.piece_bounds() if pieces is None else pieces)[:, :, 3])
    first = np.clip(np.searchsorted(breaks, s, side="right") - 1, 0, len(fourth) - 1)
    last = np.clip(np.searchsorted(breaks, np.append(s[1:], s[-1:]), side="left") - 1, first, len(fourth) - 1)
    if (first == last).all():
        return np.ascontiguousarray(fourth[first])
    padded = np.concatenate([fourth, np.zeros((1, 2))])  # so that an interval may end behind the last piece
    return np.ascontiguousarray(np.maximum.reduceat(padded, np.stack([first, last + 1], axis=1).ravel())[::2])
