"""Trajectory: joint motion over time as piecewise polynomials of degree 5 at most, and its interpolation by a controller."""

from __future__ import annotations

from functools import cached_property
from math import factorial
from typing import Any, NamedTuple

import numpy as np
import scipy

from optik.card import MOST_POINTS, Card, Plot
from optik.check import check_choice, check_kind, check_number
from optik.errors import InvalidInput
from optik.types import Array
from planners.trajectory import curve
from planners.trajectory.curve import PiecewiseCurve

# ---------------- trajectory


LARGEST_POSITION = 1e9
"""Largest term of a position [rad, m]: beyond it rounding is above any tolerance of a path, and derivatives overflow."""


class Extrema(NamedTuple):
    """Exact least and greatest value of each joint (n,), and when [s]; one-sided values at jumps count."""

    least: Array
    greatest: Array
    t_least: Array
    t_greatest: Array

    @property
    def worst(self) -> Array:
        """Largest absolute value of each joint (n,)."""
        return np.maximum(np.abs(self.least), np.abs(self.greatest))

    @property
    def t_worst(self) -> Array:
        """Time of the largest absolute value [s]."""
        return np.where(np.abs(self.least) > np.abs(self.greatest), self.t_least, self.t_greatest)


class Trajectory(PiecewiseCurve):
    """Joint motion q(t), t in [0, duration] seconds.

    ``trajectory(t, order)`` gives q, q̇, q̈ or the jerk; where a derivative jumps, its right-hand value.

    Parameters
    ----------
    polynomial : scipy.interpolate.PPoly
        Knots from 0, coefficients (at most 6, m, n).
    s : (m + 1,) array, optional
        The path parameter s [m, or rad] at the knots, if the law that made the motion knows it.
    """

    parameter = "t"
    notes: tuple[str, ...] = ()

    def __init__(self, polynomial: Any, s: Array | None = None) -> None:
        check_kind(polynomial, "polynomial", scipy.interpolate.PPoly)
        if polynomial.c.ndim != 3 or polynomial.c.shape[0] > 6:
            raise InvalidInput("polynomial", f"coefficients of shape {polynomial.c.shape}", "(at most 6, m, n)")
        if polynomial.x[0] != 0.0 or not (np.diff(polynomial.x) > 0.0).all():
            raise InvalidInput("polynomial", "its knots", "knots that increase from 0")
        self._set_polynomial(polynomial)
        reach = curve.largest_term(self._c, self._x)
        if not reach <= LARGEST_POSITION:
            if not np.isfinite(polynomial.c).all():
                raise InvalidInput("polynomial", "NaN or infinity in its coefficients", "finite coefficients")
            expected = f"positions up to {LARGEST_POSITION:g} rad or m"
            raise InvalidInput("polynomial", f"positions up to {reach:.3g}", expected)
        if s is not None and np.shape(s) != polynomial.x.shape:
            raise InvalidInput("s", f"an array of shape {np.shape(s)}", f"one for each knot: {polynomial.x.shape}")
        self.s = s

    def __repr__(self) -> str:
        degree, pieces, n = (int(size) for size in np.shape(self._c))
        return f"Trajectory({self.duration:.4g} s, {n} joints, {pieces} pieces of degree {degree - 1})"

    def _repr_html_(self) -> str:
        """Return plots of positions and velocities for a notebook."""
        return Card(title=repr(self), plots=[self._plot(0, "q [rad, m]"), self._plot(1, "q̇ [rad/s, m/s]")]).to_html()

    def _plot(self, order: int, title: str) -> Plot:
        """Return a small plot of a derivative of all joints."""
        t = np.linspace(0.0, self.duration, MOST_POINTS)
        return Plot(title, t, np.asarray(self(t, order)))

    @property
    def end(self) -> float:
        """The duration [s]."""
        return float(self._x[-1])

    @property
    def duration(self) -> float:
        """The duration [s]."""
        return self.end

    @property
    def knots(self) -> Array:
        """Times of the knots (m + 1,) [s]."""
        return _lock(self._x)

    @property
    def coefficients(self) -> Array:
        """Coefficients (6, m, n), highest power first, in the time since each piece's first knot."""
        return _lock(self._c)

    @cached_property
    def padded(self) -> Array:
        """Coefficients of quintics (6, m, n): `coefficients`, with zeros for missing powers."""
        p = self._c
        c = np.zeros((6, *p.shape[1:]))
        c[6 - len(p) :] = p
        return c

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self._c.shape[2])

    @property
    def without_s(self) -> Trajectory:
        """The same motion without path parameters, for another path."""
        return self if self.s is None else Trajectory(self._polynomial)

    def sample(self, rate: float) -> tuple[Array, Array]:
        """Return the motion at a rate and at its end.

        Parameters
        ----------
        rate : float
            Samples per second [1/s].

        Returns
        -------
        tuple of arrays
            Times (k,) at i / rate [s], and configurations (k, n) [rad, m].

        Raises
        ------
        InvalidInput
            A rate [1/s] that is not above 0.
        """
        check_number(rate, "rate", "samples per second, above 0", above=0.0)
        t = np.arange(0.0, self.end, 1.0 / rate)
        t = np.append(t[t < self.end - 1e-9], self.end)
        return t, self(t)

    def ends(self, order: int) -> tuple[Array, Array]:
        """Return one-sided values of a derivative at both ends of every piece.

        Parameters
        ----------
        order : int
            Of the derivative, 0 to 3.

        Returns
        -------
        tuple of (m, n) arrays
            [rad, rad/s, rad/s², rad/s³, or m].
        """
        first, last = self._ends
        return first[order], last[order]

    @cached_property
    def _ends(self) -> tuple[Array, Array]:
        c, h = self.padded, np.diff(self.knots)
        first, last = np.empty((2, 4, *c.shape[1:]))
        curve.piece_ends(c, h, first, last)
        return first, last

    def jumps(self, order: int) -> Array:
        """Return the discontinuities of a derivative at the inner knots.

        Parameters
        ----------
        order : int
            Of the derivative, 0 to 3.

        Returns
        -------
        (m - 1, n) array
            [rad, rad/s, rad/s², rad/s³, or m].
        """
        first, last = self.ends(order)
        return first[1:] - last[:-1]

    def extrema(self, order: int) -> Extrema:
        """Return the exact extrema of a derivative of each joint, from the roots of the next one; computed once.

        Parameters
        ----------
        order : int
            Of the derivative, 0 to 3.

        Returns
        -------
        Extrema
            Of each joint.

        Raises
        ------
        InvalidInput
            Another order.
        """
        if order not in range(self.highest_order + 1):
            raise InvalidInput("order", repr(order), f"0 to {self.highest_order}")
        return self._extrema[order]

    @cached_property
    def _extrema(self) -> tuple[Extrema, ...]:
        """Least and greatest values and their times, by order."""
        out = np.empty((4, 4, self.n))
        curve.whole_extrema(*self._pieces, self.knots, out)
        return tuple(Extrema(*each) for each in out)

    @cached_property
    def _pieces(self) -> tuple[Array, Array]:
        """Extrema of all pieces, and their times since the first knot: (order, piece, joint, least and greatest)."""
        c = self.padded
        value, when = np.empty((2, 4, *c.shape[1:], 2))
        curve.piece_extrema(c, np.diff(self.knots), value, when)
        return value, when

    @property
    def piece_ranges(self) -> Array:
        """Exact least and greatest values (4, m, n, 2) of the derivatives of order 0 to 3 on every piece."""
        return self._pieces[0]

    def piece_worst(self, order: int) -> Array:
        """Return the exact largest absolute value of a derivative on every piece.

        Parameters
        ----------
        order : int
            Of the derivative, 0 to 3.

        Returns
        -------
        (m, n) array
            [rad, rad/s, rad/s², rad/s³, or m].
        """
        value = self._pieces[0][order]
        worst: Array = np.maximum(np.abs(value[..., 0]), np.abs(value[..., 1]))
        return worst

    def piece_range(self, order: int) -> tuple[Array, Array]:
        """Return the exact least and greatest value of a derivative on every piece.

        Parameters
        ----------
        order : int
            Of the derivative, 0 to 3.

        Returns
        -------
        tuple of (m, n) arrays
            [rad, rad/s, rad/s², rad/s³, or m].
        """
        value = self._pieces[0][order]
        return value[..., 0], value[..., 1]

    def stretched(self, factor: float) -> Trajectory:
        """Return the same motion, factor times as long: velocities / factor, accelerations / factor², jerks / factor³.

        Parameters
        ----------
        factor : float
            Above 0; below 1 for a faster motion [1].

        Returns
        -------
        Trajectory
            The scaled motion.

        Raises
        ------
        InvalidInput
            A factor that is not above 0.
        """
        check_number(factor, "factor", "a number above 0", above=0.0)
        p = self._polynomial
        powers = np.arange(p.c.shape[0])[::-1][:, None, None]
        return Trajectory(type(p)(p.c / float(factor) ** powers, p.x * float(factor), extrapolate=True), self.s)


