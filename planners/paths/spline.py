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
from planners.paths.base import Path, fields
from planners.paths.control_curve import DEGREE, ControlCurve
from planners.paths.poses import HALF_TURN, make_poses, rotation_derivative_norms, shortest_turn, skew
from planners.paths.waypoints import check_rotation, check_waypoints, read_waypoints
from planners.trajectory.curve import BINOMIAL, bells

SHORTEST, SAME_POINT, SAME_TURN = 1e-6, 1e-9, 1e-9
"""Least size of the points [m], the distance over it below which two are the same, and the angle [rad] of the same rotation."""
SPAN_SAMPLES, ARC_SAMPLES, FINE_SAMPLES = 12, 16, 2000
"""Samples of each span for the bounds on derivatives, for the length of the curve, and where the tool point is slow."""
LEAST_SMOOTHING, LEAST_BEND = 1e-7, 1e-3
"""Weight of the third derivative of a fit, beside 1 for each point, and that of the second beside it: they decide in gaps."""
SMOOTHINGS, HALVINGS = (-26.0, 0.0), 12
"""Decades of the smoothing, over the number of points times the fifth power of the length, and halvings of their range."""
ROUNDS, REFINEMENTS, SPANS_PER_POINT, NARROWEST = 60, 2, 4, 1e-9
"""Most rounds in which knots are added, changes of s to the length of the curve, most spans, and least width of one over s."""
ROUNDING = 1e-12
"""Relative rounding error of a sample."""
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
        """Return values and derivatives (k, 4, 7)."""
        return self.knots.basis(s).combine(self.coefficients)

    def errors(self, values: Array) -> Array:
        """Return the distances and angles (k, 2) of the points from the places of their parameters."""
        there = self.at(self.u)[:, 0]
        return np.stack([np.linalg.norm((values - there)[:, :3], axis=1), _angles(values, there)], axis=1)

    def project(self, values: Array) -> _Curve:
        """Return the curve with the parameters of nearer places, by a step of Newton's method."""
        p, v = np.moveaxis(self.at(self.u)[:, :2, :3], 1, 0)
        rest = values[:, :3] - p
        far = np.linalg.norm(rest, axis=1)
        step = (rest * v).sum(axis=1) / np.maximum((v * v).sum(axis=1), np.finfo(float).tiny)
        u = np.clip(self.u + np.clip(step, -far, far), 0.0, self.knots.end)
        near = np.linalg.norm(values[:, :3] - self.at(u)[:, 0, :3], axis=1) < far
        near[[0, -1]] = False
        return self._replace(u=np.where(near, u, self.u))

    def lengths(self) -> tuple[Array, Array, float]:
        """Return the length of the curve up to each point (k,) and each knot, and the least |dp/ds|."""
        breaks, n = self.knots.breaks, ARC_SAMPLES
        width = np.repeat(np.diff(breaks) / n, n)
        start = np.repeat(breaks[:-1], n) + width * np.tile(np.arange(n), breaks.size - 1)
        rate = np.linalg.norm(self.at(start + 0.5 * width)[:, 1, :3], axis=1)
        start, total = np.append(start, breaks[-1]), np.append(0.0, np.cumsum(rate * width))
        return np.interp(self.u, start, total), np.interp(breaks, start, total), float(rate.min())


class _Fit:
    """The normal equations of a least-squares spline through points, exact at both ends; banded."""

    def __init__(self, breaks: Array, u: Array, values: Array) -> None:
        self.knots, self.u, self.values = ControlCurve(float(breaks[-1]), 0, breaks[1:-1]), u, values
        A = self._rows(u, 0)
        least = LEAST_SMOOTHING * (self._roughness(3, 5) + LEAST_BEND * self._roughness(2, 3))
        self.parts = [self._split(A.T @ A + least), self._split(self._roughness(3, 0))]
        self.right = (A.T @ values)[1:-1]

    def solve(self, smoothing: float = 0.0) -> _Curve:
        """Return the spline with this weight of ∫ |p'''|² ds."""
        (band, ends), (more, others) = self.parts
        right = self.right - ends - smoothing * others
        inner = scipy.linalg.solveh_banded(band + smoothing * more, right, lower=True, check_finite=False)
        return _Curve(self.knots, np.concatenate([self.values[:1], inner, self.values[-1:]]), self.u)

    def _rows(self, s: Array, order: int) -> Any:
        first, values = self.knots.basis(s)
        columns = first[:, None] + np.arange(DEGREE + 1)
        size, shape = values[:, order], (s.size, self.knots.count)
        return scipy.sparse.csr_array((size.ravel(), columns.ravel(), np.arange(0, size.size + 1, DEGREE + 1)), shape)

    def _roughness(self, order: int, power: int) -> Any:
        """Return the matrix of ∫ |f⁽ᵐ⁾|² hⁿ ds over spans of width h; by Gauss's rule, exact for the third derivative."""
        x, weights = np.polynomial.legendre.leggauss(3)
        h = np.diff(self.knots.breaks)[:, None]
        A = self._rows((self.knots.breaks[:-1, None] + 0.5 * h * (1.0 + x)).ravel(), order)
        return A.T @ (A * (0.5 * weights * h ** (1 + power)).reshape(-1, 1))

    def _split(self, H: Any) -> tuple[Array, Array]:
        """Return the lower band of a matrix without its ends, and what its ends times the ends of the curve give."""
        H, ends = H.tocsr()[1:-1, 1:-1], H.tocsr()[1:-1][:, [0, -1]] @ self.values[[0, -1]]
        return np.stack(
            [np.pad(H.diagonal(-d), (0, min(d, H.shape[0]))) for d in range(min(DEGREE + 1, H.shape[0]))]
        ), ends


