"""A smooth curve through or near points: a B-spline of degree 5 of the tool's point and its quaternion."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
import scipy
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.plain import read_numbers
from optik.arm.robot import Robot
from optik.check import real_array
from optik.errors import InvalidInput
from optik.ik import Tolerance
from optik.ik.base import ToleranceLike
from optik.tables import Names, read_table, warn_of_assumptions
from optik.types import Array
from planners.paths.base import PiecewisePath, fields
from planners.paths.control_curve import DEGREE, SPAN_SAMPLES, ControlCurve, read_breaks
from planners.paths.poses import HALF_TURN, divide_pieces, make_poses, rotation_derivative_norms, shortest_turn, skew
from planners.paths.waypoints import check_rotation, check_waypoints, read_waypoints
from planners.trajectory.curve import BINOMIAL, bells

SHORTEST, SAME = 1e-6, 1e-9
"""Least size of the points [m]; distance over that size, and angle [rad], within which a point repeats the one before."""
ARC_SAMPLES, SLOW_SAMPLES = 16, 2000
"""Samples of each span for the length of the curve, and where the tool point is slow."""
LEAST_WEIGHT, LEAST_BEND = 1e-7, 1e-3
"""Weight of h⁵ ∫ |p'''|² ds of spans of length h, beside 1 for a point, and of h³ ∫ |p''|² ds over it: they act in gaps."""
WEIGHTS, HALVINGS = (-26.0, 0.0), 12
"""Decades of the weight of ∫ |p'''|² ds, over the number of points and the length to the fifth, and halvings of them."""
ROUNDS, MOST_SPANS, REFINEMENTS = 40, 2, 2
"""Most rounds in which knots are added, most spans for each point, and changes of s to the length of the curve."""
ROUNDING = 1e-12
"""Relative rounding error of a sample."""
LEAST_SQUARE, FARTHEST = 1e-3, 1e9
"""Least square of the length of a quaternion of the spline, which would be 1, and farthest control point [m]."""
SLOWER, ROUGH = 0.5, 0.25
"""Least |dp/ds| of a smoothed curve over that before, and that from which s is made the length: loops would only grow."""
NATURAL = [(3, np.zeros(7)), (4, np.zeros(7))]
"""Derivatives at both ends of an interpolation: those of the curve with the least ∫ |p'''|² ds."""


class _Curve(NamedTuple):
    """A spline of position and quaternion with control points (C, 7), and the parameters of the points (k,)."""

    knots: ControlCurve
    coefficients: Array
    u: Array

    def at(self, s: Array) -> Array:
        """Return values and derivatives (4, k, 7)."""
        return np.moveaxis(self.knots.basis(s).combine(self.coefficients), 1, 0)

    def errors(self, values: Array) -> Array:
        """Return the distances and angles (k, 2) of the points from the places of their parameters."""
        there = self.at(self.u)[0]
        return np.stack([np.linalg.norm((values - there)[:, :3], axis=1), _angles(values, there)], axis=1)

    def project(self, values: Array) -> _Curve:
        """Return the curve with the parameters of nearer places, by a step of Newton's method."""
        p, v = self.at(self.u)[:2, :, :3]
        far = np.linalg.norm(values[:, :3] - p, axis=1)
        step = ((values[:, :3] - p) * v).sum(axis=1) / np.maximum((v * v).sum(axis=1), np.finfo(float).tiny)
        u = np.clip(self.u + np.clip(step, -far, far), 0.0, self.knots.end)
        near = np.linalg.norm(values[:, :3] - self.at(u)[0, :, :3], axis=1) < far
        return self._replace(u=np.where(near, u, self.u))

    def lengths(self) -> tuple[Array, Array, float]:
        """Return the length of the curve up to each point (k,) and each knot, and the least |dp/ds|."""
        s = divide_pieces(self.knots.breaks, np.full(self.knots.breaks.size - 1, ARC_SAMPLES))
        rate = np.linalg.norm(self.at(0.5 * (s[1:] + s[:-1]))[1, :, :3], axis=1)
        total = np.append(0.0, np.cumsum(rate * np.diff(s)))
        return np.interp(self.u, s, total), np.interp(self.knots.breaks, s, total), float(rate.min())


class _Fit:
    """The normal equations of a least-squares spline through points, exact at both ends."""

    def __init__(self, breaks: Array, u: Array, values: Array) -> None:
        self.knots, self.u, self.values = ControlCurve.between(breaks), u, values
        A = self._rows(u, 0)
        self.normal, self.right, self.third = A.T @ A, A.T @ values, self._roughness(3, 0)
        self.normal += LEAST_WEIGHT * (self._roughness(3, 5) + LEAST_BEND * self._roughness(2, 3))

    def solve(self, weight: float = 0.0) -> _Curve:
        """Return the spline with this weight of ∫ |p'''|² ds."""
        H, ends = (self.normal + weight * self.third).tocsc()[1:-1], self.values[[0, -1]]
        inner = scipy.sparse.linalg.spsolve(H[:, 1:-1], self.right[1:-1] - H[:, [0, -1]] @ ends)
        return _Curve(self.knots, np.concatenate([ends[:1], inner, ends[1:]]), self.u)

    def _rows(self, s: Array, order: int) -> Any:
        """Return the sparse matrix of a derivative of the basis functions at points."""
        first, values = self.knots.basis(s)
        columns, starts = first[:, None] + np.arange(DEGREE + 1), np.arange(s.size + 1) * (DEGREE + 1)
        return scipy.sparse.csr_array((values[:, order].ravel(), columns.ravel(), starts), (s.size, self.knots.count))

    def _roughness(self, order: int, power: int) -> Any:
        """Return the matrix of ∫ |f⁽ᵐ⁾|² hⁿ ds over spans of length h, by Gauss's rule; exact for m = 3."""
        (x, weights), h = np.polynomial.legendre.leggauss(3), np.diff(self.knots.breaks)[:, None]
        A = self._rows((self.knots.breaks[:-1, None] + 0.5 * h * (1.0 + x)).ravel(), order)
        return A.T @ (A * (0.5 * weights * h ** (1 + power)).reshape(-1, 1))