def _lock(array: Array) -> Array:
    view = array.view()
    view.setflags(write=False)
    return view


State = tuple[Array, Array, Array]
"""q, q̇ and q̈ (n,)."""


def map_joints(trajectory: Trajectory, matrix: Array, offset: Array | float = 0.0) -> Trajectory:
    """Return the motion of linear combinations of the joints, matrix @ q + offset, at the same knots."""
    c = np.einsum("pmn,kn->pmk", trajectory.padded, matrix)
    c[5] += offset
    return Trajectory(scipy.interpolate.PPoly(c, trajectory.knots, extrapolate=True), trajectory.s)


def shift_pieces(c: Array, u: Array) -> Array:
    """Return the coefficients (6, m, n) of the same quintics about u (m,), by repeated Horner steps (Taylor shift)."""
    c, u = c.copy(), u[:, None]
    for last in range(5, 0, -1):
        for i in range(1, last + 1):
            c[i] += u * c[i - 1]
    return c


def cut_before(trajectory: Trajectory, t: float, s: float | None = None) -> Trajectory:
    """Return the part of a motion from time t [s] on, with the same polynomials up to rounding.

    It begins with exactly the values of the trajectory at t; `s` is the path parameter there, if it is known.
    """
    knots, c = trajectory.knots, trajectory.padded
    first = int(np.searchsorted(knots, t, side="right")) - 1
    c = c[:, first:].copy()
    c[:, :1] = shift_pieces(c[:, :1], np.array([t - knots[first]]))
    for order in range(3):
        c[5 - order, 0] = trajectory(t, order) / factorial(order)
    known = None if s is None or trajectory.s is None else np.append(s, trajectory.s[first + 1 :])
    return without_rounding(c, np.append(0.0, knots[first + 1 :] - t), known)


