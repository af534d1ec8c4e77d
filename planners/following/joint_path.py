"""JointPath: quintics q(s) between nodes with exact derivatives and bounded deviation; nodes for marching."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik import kinematics, se3
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.ik import Tolerance
from optik.types import Array, Flags, Indices
from planners.following import march
from planners.paths.base import Path
from planners.trajectory.curve import Curve, PiecewiseCurve, quintic_through

LEAST_SPACING = 2e-4
"""Least spacing of spline nodes [m or rad]: rounding of 1e-16 in q becomes 60e-16 / (2e-4)³ = 1e-3 in the third derivative."""
SMALL_DEVIATION = 1e-6
"""A proved deviation [m, rad] below this is not bounded more closely: controllers achieve 1e-5 at best."""
PROOF_PARTS = 16
"""Parts in which a piece with a larger deviation is proved: the remainder of fourth order is 16⁴ = 65,536 times as small."""


class IKRecord(NamedTuple):
    """Results of the IK method at samples s (k,) before polishing: errors [m, rad] and iterations."""

    position_error: Array
    rotation_error: Array
    iterations: Indices
    s: Array = np.empty(0)


class JointPath(PiecewiseCurve):
    """Configurations q(s) along a path: quintic Hermite between polished samples with exact q', q''.

    Attributes
    ----------
    robot : Robot
        The arm.
    path : Path
        The Cartesian path; s has its unit.
    knots : (k,) array
        Samples in s, the path's breaks, and inserted values between them [m, or rad].
    nodes : (m,) array
        The knots that the spline passes through: of samples only those at least `LEAST_SPACING` from each other, so that
        rounding in q does not show in q'''.
    q : (k, n) array
        Configurations at the knots [rad, m].
    derivatives : (k, 3, n) array
        Exact q', q'', q''' there. At a singular configuration, those of the interpolation between neighbouring knots.
    ik : IKRecord
        Results of the IK method at the samples, before polishing.
    """

    parameter = "s"

    def __repr__(self) -> str:
        return f"JointPath({self.end:.4g} {self.path.unit}, {self.robot.n} joints, {len(self.nodes)} nodes)"

    def __init__(
        self, robot: Robot, path: Path, knots: Array, q: Array, derivatives: Array, ik: IKRecord,
        nodes: Flags | None = None,
    ) -> None:  # fmt: skip
        self.robot, self.path, self.knots, self.q, self.derivatives, self.ik = robot, path, knots, q, derivatives, ik
        self._chosen: Any = thin_knots(knots) if nodes is None else np.flatnonzero(nodes)
        self.nodes = knots[self._chosen]
        self._set_polynomial(
            quintic_through(self.nodes, q[self._chosen], *np.swapaxes(derivatives[self._chosen, :2], 0, 1))
        )

    @property
    def end(self) -> float:
        """Last s [m, or rad]: the end of the path, or of the part that could be followed."""
        return float(self.knots[-1])

    @property
    def polynomial(self) -> Any:
        """The piecewise polynomial of q between the nodes, a `scipy.interpolate.PPoly` in s."""
        return self._polynomial

    @property
    def coefficients(self) -> Array:
        """Coefficients (6, m − 1, n) of q between the nodes, highest power first, in s from each piece's first node on."""
        view: Array = self._c.view()
        view.setflags(write=False)
        return view

    @property
    def at_nodes(self) -> Array:
        """Configurations and their first three derivatives (m, 4, n) at the nodes [rad, m]."""
        return np.asarray(np.concatenate([self.q[:, None], self.derivatives], axis=1)[self._chosen])

    @cached_property
    def singular_values(self) -> Array:
        """Smallest singular value (k,) of the Jacobian at the knots."""
        return smallest_singular_values(self.robot, self.q)

    @cached_property
    def deviation(self) -> tuple[float, float]:
        """Largest distance [m] and angle [rad] to the path at the same s, on seven points between any two nodes.

        The angle is NaN where the path asks less than the pose.
        """
        s = (self.nodes[:-1, None] + np.diff(self.nodes)[:, None] * (np.arange(1, 8) / 8.0)).ravel()
        e = se3.error(self.robot.fk(self(s)), self.path.pose(s))
        angle = float(np.linalg.norm(e[:, 3:], axis=1).max()) if self.path.asked == "pose" else np.nan
        return float(np.linalg.norm(e[:, :3], axis=1).max()), angle

    @cached_property
    def bound(self) -> tuple[float, float]:
        """Proved bound, apart from rounding, on distance [m] and angle [rad] to the path at the same s, everywhere.

        The angle is NaN where the path asks less than the pose.
        """
        i = self._chosen
        out = deviation_bounds(self.robot, self.path, self.nodes, self.q[i], self.derivatives[i])
        return float(out[:, 0].max()), float(out[:, 1].max()) if self.path.asked == "pose" else np.nan


