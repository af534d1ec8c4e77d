"""A path with freedoms: the tool of a given path, moved along screws by splines in s whose coefficients a planner chooses."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, Self

import numpy as np

from optik import se3
from optik.arm.plain import numbers_to_list, read_numbers
from optik.arm.robot import Robot
from optik.check import check_count, check_flag, check_kind
from optik.errors import InvalidInput
from optik.types import Array, Indices
from planners.freedom import Freedom, freedom_of, loaded_freedom
from planners.freedom.base import Bounds
from planners.paths.base import ASKED, Asked, Path, PiecewisePath, fields
from planners.paths.control_curve import DEGREE, ControlBounds, ControlCurve
from planners.paths.coordinates import CoordinateRange, NullSpace, frees_rotation, read_null_space
from planners.paths.screws import move_along
from planners.trajectory.curve import BINOMIAL, bells

FEWEST_COEFFICIENTS, PER_SEGMENT, MOST_DEFAULT = 8, 3, 32
"""Default number of coefficients of each coordinate: so many for each segment of the given path, but at least the first number
and at most the last one. More shorten lines by less than 0.1 %, and seams of 400 segments by 3 % in three times the time."""
BREAK_APART = 1e-9
"""Fraction of the path within which a knot of the splines is a break of the given path."""
IN_RANGE = 1e-9
"""Largest rounding error of a coordinate outside its range [as its unit]."""
MOST_COEFFICIENTS = 1_000_000
"""Most coefficients of a coordinate."""
BEGIN_STEPS, NEARLY = 12, 1e-4
"""Newton steps for the coordinates at a given start, and the distance outside a range [rad, m] that is rounding there."""
MOST_GUESSES = 20
"""Most initial guesses of the choice of the coefficients."""
FEWEST_JOINTS = 6
"""Fewest joints with which the coefficients of a path can be chosen."""


class FreePath(PiecewisePath):
    """A path of the tool with freedoms, such as a turn about the tool's axis; `planners.free` makes it.

    As an ordinary path it is the given one, moved by the present coefficients, at first the given path itself. A plan with the
    law ``optimal`` chooses the coefficients together with the timing (`Plan.freedom`).

    Parameters
    ----------
    path : Path
        The given path of tool poses.
    bounds : mapping
        Least and greatest value of each freedom's coordinates, by its name, in the order in which they move the tool.
    count : int, optional
        Coefficients of each coordinate; by default 3 for each segment of the path, but 8 to 32, and fewer where the timing has
        few grid points.
    hold_start : bool
        Whether a ``q_start`` of the plan is the start of the motion; else only its branch and first guess.
    starts : int
        Initial guesses that are tried if the start is free: that of the given path, and different sequences of configurations.
    coefficients : (count, d) array, optional
        Values of the coordinates at the control points of their splines [rad, m]; by default the allowed values nearest to 0.
    null_space : NullSpace, optional
        Null-space coordinates of a redundant arm, once they are chosen.
    asked : {"pose", "axis", "point"}, optional
        What the tool must meet of this path's poses; "point" with ``turn=True, tilt=True``.
    """

    name: ClassVar[str] = "free_path"

    def __init__(
        self, path: Path, bounds: Mapping[str, Bounds], *, count: int | None = None, hold_start: bool = True, starts: int = 6,
        coefficients: Array | None = None, null_space: NullSpace | None = None, asked: Asked = "pose",
    ) -> None:  # fmt: skip
        self.given, self.bounds = path, dict(bounds)
        self.asked = "point" if frees_rotation(path, self.bounds) else asked
        check_count(starts, "starts", 1, MOST_GUESSES)
        self.counts_itself = count is None
        count = int(np.clip(PER_SEGMENT * path.segments, FEWEST_COEFFICIENTS, MOST_DEFAULT)) if count is None else count
        check_count(count, "coefficients", DEGREE + 1, MOST_COEFFICIENTS)
        self.hold_start, self.starts = check_flag(hold_start, "hold_start"), starts
        self.unit, self.turns_only, self.segments = path.unit, path.turns_only, path.segments
        self.spline, self.null_space = ControlCurve(path.end, count), null_space
        self.kinds: tuple[Freedom, ...] = tuple(loaded_freedom(name) for name in self.bounds)
        ends = np.cumsum([0, *(len(kind.screws) for kind in self.kinds)]).tolist()
        self.columns = {kind.name: slice(*at) for kind, at in zip(self.kinds, pairwise(ends), strict=True)}
        self.screws: Array = np.array([screw for kind in self.kinds for screw in kind.screws]).reshape(-1, 6)
        nearest = np.array([np.clip(0.0, *self.bounds[kind.name]) for kind in self.kinds for _ in kind.screws])
        start = np.tile(nearest, (count, 1)) if coefficients is None else coefficients
        self.coefficients: Array = np.ascontiguousarray(start, dtype=np.float64).reshape(count, len(self.screws))
        for one in self.ranges:
            if not (one.reached[0] >= one.allowed[0] - IN_RANGE and one.reached[1] <= one.allowed[1] + IN_RANGE):
                at = f"{one.reached[0]:.6g} to {one.reached[1]:.6g} {one.unit} for {one.name}"
                raise InvalidInput("coefficients", at, f"{one.allowed[0]:.6g} to {one.allowed[1]:.6g}")

    def with_count(self, count: int) -> Self:
        """Return the path with another number of coefficients, inside the convex hull of the present ones.

        Parameters
        ----------
        count : int
            Coefficients of each coordinate.

        Returns
        -------
        FreePath
            The path, nearly the same; without null-space coordinates.
        """
        spline = ControlCurve(self.end, count)
        coefficients = [np.interp(spline.greville, self.spline.greville, x) for x in self.coefficients.T]
        return self._copy(count, np.reshape(coefficients, (len(coefficients), count)).T, None)

    def with_coefficients(self, coefficients: Array, null_space: NullSpace | None) -> Self:
        """Return the path with other coefficients of its coordinates.

        Parameters
        ----------
        coefficients : (count, d) array
            Values of the coordinates at the control points [rad, m].
        null_space : NullSpace or None
            Null-space coordinates of a redundant arm.

        Returns
        -------
        FreePath
            The path.
        """
        return self._copy(self.spline.count, coefficients, null_space)

    def asking(self, robot: Robot) -> Self:
        """Return the path that asks as much as an arm can meet: of five joints with ``turn=True``, point and axis.

        Parameters
        ----------
        robot : Robot
            The arm.

        Returns
        -------
        FreePath
            The path, or a copy.

        Raises
        ------
        InvalidInput
            An arm with too few joints for these freedoms.
        """
        few = robot.n < FEWEST_JOINTS + ("elbow" in self.bounds)
        if self.asked != "pose" or not few:
            return self
        if self.bounds == {"turn": (-np.inf, np.inf)} and robot.n == FEWEST_JOINTS - 1:
            return self._copy(self.spline.count, self.coefficients, None, "axis")
        expected = "an arm with more than six joints"
        if "elbow" not in self.bounds:
            expected = "an arm with at least six joints, or with five for turn=True alone; or turn=True, tilt=True"
        got = f"one with {' and '.join(self.bounds)}, for {robot.name} with {robot.n} joints"
        raise InvalidInput("path", got, expected)

    def begin_at(self, pose: Array) -> Self:
        """Return the path that begins at a pose, or as near to it as the ranges of the coordinates allow.

        Parameters
        ----------
        pose : (4, 4) array
            The tool's pose [1, m].

        Returns
        -------
        FreePath
            The path; control points that were equal to the first one are moved with it.
        """
        p, f, turn = self.coefficients, self.coefficients[0].copy(), 2.0 * np.pi
        for _ in range(BEGIN_STEPS if f.size else 0):
            T, fields = self.given.pose(np.zeros(1)).copy(), np.empty((1, f.size, 4, 6))
            move_along(self.screws, np.stack([f, 0 * f, 0 * f, 0 * f])[None], T, np.zeros((1, 3, 6)), fields)
            turns, moves = fields[0, :, 0, :3], fields[0, :, 0, 3:]
            J = np.concatenate([moves + np.cross(turns, T[0, :3, 3]), turns], axis=1).T
            f += np.linalg.lstsq(J, se3.error(T[0], pose), rcond=None)[0]
        low, high = self.control_bounds.lower[0] - NEARLY, self.control_bounds.upper[0] + NEARLY
        whole = np.maximum(np.ceil((low - f) / turn), 0.0) + np.minimum(np.floor((high - f) / turn), 0.0)
        f += turn * self.screws[:, 3:].any(axis=1) * whole
        moved = self.control_bounds.clip(np.tile(f, (len(p), 1)))
        return self.with_coefficients(np.where(p == p[0], moved, p), self.null_space)

    @cached_property
    def control_bounds(self) -> ControlBounds:
        """Bounds of the coefficients, by the ranges of the freedoms."""
        shape, discs = self.coefficients.shape, []
        lower, upper = np.full(shape, -np.inf), np.full(shape, np.inf)
        for kind in self.kinds:
            (low, high), at = self.bounds[kind.name], self.columns[kind.name]
            if kind.round:
                discs.append((at.start, high))
            else:
                lower[:, at], upper[:, at] = low, high
        return ControlBounds(lower, upper, tuple(discs))

    def _copy(self, count: int, coefficients: Array, null_space: NullSpace | None, asked: Asked | None = None) -> Self:
        """Return the path with other coefficients (count, d)."""
        path = type(self)(
            self.given, self.bounds, count=count, hold_start=self.hold_start, starts=self.starts, coefficients=coefficients,
            null_space=null_space, asked=asked or self.asked,
        )  # fmt: skip
        path.counts_itself = self.counts_itself
        return path

    @property
    def end(self) -> float:
        """Length of the given path [m, or rad]."""
        return self.given.end

    @property
    def breaks(self) -> Array:
        """Breaks of the given path, and the knots of the splines, whose fifth derivatives jump there."""
        return self._pieces[0]

    @cached_property
    def _pieces(self) -> tuple[Array, Indices, Indices]:
        """The breaks (k,), and for each piece between them the piece of the given path, and the span of the splines."""
        given, spans = self.given.breaks, self.spline.breaks
        breaks = given
        if self.coefficients.any():
            near = np.abs(spans[:, None] - given).min(axis=1) <= BREAK_APART * self.end
            breaks = np.union1d(given, spans[~near])
        middle = 0.5 * (breaks[1:] + breaks[:-1])
        return breaks, np.searchsorted(given, middle) - 1, np.searchsorted(spans, middle) - 1

    def least_on_pieces(self, values: Array) -> Array:
        """Return values of the pieces between breaks: those of the pieces of the given path that they are part of."""
        return np.asarray(self.given.least_on_pieces(values)[self._pieces[1]])

    def coordinates(self, s: Array) -> Array:
        """Return the coordinates of the tool along the path.

        Parameters
        ----------
        s : (k,) array
            Path parameters [m, or rad].

        Returns
        -------
        (k, 4, d) array
            The coordinates and their first three derivatives in s [rad, m].
        """
        return self.spline.basis(s).combine(self.coefficients)

    def guide(self, s: Array) -> tuple[Array, Array]:
        """Return the rows of the null-space coordinates and their values along the path.

        Parameters
        ----------
        s : (k,) array
            Path parameters [m, or rad].

        Returns
        -------
        rows : (k, 4, r, n) array
            Rows and their first three derivatives [1].
        values : (k, 4, r) array
            Values and their first three derivatives in s [rad, m].
        """
        assert self.null_space is not None
        rows = np.zeros((s.size, 4, *self.null_space.rows.shape))
        rows[:, 0] = self.null_space.rows
        return rows, np.ascontiguousarray(self.spline.basis(s).combine(self.null_space.coefficients))

    def _bound_change(self, kind: Freedom, f: Array, change: Array) -> Array:
        """Return what the range of a freedom bounds (k, ·), of coordinates (k, d) and changes of the null space (k, r)."""
        if not kind.screws:  # of an elbow: the distance from the initial joint path
            return change
        own = f[:, self.columns[kind.name]]
        return np.linalg.norm(own, axis=1, keepdims=True) if kind.round else own

    @property
    def _change(self) -> Array:
        """Coefficients (C, r) of the distance from the initial joint path."""
        return np.zeros((self.spline.count, 1)) if self.null_space is None else self.null_space.change

    @cached_property
    def ranges(self) -> tuple[CoordinateRange, ...]:
        """Range of each coordinate: a spline lies in the convex hull of its coefficients."""
        found = []
        for kind in self.kinds:
            low, high = self.bounds[kind.name]
            for x in self._bound_change(kind, self.coefficients, self._change).T:
                allowed, least = ((0.0, high), 0.0) if kind.round else ((low, high), float(x.min()))
                found.append(CoordinateRange(kind.name, kind.unit, allowed, (least, float(x.max()))))
        return tuple(found)

    def values_of_ranges(self, s: Array) -> Array:
        """Return what the ranges of the coordinates bound.

        Parameters
        ----------
        s : (k,) array
            Path parameters [m, or rad].

        Returns
        -------
        (k, ranges) array
            Coordinates, norms of ``round`` freedoms, and distances of an elbow from the initial joint path [rad, m].
        """
        f, change = self.coordinates(s)[:, 0], self.spline.basis(s).combine(self._change)[:, 0]
        return np.concatenate([self._bound_change(kind, f, change) for kind in self.kinds], axis=1)

    @property
    def most_deviation(self) -> tuple[float, float]:
        """Proved bounds on the tool's distance from the given path: position [m] and rotation [rad]."""
        most = np.zeros(2)
        for one in self.ranges:
            screws = loaded_freedom(one.name).screws  # of several coordinates on a round range, else of one
            if screws:
                most += max(np.abs(one.reached)) * np.linalg.norm(np.reshape(screws, (-1, 2, 3)), axis=2).max(axis=0)
        return float(most[0]), float(most[1])

    def _evaluate(self, x: Array, order: int) -> Array:
        if not self.coefficients.any():
            return self.given._evaluate(x, order)
        poses, twists = self.given._evaluate(x, 0), np.zeros((x.size, 3, 6))
        for i in range(order):
            twists[:, i] = self.given._evaluate(x, i + 1)
        poses = np.ascontiguousarray(poses).copy()
        move_along(self.screws, self.coordinates(x), poses, twists, np.empty((x.size, len(self.screws), 4, 6)))
        return twists[:, order - 1] if order else poses

    def piece_bounds(self) -> Array:
        """Return bounds (k − 1, 2, 4) for each piece between breaks, by the product rule over the screws."""
        _breaks, piece, span = self._pieces
        known = np.asarray(self.given.known_bounds[piece])
        if not self.coefficients.any():
            return known
        f = self.spline.derivative_bounds(self.coefficients, 4)[span]  # (k − 1, 5, d)
        k = len(known)
        position, rotation = np.zeros((k, 5)), np.ones((k, 5))
        position[:, 1:], rotation[:, 1:] = known[:, 0], known[:, 1]
        for d, screw in enumerate(self.screws):
            speed, turning = float(np.linalg.norm(screw[:3])), float(np.linalg.norm(screw[3:]))
            S, turn = np.zeros((k, 5)), np.empty((k, 5))
            S[:, 1:] = f[:, 1:, d]
            bells(turning * S, turn)  # |dᵐ exp(f ω)|
            shift = np.zeros((k, 5))  # of the translation, whose derivative is exp(f ω) v f'
            shift[:, 0] = speed * f[:, 0, d]
            shift[:, 1:] = speed * _product(turn, np.append(S[:, 1:], np.zeros((k, 1)), axis=1))[:, :4]
            position += _product(rotation, shift) * (np.arange(5) > 0)
            rotation = _product(rotation, turn)
        return np.stack([position[:, 1:], rotation[:, 1:]], axis=1)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files."""
        null = self.null_space
        return {
            "path": self.name, "given": self.given.to_dict(),
            "bounds": {name: numbers_to_list(np.array(pair)) for name, pair in self.bounds.items()},
            "count": self.spline.count, "hold_start": self.hold_start, "starts": self.starts,
            "coefficients": self.coefficients.tolist(),
            "null_space": None if null is None else [x.tolist() for x in null],
        } | ({} if self.asked == "pose" else {"asked": self.asked})  # fmt: skip

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """Return the path that `to_dict` wrote."""
        from planners.paths import path_of

        names = "given", "bounds", "count", "hold_start", "starts", "coefficients", "null_space"
        given, bounds, count, held, starts, coefficients, null = fields(data, cls.name, *names)
        check_kind(bounds, "bounds", Mapping, "a mapping from the names of freedoms to pairs")
        found = {name: read_numbers(pair, (2,), f"bounds.{name}") for name, pair in bounds.items()}
        pairs = {name: (float(pair[0]), float(pair[1])) for name, pair in found.items()}
        if (asked := data.get("asked", "pose")) not in ASKED:
            raise InvalidInput("asked", repr(asked)[:60], f"one of: {', '.join(ASKED)}")
        path = cls(path_of(given, robot), pairs, count=count, hold_start=held, starts=starts, asked=asked)
        points = read_numbers(coefficients, path.coefficients.shape, "coefficients")
        return path.with_coefficients(points, read_null_space(null, count))


def _product(a: Array, b: Array) -> Array:
    """Return bounds (k, 5) on the derivatives of a product, from those of its factors."""
    return np.stack([sum(BINOMIAL[m, i] * a[:, i] * b[:, m - i] for i in range(m + 1)) for m in range(5)], axis=1)


def free(
    path: Path, *, coefficients: int | None = None, hold_start: bool = True, starts: int = 6, **freedoms: Any
) -> FreePath:
    """Return a path whose freedoms a plan with the law ``optimal`` chooses together with the timing.

    Parameters
    ----------
    path : Path
        The given path of tool poses.
    coefficients : int, optional
        Coefficients of each coordinate's spline; by default 3 for each segment of the path, but 8 to 32, and at most a third of
        the grid points of the timing. Around obstacles up to 5 times as many are tried where these find no motion.
    hold_start : bool
        Whether a ``q_start`` of the plan is the start of the motion, with its own turn and tilt, or an initial guess.
    starts : int
        Initial guesses that are tried if the start is free: that of the given path, and different sequences of configurations
        along the whole path; up to three more with a tilt.
    **freedoms
        By name (`planners.freedom.freedoms`), in the order in which they move the tool: ``turn=(-1.0, 1.0)`` [rad] about the
        tool's axis, ``tilt=0.2``, the half-angle of a cone [rad], ``elbow=True`` of a redundant arm. A number x means (−x, x),
        True no bounds. With ``turn=True, tilt=True`` only the tool's point follows the path, by any arm; with ``turn=True``
        alone an arm with five joints follows point and axis. Their joints move without splines of the freedoms.

    Returns
    -------
    FreePath
        At first the given path.

    Raises
    ------
    InvalidInput
        No freedom, bounds that a freedom cannot have, or a path in joint space or with freedoms already.
    UnknownName
        No such freedom; the nearest names are offered.

    Examples
    --------
    >>> import numpy as np
    >>> import optik
    >>> from planners import Line, MotionLimits, free, plan
    >>> robot = optik.load("ur5e")
    >>> q = np.array([0.4, -1.2, 1.6, -1.0, -1.3, 0.2])
    >>> start, goal = robot.fk(q), robot.fk(q)
    >>> goal[:3, 3] += [-0.1, 0.2, 0.1]
    >>> free(Line(start, goal), turn=True).ranges[0].name
    'turn'
    """
    check_kind(path, "path", Path)
    if isinstance(path, FreePath) or type(path).configurations is not Path.configurations:
        expected = "a path of tool poses without freedoms, such as a Line or a Polyline"
        raise InvalidInput("path", f"a {path.name}", expected)
    if not freedoms:
        raise InvalidInput("freedoms", "none", "at least one, such as turn=True; or elbow=True beyond six joints")
    bounds: dict[str, Bounds] = {}
    for name, value in freedoms.items():  # a path of a file is called by its stem
        bounds[freedom_of(name).name] = freedom_of(name).check(value)
    return FreePath(path, bounds, count=coefficients, hold_start=hold_start, starts=starts)


METHOD = FreePath