def cut_after(trajectory: Trajectory, t: float) -> Trajectory:
    """Return the part of a motion up to time t [s], at most to its end, with the same polynomials."""
    before = int(np.searchsorted(trajectory.knots, t, side="left"))
    knots = np.append(trajectory.knots[:before], t)
    return Trajectory(scipy.interpolate.PPoly(trajectory.coefficients[:, :before], knots, extrapolate=True))


def join(first: Trajectory, second: Trajectory) -> Trajectory:
    """Return one motion followed by another; pieces of the second one that are shorter than rounding are left out."""
    c = np.concatenate([first.padded, second.padded], axis=1)
    t, a, b = np.append(first.knots, first.end + second.knots[1:]), first.s, second.s
    return without_rounding(c, t, None if a is None or b is None else np.append(a, b[1:]))


def without_rounding(c: Array, t: Array, s: Array | None = None) -> Trajectory:
    """Return the motion of quintics (6, m, n) without the pieces whose knots (m + 1,) have become equal by rounding."""
    wide = np.append(np.diff(t) > 0.0, True)
    if not wide.all():
        c, t, s = c[:, wide[:-1]], t[wide], None if s is None else s[wide]
    return Trajectory(scipy.interpolate.PPoly(c, t, extrapolate=True), s)


def make_rest(q: Array, duration: float, s: float | None = None) -> Trajectory:
    """Return a motion that stays at a configuration (n,), at a path parameter if it has one, for a duration [s]."""
    still = np.zeros((6, 1, q.size))
    still[5] = q
    places = None if s is None else np.array([s, s])
    return Trajectory(scipy.interpolate.PPoly(still, np.array([0.0, duration])), places)