def cut_joints(joints: JointPath, path: Path, begin: float) -> JointPath:
    """Return the part of a joint path from `begin` on, as the joint path of `path`."""
    s, record, until = joints.knots, joints.ik, begin + path.end
    ends = np.array([begin, until])
    inner, own, at = (s > begin) & (s < until), (record.s >= begin) & (record.s <= until), np.searchsorted(s, ends)
    given = np.concatenate([joints.q[:, None], joints.derivatives], axis=1)
    between = np.stack([joints(ends, order) for order in range(4)], axis=1)
    first, last = np.where((s[at] == ends)[:, None, None], given[at], between)
    values, knots = np.stack([first, *given[inner], last]), np.concatenate([[0.0], s[inner] - begin, [path.end]])
    ik = IKRecord(record.position_error[own], record.rotation_error[own], record.iterations[own], record.s[own] - begin)
    chosen = np.isin(np.arange(len(knots)), thin_knots(knots, joints.nodes - begin))
    return JointPath(joints.robot, path, knots, values[:, 0], values[:, 1:], ik, chosen)


def smallest_singular_values(robot: Robot, q: Array) -> Array:
    """Return the smallest singular values of the Jacobian, compiled: `Robot.singular_values` takes twice as long."""
    values = np.empty(len(q))
    kinematics.singular_values_batch(robot.chain, np.ascontiguousarray(q), values)
    return values


def thin_knots(knots: Array, keep: ArrayLike = ()) -> Indices:
    """Return the indices of knots that are at least `LEAST_SPACING` from each other."""
    if len(knots) < 2 or np.diff(knots).min() >= LEAST_SPACING:
        return np.arange(len(knots))
    kept = np.isin(knots, keep)
    kept[[0, -1]] = True
    fixed = knots[kept]
    chosen, last = [0], knots[0]
    for i in range(1, len(knots)):
        following = fixed[np.searchsorted(fixed, knots[i], side="right") :][:1]
        if kept[i] or (knots[i] - last >= LEAST_SPACING and not (following - knots[i] < LEAST_SPACING).any()):
            chosen.append(i)
            last = knots[i]
    return np.array(chosen)


def deviation_bounds(robot: Robot, path: Path, s: Array, q: Array, dq: Array, pieces: Array | None = None) -> Array:
    """Return proved bounds on distance and angle to the path of each quintic between nodes.

    A piece whose bound is larger than `SMALL_DEVIATION` is proved again in parts, whose remainder is smaller.
    """

    def bounds(s: Array, q: Array, dq: Array) -> Array:
        out = np.empty((len(s) - 1, 2))
        march.pieces_bound(
            robot.chain, s, q, dq, path.pose(s), path.twist(s), bound_fourth_derivatives(path, s, pieces), out
        )
        return out

    out = bounds(s, q, dq)
    far = np.flatnonzero(out.max(axis=1) > SMALL_DEVIATION)
    if far.size:
        at = s[far, None] + np.diff(s)[far, None] * (np.arange(PROOF_PARTS + 1) / PROOF_PARTS)
        at[:, -1] = s[far + 1]
        curve, flat = quintic_through(s, q, dq[:, 0], dq[:, 1]), at.ravel()
        parts = bounds(flat, curve(flat), np.stack([curve(flat, order) for order in (1, 2, 3)], axis=1))
        # Not from piece to piece.
        whole = np.append(parts, parts[-1:], axis=0).reshape(len(far), PROOF_PARTS + 1, 2)[:, :PROOF_PARTS]
        out[far] = np.minimum(out[far], whole.max(axis=1))
    return out