class Spline(PiecewisePath):
    """A curve with continuous fourth derivatives through points, or near them within a tolerance.

    Position and quaternion of the tool are a B-spline of degree 5; the quaternion is normalised. s is nearly the length of
    the curve. Both ends are exact. With a tolerance, a least-squares curve gets knots where points are farther from it. Each
    span is then halved, and ∫ |p'''|² ds gets the greatest weight that keeps all points within the tolerance: fewest knots
    alone follow the noise with several times the jerk. A tolerance of 0 gives the curve with the least ∫ |p'''|² ds through
    all points.

    Parameters
    ----------
    points : (k, 3) or (k, 4, 4) array
        Points of the tool, or T_base_tool [m]. The rotation from one to the next is the shortest one. Points that repeat the
        previous one are merged with it.
    orientation : (3, 3) array, optional
        Rotation of the tool at all points [1], for points without an orientation.
    tolerance : Tolerance, (2,) tuple of float, or 0
        Largest distance [m] and angle [rad] of the points from the curve; 0 for a curve through them.

    Attributes
    ----------
    deviation : (2,) list of float
        Bounds on the distance [m] and the angle [rad] of the points from the curve.

    Raises
    ------
    InvalidInput
        Fewer than two different points, no ``orientation`` although it is needed, a turn at one point or within 1e-6 rad of
        180°, a point at which the tool would stop, as in a reversal, or a tolerance that is not 0 and not above 0.
    """

    name: ClassVar[str] = "spline"
    notes: tuple[str, ...] = ()

    def __init__(
        self, points: ArrayLike, *, orientation: ArrayLike | None = None, tolerance: ToleranceLike | float = (1e-4, 1e-3)
    ) -> None:  # fmt: skip
        values, allowed = _check_points(points, orientation), _check_tolerance(tolerance)
        approximate = allowed.any() and len(values) > 2
        curve = (_approximate(values, allowed) if approximate else None) or _interpolate(values, allowed)
        if not np.ptp(values[:, 3:], axis=0).any():
            curve.coefficients[:, 3:] = values[0, 3:]  # the bounds would count rounding errors as a turn
        self.deviation: list[float] = curve.errors(values).max(axis=0).tolist()
        self._curve = curve
        self._check()

    @classmethod
    def from_csv(
        cls, file: str | os.PathLike[str], *, orientation: ArrayLike | None = None,
        tolerance: ToleranceLike | float = (1e-4, 1e-3), robot: Robot | None = None, unit: str | None = None,
        columns: Names = None, ignore: Names = None,
    ) -> Self:  # fmt: skip
        """Return the curve near the waypoints of a table.

        Parameters
        ----------
        file : str or path
            The table, as for `Polyline.from_csv`.
        orientation : (3, 3) array, optional
            As of `Polyline.from_csv` [1].
        tolerance : Tolerance, (2,) tuple of float, or 0
            As of `Spline`.
        robot, unit, columns, ignore
            As of `Polyline.from_csv`.

        Returns
        -------
        Spline
            Near all rows.

        Raises
        ------
        InvalidInput
            As for `Spline` and `Polyline.from_csv`; the error names line and column.
        """
        table = read_table(file, columns, ignore)
        poses = read_waypoints(table, orientation, robot, unit)
        try:
            path = cls(poses, tolerance=tolerance)
        except InvalidInput as error:
            named = re.sub(r"^points\[(\d+)\]", lambda i: table.locate(int(i[1])), error.argument)
            raise InvalidInput(named, error.got, error.expected, advice=error.advice) from None
        path.notes = warn_of_assumptions(file, table.notes)
        return path

    @property
    def end(self) -> float:
        """Nearly the length of the curve [m]."""
        return self._curve.knots.end

    @property
    def breaks(self) -> Array:
        """Knots of the spline."""
        return self._curve.knots.breaks

    def _evaluate(self, x: Array, order: int) -> Array:
        z = self._curve.at(x)
        p, q = z[order, :, :3], z[:, :, 3:]
        N, W = _turn(q)
        if order:
            return np.concatenate([p, _divide(W[:order], N)[-1]], axis=1)
        S = skew(q[0, :, 1:])
        return make_poses(np.eye(3) + 2.0 / N[0][:, None] * (q[0, :, :1, None] * S + S @ S), p)

    def piece_bounds(self) -> Array:
        """Return bounds (pieces, 2, 4) on the derivatives of position and rotation."""
        return self._bounds[0].copy()

    @cached_property
    def _bounds(self) -> tuple[Array, Array]:
        """Bounds (pieces, 2, 4) on derivatives, and lower bounds (pieces, 2) on |dp/ds| and on the quaternion's square."""
        # The control points bound the fourth derivative. A lower one is at most its largest sample, plus half the distance of
        # the samples times the bound above it. N and W are those of `_turn`, with N⁽⁴⁾ and W''' by the product rule.
        spans = self.breaks.size - 1
        half = 0.5 * np.diff(self.breaks) / SPAN_SAMPLES
        u = np.arange(SPAN_SAMPLES + 1) / SPAN_SAMPLES
        z = self._curve.at((self.breaks[:-1, None] + np.diff(self.breaks)[:, None] * u).ravel())

        def below(samples: Sequence[Array], highest: Array) -> list[Array]:
            bounds = [(1.0 + ROUNDING) * highest]
            for each in reversed(samples):
                size = np.linalg.norm(each.reshape(spans, u.size, -1), axis=2).max(axis=1)
                bounds.insert(0, (1.0 + ROUNDING) * size + half * bounds[0])
            return bounds

        def derivatives(part: slice) -> list[Array]:
            size = np.linalg.norm(self._curve.knots.control_points(self._curve.coefficients[:, part], 4), axis=1)
            return below([*z[:, :, part]], np.maximum(size[:-1], size[1:]))

        p, a = derivatives(slice(0, 3)), derivatives(slice(3, 7))
        N, W = _turn(z[:, :, 3:])
        N[0] = np.maximum(N[0], LEAST_SQUARE)
        n = below(N[1:], 2.0 * (a[0] * a[4] + 4.0 * a[1] * a[3] + 3.0 * a[2] ** 2))
        w = below(W, 2.0 * (a[0] * a[4] + 2.0 * a[1] * a[3]))
        least = np.stack([np.linalg.norm(z[1, :, :3], axis=1), N[0][:, 0]]).reshape(2, spans, -1).min(axis=2)
        least = (1.0 - ROUNDING) * least - half * np.stack([p[2], n[0]])
        with np.errstate(all="ignore"):  # where the quaternion may vanish: such a path is refused
            turning, omega = np.stack(_divide(w, [least[1], *(-each for each in n)])), _divide(W, N)
            turning = np.minimum(turning, below(omega, turning[3]))
            bell = np.empty((spans, 5))
            bells(np.stack([np.zeros(spans), *turning], axis=1), bell)
            rotation = np.minimum(bell[:, 1:].T, below([*rotation_derivative_norms(*omega).T], bell[:, 4]))
        return np.stack([np.stack(p[1:]), rotation]).transpose(2, 0, 1), least.T

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files."""
        return {
            "path": self.name, "knots": self.breaks.tolist(), "coefficients": self._curve.coefficients.tolist(),
            "deviation": self.deviation,
        }  # fmt: skip

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """Return the curve that `to_dict` wrote."""
        breaks, coefficients, deviation = fields(data, cls.name, "knots", "coefficients", "deviation")
        path, knots = object.__new__(cls), ControlCurve.between(read_breaks(breaks))
        path._curve = _Curve(knots, read_numbers(coefficients, (knots.count, 7), "coefficients"), np.empty(0))
        path.deviation = read_numbers(deviation, (2,), "deviation").tolist()
        for name, values in (("coefficients", path._curve.coefficients), ("deviation", np.array(path.deviation))):
            if not np.abs(values).max() < FARTHEST:
                raise InvalidInput(name, "NaN, infinity or too large a number", f"numbers below {FARTHEST:g}")
        path._check()
        return path

    def _check(self) -> None:
        """Raise InvalidInput unless the tool point is proved to move everywhere, and the quaternion not to vanish."""
        bounds, least = self._bounds
        for piece, turns in np.argwhere(~(least > (0.0, LEAST_SQUARE))):
            s = np.linspace(self.breaks[piece], self.breaks[piece + 1], SLOW_SAMPLES + 1)
            rate = np.linalg.norm(self._curve.at(s)[1, :, :3], axis=1)
            if not turns and rate.min() > (s[1] - s[0]) * bounds[piece, 0, 1]:
                continue
            i = int(np.abs(self._curve.u - s[rate.argmin()]).argmin()) if self._curve.u.size else None
            got = "turns too large for a smooth curve" if turns else "a tool point that nearly stops"
            raise InvalidInput(
                "coefficients" if i is None else f"points[{i}]", got, "a path without reversals and large turns",
                advice="a larger tolerance= for noisy points; add points to a turn; end the path where it reverses",
            )  # fmt: skip


def _turn(q: Array) -> tuple[list[Array], list[Array]]:
    """Return N = |Q|² and its three derivatives, and W = 2 vec(Q' Q*) and its two, of Q and three derivatives (4, k, 4).

    The angular velocity is ω = W / N. Q' Q'* and Q'' Q''* have no vector part.
    """

    def dot(i: int, j: int) -> Array:
        return np.asarray(2.0 * (q[i] * q[j]).sum(axis=1)[:, None])

    def cross(i: int, j: int) -> Array:
        a, b = q[i], q[j]
        return np.asarray(2.0 * (b[:, :1] * a[:, 1:] - a[:, :1] * b[:, 1:] - np.cross(a[:, 1:], b[:, 1:])))

    N = [0.5 * dot(0, 0), dot(0, 1), dot(0, 2) + dot(1, 1), dot(0, 3) + 3.0 * dot(1, 2)]
    return N, [cross(1, 0), cross(2, 0), cross(3, 0) + cross(2, 1)]


def _divide(W: Sequence[Array], N: Sequence[Array]) -> list[Array]:
    """Return W / N and its derivatives by Leibniz's rule."""
    found: list[Array] = []
    for k, value in enumerate(W):
        found.append((value - sum(BINOMIAL[k, j] * N[j] * found[k - j] for j in range(1, k + 1))) / N[0])
    return found


def _check_points(points: ArrayLike, orientation: ArrayLike | None) -> Array:
    """Return positions and quaternions (k, 7), each with the sign that is nearer to the one before."""
    given = real_array(points, "points", "points (k, 3) or poses (k, 4, 4)")
    if given.ndim == 2 and given.shape[1] == 3:
        given = make_poses(check_rotation(orientation), given)
    elif given.ndim != 3:
        raise InvalidInput("points", f"shape {given.shape}", "points (k, 3) or poses (k, 4, 4)")
    elif orientation is not None:
        raise InvalidInput("orientation", "a rotation", "None, because the poses have their own")
    poses = check_waypoints(given, "points")
    p, q = poses[:, :3, 3], np.array([se3.quaternion(T[:3, :3]) for T in poses])
    if not _size(p) > SHORTEST:
        expected = f"more than {SHORTEST:g} m; a Line or a Polyline turns the tool at a point"
        raise InvalidInput("points", f"a size of {_size(p):.3g} m", expected)
    cosine = (q[1:] * q[:-1]).sum(axis=1)
    for i in np.flatnonzero(np.abs(cosine) < HALF_TURN):  # the cosine of half the angle
        shortest_turn(poses[i], poses[i + 1], f"points[{i + 1}]")
    q[1:] *= np.cumprod(np.where(cosine < 0.0, -1.0, 1.0))[:, None]
    return np.concatenate([p, q], axis=1)


def _check_tolerance(tolerance: ToleranceLike | float) -> Array:
    """Return the largest distance and angle (2,), both 0 for a curve through the points."""
    if not isinstance(tolerance, int | float):
        return np.array([*Tolerance.of(tolerance)])
    if tolerance != 0:
        expected = "(metres, radians) above 0, or 0 for a curve through the points"
        raise InvalidInput("tolerance", repr(tolerance), expected)
    return np.zeros(2)


def _angles(a: Array, b: Array) -> Array:
    """Return the angles between rows of position and quaternion (k, 7)."""
    unit = b[:, 3:] / np.linalg.norm(b[:, 3:], axis=1)[:, None]
    return np.asarray(4.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(a[:, 3:] - unit, axis=1), 1.0)))