def append_rest(trajectory: Trajectory, duration: float) -> Trajectory:
    """Return a motion that ends at rest, prolonged by a time at rest [s]."""
    return join(trajectory, make_rest(trajectory(trajectory.end), duration))


# ---------------- the trajectory a controller executes when it interpolates setpoints sent at a fixed rate


INTERPOLATIONS = ("linear", "cubic", "quintic")
"""Interpolation through positions; positions and velocities; positions, velocities and accelerations."""
SAME_INSTANT = 1e-9
"""Instants nearer to a knot than this are equal to it [s]: one nanosecond, the resolution of controllers."""
POINTS = 1_000_000
"""Most setpoints of a motion: two hours at 125 per second."""


def simulate_controller(trajectory: Trajectory, rate: float, interpolation: str) -> Trajectory:
    """Return the trajectory a controller executes when it gets setpoints at n / rate and at the end.

    Certify it to see what the arm will do: ``certify(robot, path, simulate_controller(trajectory, 125.0, "cubic"), limits)``.

    Parameters
    ----------
    trajectory : Trajectory
        The motion that is sent. Its exact q, q̇ and q̈ are the points; where q̈ jumps at one, the mean of both sides.
    rate : float
        Points per second [1/s].
    interpolation : str
        ``"linear"`` through positions: velocities jump, so accelerations are infinite. ``"cubic"`` through positions
        and velocities: accelerations jump. ``"quintic"`` through positions, velocities and accelerations.

    Returns
    -------
    Trajectory
        Of the same duration.

    Raises
    ------
    InvalidInput
        A rate that is not above 0 or gives more than 1,000,000 points, or another interpolation.
    """
    check_kind(trajectory, "trajectory", Trajectory)
    rate = check_number(rate, "rate", "points per second, above 0", above=0.0)
    periods = trajectory.end * rate
    if periods > POINTS:
        raise InvalidInput("rate", f"{rate:.9g}, {periods:.3g} points", f"at most {POINTS} points")
    t = np.arange(int(periods) + 1) / rate
    t = t[: 1 + np.count_nonzero(t[1:] < trajectory.end - 1e-6 / rate)]  # no period of rounding before the end
    t = np.append(t, trajectory.end)
    return trajectory_through(t, *sample_states(trajectory, t)[: count_derivatives(interpolation)])


def count_derivatives(interpolation: str) -> int:
    """Return the number of derivatives (of q, q̇, q̈) that an interpolation passes through."""
    return INTERPOLATIONS.index(check_choice(interpolation, "interpolation", INTERPOLATIONS)) + 1


def sample_states(trajectory: Trajectory, t: Array) -> tuple[Array, Array, Array]:
    """Return q, q̇, q̈ at instants: the mean of both sides, which differ only at a discontinuity."""
    x, c = trajectory.knots, trajectory.coefficients
    sides = []
    for beside in (t - SAME_INSTANT, t + SAME_INSTANT):
        piece = np.clip(np.searchsorted(x, beside, side="right") - 1, 0, x.size - 2)
        u = (t - x[piece])[:, None]
        q = v = a = np.zeros((t.size, trajectory.n))
        for power in c[:, piece]:  # Horner, with both derivatives
            a, v, q = a * u + v, v * u + q, q * u + power
        sides.append((q, v, 2.0 * a))
    q, v, a = (0.5 * (before + after) for before, after in zip(*sides, strict=True))
    return q, v, a


def trajectory_through(t: Array, q: Array, v: Array | None = None, a: Array | None = None) -> Trajectory:
    """Return the motion through setpoints: positions, and velocities and accelerations if they are given."""
    if v is None:
        return Trajectory(scipy.interpolate.PPoly(np.stack([np.diff(q, axis=0) / np.diff(t)[:, None], q[:-1]]), t))
    if a is None:
        return Trajectory(scipy.interpolate.PPoly(scipy.interpolate.CubicHermiteSpline(t, q, v).c, t))
    return Trajectory(curve.quintic_through(t, q, v, a))