def bound_fourth_derivatives(path: Path, s: Array, pieces: Array | None = None) -> Array:
    """Return bounds on the fourth derivatives of position and rotation from each node to the next.

    Each is the largest bound of all pieces of the path in the interval: derivatives up to the third are continuous, so a
    remainder of fourth order holds across breaks.
    """
    breaks, fourth = path.breaks, np.asarray((path.piece_bounds() if pieces is None else pieces)[:, :, 3])
    first = np.clip(np.searchsorted(breaks, s, side="right") - 1, 0, len(fourth) - 1)
    last = np.clip(np.searchsorted(breaks, np.append(s[1:], s[-1:]), side="left") - 1, first, len(fourth) - 1)
    if (first == last).all():
        return np.ascontiguousarray(fourth[first])
    padded = np.concatenate([fourth, np.zeros((1, 2))])  # so that an interval can end behind the last piece
    return np.ascontiguousarray(np.maximum.reduceat(padded, np.stack([first, last + 1], axis=1).ravel())[::2])


BETWEEN_NODES = 4
"""Number of intervals between two nodes in which the nearest point is searched; in each the distance has one minimum."""
NEAR_INTERVALS = 8
"""Largest number of intervals that are searched if a path comes near a configuration more than once."""
EQUALLY_NEAR = 1e-6
"""Difference of distances [rad or m] below which two points of the path are equally near."""
PROJECTION_STEPS = 60
"""Number of search steps in an interval; enough for bisection alone."""


def find_nearest_s(joints: JointPath, q: ArrayLike, near: float) -> float:
    """Return the path parameter s nearest to a configuration (n,) [rad, m]; among equally near ones the closest to `near`."""
    q, part = np.asarray(q, dtype=np.float64), np.arange(BETWEEN_NODES) / BETWEEN_NODES
    grid = np.append((joints.nodes[:-1, None] + np.diff(joints.nodes)[:, None] * part).ravel(), joints.end)
    off = np.linalg.norm(joints(grid) - q, axis=1)
    lowest = np.flatnonzero((off <= np.append(off[1:], np.inf)) & (off <= np.append(np.inf, off[:-1])))
    chosen = lowest[np.argsort(off[lowest], kind="stable")][:NEAR_INTERVALS]
    minima = [find_nearest_between(joints, q, grid[max(i - 1, 0)], grid[min(i + 1, grid.size - 1)]) for i in chosen]
    distances = np.array([float(np.linalg.norm(joints(s) - q)) for s in minima])
    nearest = [s for s, d in zip(minima, distances, strict=True) if d <= distances.min() + EQUALLY_NEAR]
    return min(nearest, key=lambda s: abs(s - near))


def find_nearest_between(joints: Curve, q: Array, low: float, high: float) -> float:
    """Return s in [low, high] at which a curve is nearest to q, by Newton steps for q' · (q(s) − q) = 0, or by bisection."""
    s = 0.5 * (low + high)
    for _ in range(PROJECTION_STEPS):
        q1, off = joints(s, 1), joints(s) - q
        slope = float(q1 @ off)
        if slope > 0.0:
            high = s
        else:
            low = s
        size = float(q1 @ q1)
        after = s - slope / size if size > 0.0 else low - 1.0
        if not low <= after <= high:
            after = 0.5 * (low + high)
        if abs(after - s) <= 1e-15 * joints.end:
            return after
        s = after
    return s


FOURTH_FRACTION = 0.2
"""Fraction of the tolerance that the path's fourth derivative may use in a step; the bound of the joints is wider."""


MOST_INSERTED = 100_000
"""Most samples that are inserted beforehand where the path bends; more are inserted only where a step is rejected."""