def _size(p: Array) -> float:
    """Return the diagonal of the box around points."""
    return float(np.linalg.norm(np.ptp(p, axis=0)))


def _measure_chords(p: Array, apart: float) -> tuple[Array, list[int]]:
    """Return the length of chords up to each point (k,), over points that are so far apart, and these."""
    kept = [0]
    for i in range(1, len(p)):
        if np.linalg.norm(p[i] - p[kept[-1]]) > apart:
            kept.append(i)
    if kept[-1] != len(p) - 1:  # the end is exact
        while len(kept) > 1 and np.linalg.norm(p[-1] - p[kept[-1]]) <= SAME * _size(p):
            kept.pop()
        kept.append(len(p) - 1)
    chords = np.diff(p[kept], axis=0)
    length = np.linalg.norm(chords, axis=1)
    on = np.clip(np.searchsorted(kept, np.arange(len(p)), side="right") - 1, 0, len(length) - 1)
    along = ((p - p[kept][on]) * chords[on]).sum(axis=1) / length[on]
    return np.append(0.0, np.cumsum(length))[on] + np.clip(along, 0.0, length[on]), kept


def _approximate(values: Array, tolerance: Array) -> _Curve | None:
    """Return a smooth curve within the tolerance of all points; None if knots do not bring it there."""
    # chords between nearer points would count noise as length, and waiting as moving
    u, _ = _measure_chords(values[:, :3], min(2.0 * tolerance[0], 0.25 * _size(values[:, :3])))
    breaks, left = np.array([0.0, u[-1]]), REFINEMENTS
    for _ in range(ROUNDS):
        curve = _Fit(breaks, u, values).solve().project(values)
        far = (curve.errors(values) > tolerance).any(axis=1)
        if far.any():
            span = np.unique(np.searchsorted(breaks[1:-1], curve.u[far], side="right"))
            breaks = np.sort(np.append(breaks, 0.5 * (breaks[span] + breaks[span + 1])))
            if breaks.size > MOST_SPANS * len(values):
                break
        elif left and (found := curve.lengths())[2] > ROUGH:
            u, breaks, left = *found[:2], left - 1
        else:
            return _smooth(curve, values, tolerance)
    return None