class Spline(Path):
    """A curve with continuous fourth derivatives through points, or near them within a tolerance.

    Position and quaternion of the tool are a B-spline of degree 5; the quaternion is normalised. s is nearly the length of
    the curve. Both ends are exact. With a tolerance, a least-squares curve gets knots where points are farther from it. Each
    span is then halved, and ∫ |p'''|² ds gets the greatest weight that keeps all points within the tolerance: this lowers
    the jerk by a factor of 5 to 30. A tolerance of 0 gives the curve with the least ∫ |p'''|² ds through all points.

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
    deviation : (2,) tuple of float
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
        self,
        points: ArrayLike,
        *,
        orientation: ArrayLike | None = None,
        tolerance: ToleranceLike | float = (1e-4, 1e-3),
    ) -> None:
        values = _check_points(points, orientation)
        allowed = _check_tolerance(tolerance)
        curve = (_approximate(values, allowed) if allowed.any() and len(values) > 2 else None) or _interpolate(
            values, allowed
        )
        if not np.ptp(values[:, 3:], axis=0).any():
            curve.coefficients[:, 3:] = values[0, 3:]  # the bounds would count rounding errors as a turn
        self._knots, self._coefficients = curve.knots, curve.coefficients
        self._check(curve.u)
        position, rotation = curve.errors(values).max(axis=0).tolist()
        self.deviation = (position, rotation)

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
        orientation, robot, unit, columns, ignore
            As of `Polyline.from_csv`.
        tolerance : Tolerance, (2,) tuple of float, or 0
            As of `Spline`.

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
        return self._knots.end

    @property
    def breaks(self) -> Array:
        """Knots of the spline."""
        return self._knots.breaks

    def _evaluate(self, x: Array, order: int) -> Array:
        z = np.moveaxis(self._knots.basis(x).combine(self._coefficients), 1, 0)
        p, q = z[order, :, :3], z[:, :, 3:]
        if order:
            N, W = _turn(q)
            return np.concatenate([p, _divide(W[:order], N)[-1]], axis=1)
        S = skew(q[0, :, 1:])
        return make_poses(
            np.eye(3) + 2.0 / (q[0] * q[0]).sum(axis=1)[:, None, None] * (q[0, :, :1, None] * S + S @ S), p
        )

    def piece_bounds(self) -> Array:
        """Return bounds (pieces, 2, 4) on the derivatives of position and rotation."""
        return self._bounds[0].copy()

    def derivative_bounds(self) -> Array:
        """Return bounds (2, 4): the greatest of all pieces."""
        return np.asarray(self._bounds[0].max(axis=0))

    @cached_property
    def _bounds(self) -> tuple[Array, Array]:
        """Bounds (pieces, 2, 4) on derivatives, and lower bounds (pieces, 2) on |dp/ds| and on the quaternion's square."""
        # The control points bound the fourth derivative. A lower one is at most its largest sample, plus half the distance of
        # the samples times the bound above it. N and W are those of `_turn`, with N⁽⁴⁾ and W''' by the product rule.
        width = np.diff(self.breaks)
        half, pieces = 0.5 * width / SPAN_SAMPLES, (width.size, SPAN_SAMPLES + 1)
        s = self.breaks[:-1, None] + width[:, None] * np.linspace(0.0, 1.0, SPAN_SAMPLES + 1)
        z = np.moveaxis(self._knots.basis(s.ravel()).combine(self._coefficients), 1, 0)

        def below(samples: Sequence[Array], highest: Array) -> list[Array]:
            """Return bounds (pieces,) on the norms of ascending orders, from samples and the bound on the highest."""
            found = [highest]
            for each in reversed(samples):
                size = np.linalg.norm(each.reshape(s.size, -1), axis=1).reshape(pieces).max(axis=1)
                found.insert(0, (1.0 + ROUNDING) * size + half * found[0])
            return found

        def above(size: Array, slope: Array) -> Array:
            return np.asarray((1.0 - ROUNDING) * size.reshape(pieces).min(axis=1) - half * slope)

        def of_part(part: slice) -> list[Array]:
            """Return bounds (pieces,) on the derivatives of orders 0 to 4 of a part of the spline."""
            size = np.linalg.norm(self._knots.control_points(self._coefficients[:, part], 4), axis=1)
            return below([*z[:, :, part]], (1.0 + ROUNDING) * np.maximum(size[:-1], size[1:]))

        p, a = of_part(slice(0, 3)), of_part(slice(3, 7))
        N, W = _turn(z[:, :, 3:])
        n = below(N[1:], 2.0 * (a[0] * a[4] + 4.0 * a[1] * a[3] + 3.0 * a[2] ** 2))
        w = below(W, 2.0 * (a[0] * a[4] + 2.0 * a[1] * a[3]))
        lowest = np.stack([above(np.linalg.norm(z[1, :, :3], axis=1), p[2]), above(N[0], n[0])], axis=1)
        with np.errstate(all="ignore"):  # where the quaternion may vanish: such a path is refused
            turning, omega = _divide(w, [lowest[:, 1], *(-each for each in n)]), _divide(W, N)
            turning[:3] = np.minimum(turning, below(omega, turning[3]))[:3]
            bell = np.empty((width.size, 5))
            bells(np.stack([np.zeros(width.size), *turning], axis=1), bell)
            rotation = np.minimum(bell[:, 1:].T, below([*rotation_derivative_norms(*omega).T], bell[:, 4]))
        return np.stack([np.stack(p[1:]), rotation]).transpose(2, 0, 1), lowest

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files."""
        return {
            "path": self.name, "knots": self.breaks.tolist(), "coefficients": self._coefficients.tolist(),
            "deviation": list(self.deviation),
        }  # fmt: skip

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """Return the curve that `to_dict` wrote."""
        knots, coefficients, deviation = fields(data, cls.name, "knots", "coefficients", "deviation")
        at = read_numbers(knots, (len(knots) if isinstance(knots, list) else 2,), "knots")
        if at.size < 2 or at[0] != 0.0 or not (np.diff(at) > 0.0).all():
            raise InvalidInput("knots", repr(knots)[:60], "at least two increasing numbers from 0")
        path = object.__new__(cls)
        path._knots = ControlCurve(float(at[-1]), 0, at[1:-1])
        path._coefficients = read_numbers(coefficients, (path._knots.count, 7), "coefficients")
        position, rotation = read_numbers(deviation, (2,), "deviation").tolist()
        path.deviation = (position, rotation)
        path._check()
        return path

    def _check(self, u: Array | None = None) -> None:
        """Raise InvalidInput unless the tool point is proved to move everywhere, and the quaternion not to vanish."""
        bounds, lowest = self._bounds
        for piece, which in np.argwhere(~(lowest > 0.0)):
            s = np.linspace(self.breaks[piece], self.breaks[piece + 1], FINE_SAMPLES + 1)
            rate = np.linalg.norm(self._evaluate(s, 1)[:, :3], axis=1)
            if which == 0 and rate.min() > (s[1] - s[0]) * bounds[piece, 0, 1]:
                continue
            at = float(s[rate.argmin()])
            place = "coefficients" if u is None else f"points[{int(np.abs(u - at).argmin())}]"
            got = ("a tool point that nearly stops", "turns that are too large for a smooth curve")[which]
            expected = ("a path without reversals", "smaller turns from one point to the next")[which]
            advice = ("end the path where it reverses; for noisy points a larger tolerance=", "add points between")[
                which
            ]
            raise InvalidInput(place, f"{got}, near s = {at:.6g} m", expected, advice=advice)


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
    expected = "points (k, 3) or poses (k, 4, 4), at least two"
    given = real_array(points, "points", expected)
    if given.shape[1:] not in ((3,), (4, 4)) or len(given) < 2:
        raise InvalidInput("points", f"shape {given.shape}", expected)
    if given.ndim == 3:
        if orientation is not None:
            raise InvalidInput("orientation", "a rotation", "None, because the poses have their own")
        poses = check_waypoints(given, "points")
    else:
        for i in np.flatnonzero(~np.isfinite(given).all(axis=1))[:1]:
            raise InvalidInput(f"points[{i}]", "NaN or infinity", "finite numbers")
        if orientation is None:
            raise InvalidInput("orientation", "None", "a rotation (3, 3) of the tool, because points have none")
        poses = make_poses(check_rotation(orientation), given)
    p, q = poses[:, :3, 3], np.array([se3.quaternion(T[:3, :3]) for T in poses])
    if not _size(p) > SHORTEST:
        expected = f"points of a size above {SHORTEST:g} m; a Line or a Polyline turns the tool at a point"
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
        raise InvalidInput(
            "tolerance", repr(tolerance), "(metres, radians) above 0, or 0 for a curve through the points"
        )
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
        while len(kept) > 1 and np.linalg.norm(p[-1] - p[kept[-1]]) <= SAME_POINT * _size(p):
            kept.pop()
        kept.append(len(p) - 1)
    chords = np.diff(p[kept], axis=0)
    length = np.linalg.norm(chords, axis=1)
    on = np.clip(np.searchsorted(kept, np.arange(len(p)), side="right") - 1, 0, len(length) - 1)
    along = ((p - p[kept][on]) * chords[on]).sum(axis=1) / length[on]
    return np.append(0.0, np.cumsum(length))[on] + np.clip(along, 0.0, length[on]), kept


def _approximate(values: Array, tolerance: Array) -> _Curve | None:
    """Return a smooth curve within the tolerance of all points; None if that needs too many knots."""
    # chords between points that are nearer would count noise as length, and waiting points as a path
    u, _ = _measure_chords(values[:, :3], min(2.0 * tolerance[0], 0.25 * _size(values[:, :3])))
    breaks, left = np.array([0.0, u[-1]]), REFINEMENTS
    for _ in range(ROUNDS):
        curve = _Fit(breaks, u, values).solve().project(values)
        far = (curve.errors(values) > tolerance).any(axis=1)
        if far.any():
            span = np.unique(np.searchsorted(breaks[1:-1], curve.u[far], side="right"))
            breaks = np.sort(np.append(breaks, 0.5 * (breaks[span] + breaks[span + 1])))
            if breaks.size > SPANS_PER_POINT * len(values) or np.diff(breaks).min() < NARROWEST * breaks[-1]:
                return None
        elif left and (found := curve.lengths())[2] > ROUGH:
            u, breaks, left = *found[:2], left - 1
        else:
            return _smooth(curve, values, tolerance)
    return None


def _smooth(curve: _Curve, values: Array, tolerance: Array) -> _Curve:
    """Return the curve with halved spans and the greatest weight of ∫ |p'''|² ds within the tolerance."""
    u, breaks, slowest = curve.u, curve.knots.breaks, SLOWER * curve.lengths()[2]
    breaks = np.sort(np.append(breaks, 0.5 * (breaks[:-1] + breaks[1:])))
    for _ in range(REFINEMENTS + 1):
        fit, (low, high), found = _Fit(breaks, u, values), SMOOTHINGS, False
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            try:
                new = fit.solve(len(u) * breaks[-1] ** 5 * 10.0**middle).project(values)
            except np.linalg.LinAlgError:  # the points are lost beside the weight
                high = middle
                continue
            if (new.errors(values) <= tolerance).all() and new.lengths()[2] >= slowest:
                low, curve, found = middle, new, True
            else:
                high = middle
        u, breaks, slow = curve.lengths()
        if not found or slow < ROUGH:
            break
    return curve


def _interpolate(values: Array, tolerance: Array) -> _Curve:
    """Return the curve with the least ∫ |p'''|² ds through points, of which those that repeat the previous one are merged."""
    u, kept = _measure_chords(values[:, :3], SAME_POINT * _size(values[:, :3]))
    through = values[kept]
    merged = through[np.searchsorted(0.5 * (u[kept][1:] + u[kept][:-1]), u)]
    for row in np.flatnonzero(_angles(values, merged) > max(SAME_TURN, tolerance[1]))[:1]:
        raise InvalidInput(
            f"points[{row}]", "a turn of the tool at one point", "a point that moves while the tool turns"
        )
    for left in reversed(range(REFINEMENTS)):
        at = u[kept]
        knots = ControlCurve(float(at[-1]), 0, at[1:-1])
        if len(kept) == 2:
            inner = through[0] + knots.greville[1:-1, None] / knots.end * (through[1] - through[0])
        else:  # parameters about 1 apart, so that all equations are of one size
            scaled, ends = at * ((len(at) - 1) / at[-1]), (NATURAL, NATURAL)
            inner = scipy.interpolate.make_interp_spline(scaled, through, k=DEGREE, bc_type=ends).c[1:-1]
        curve = _Curve(knots, np.concatenate([through[:1], inner, through[-1:]]), u)
        found = curve.lengths()
        if found[2] < ROUGH or not left:
            break
        u = found[0]
    return curve


METHOD = Spline