Guide = Callable[[Array], tuple[Array, Array]]
"""Constraint on the motion of a redundant arm: rows (k, 4, d, n) and values (k, 4, d) at s (k,), for `derivatives_at`."""


class Nodes(NamedTuple):
    """A path at s (k,): poses, twists (k, 3, 6), rows and values of the guide, bounds (k, 2) on fourth derivatives."""

    s: Array
    poses: Array
    twists: Array
    rows: Array
    values: Array
    fourth: Array


class Course:
    """A path with its null-space guide, to be sampled for marching."""

    def __init__(self, path: Path, guide: Guide) -> None:
        self.path, self.guide = path, guide
        self.pieces = path.piece_bounds()

    def nodes(self, s: Array) -> Nodes:
        """Return the path and its guide at s (k,)."""
        twists = np.empty((s.size, 3, 6))
        for order in (1, 2, 3):
            twists[:, order - 1] = self.path.twist(s, order)
        return Nodes(s, self.path.pose(s), twists, *self.guide(s), bound_fourth_derivatives(self.path, s, self.pieces))

    def spread(self, s: Array, tolerance: Tolerance) -> Array:
        """Return the values of s to march through: those given, the path's breaks, and more where the path bends.

        The path's contribution to the deviation in a step is h⁴/384 · |d⁴/ds⁴|. Breaks and samples nearer than `LEAST_SPACING`,
        in whose third derivatives rounding would show, are left out unless this contribution needs a shorter step.
        """
        breaks, fourth = self.path.breaks, self.pieces[:, :, 3]
        with np.errstate(divide="ignore"):
            share = (FOURTH_FRACTION * np.array([tolerance.position, tolerance.rotation]) / fourth).min(axis=1)
        step = np.sqrt(np.sqrt(384.0 * share))  # longest in each piece
        if len(breaks) > 2:
            s = np.union1d(s, breaks[1:-1])
        gap = np.diff(s)
        # a gap begins in its piece; its middle may be rounded into the next, where breaks are one rounding apart
        step = step[np.clip(np.searchsorted(breaks, s[:-1], side="right") - 1, 0, len(step) - 1)]
        parts = np.maximum(np.ceil(gap / step), 1.0).astype(np.int64)
        if parts.max() > 1:
            if parts.sum() > MOST_INSERTED:
                parts = np.minimum(parts, 16)
            u = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
            s = np.append(np.repeat(s[:-1], parts) + np.repeat(gap / parts, parts) * u, s[-1])
            step = np.repeat(step, parts)
            gap = np.diff(s)
        if gap.min() >= LEAST_SPACING:
            return s
        kept = np.ones(len(s), np.bool_)
        thin_positions(s, step, np.isin(s, breaks), kept)
        return np.asarray(s[kept])


@compiled
def thin_positions(s: Array, step: Array, preferred: Flags, kept: Flags) -> None:
    """Leave out values of s nearer than `LEAST_SPACING` to the previous one, where the step may be that long.

    Of two near ones the preferred one is kept; both ends are always kept.

    Shapes and units: s (k,) [m, or rad], step (k - 1,) [m, or rad], preferred (k,), kept (k,).
    """
    last, longest = 0, step[0]
    for i in range(1, s.shape[0] - 1):
        least = min(longest, step[i])
        may = s[i + 1] - s[last] <= least
        near = s[i] - s[last] < LEAST_SPACING
        yields = s[i + 1] - s[i] < LEAST_SPACING and not preferred[i] and (preferred[i + 1] or i + 2 == s.shape[0])
        kept[i] = not (may and (near or yields))
        if kept[i]:
            last, longest = i, step[i]
        else:
            longest = least


def slice_nodes(nodes: Nodes, first: int, last: int | None = None) -> Nodes:
    """Return a range of nodes, without copying them."""
    return Nodes(*(x[first:last] for x in nodes))


def make_empty_guide(n: int) -> Guide:
    """Return the guide of an arm without null-space motion."""
    return lambda s: (np.empty((s.size, 4, 0, n)), np.empty((s.size, 4, 0)))