def _smooth(curve: _Curve, values: Array, tolerance: Array) -> _Curve:
    """Return the curve with halved spans and the greatest weight of ∫ |p'''|² ds within the tolerance."""
    breaks, slowest = curve.knots.breaks, SLOWER * curve.lengths()[2]
    fit = _Fit(np.sort(np.append(breaks, 0.5 * (breaks[:-1] + breaks[1:]))), curve.u, values)
    low, high = WEIGHTS
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        new = fit.solve(len(values) * breaks[-1] ** 5 * 10.0**middle).project(values)
        if (new.errors(values) <= tolerance).all() and new.lengths()[2] >= slowest:
            low, curve = middle, new
        else:
            high = middle
    return curve


def _interpolate(values: Array, tolerance: Array) -> _Curve:
    """Return the curve with the least ∫ |p'''|² ds through points, of which those that repeat the one before are merged."""
    u, kept = _measure_chords(values[:, :3], SAME * _size(values[:, :3]))
    through = values[kept]
    merged = through[np.searchsorted(0.5 * (u[kept][1:] + u[kept][:-1]), u)]
    for row in np.flatnonzero(_angles(values, merged) > max(SAME, tolerance[1]))[:1]:
        expected = "a point that moves while the tool turns"
        raise InvalidInput(f"points[{row}]", "a turn of the tool at one point", expected)
    for left in reversed(range(REFINEMENTS)):
        at = u[kept]
        knots = ControlCurve.between(at)
        if len(kept) == 2:
            inner = through[0] + knots.greville[1:-1, None] / knots.end * (through[1] - through[0])
        else:  # parameters about 1 apart, so that all equations are of one size
            scaled, ends = at * ((len(at) - 1) / at[-1]), (NATURAL, NATURAL)
            inner = scipy.interpolate.make_interp_spline(scaled, through, k=DEGREE, bc_type=ends).c[1:-1]
        curve = _Curve(knots, np.concatenate([through[:1], inner, through[-1:]]), u)
        u, _, rate = curve.lengths()
        if rate < ROUGH or not left:
            break
    return curve


METHOD = Spline
