"""Joint path of free shape between two configurations, through via points without stops."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.plain import read_numbers
from optik.arm.robot import Robot
from optik.check import check_kind, real_array
from optik.errors import InvalidInput, NoSolution
from optik.ik import Tolerance
from optik.ik.base import ToleranceLike
from optik.ik.problem import check_start
from optik.tables import Names, read_table, warn_of_assumptions
from optik.types import Array, Flags
from planners.paths.base import PiecewisePath, check_arm, check_recorded, check_robot, fields
from planners.paths.configurations import MISSED, choose_configurations
from planners.paths.control_curve import SPAN_SAMPLES, ControlCurve, read_breaks
from planners.paths.joint_curve import bound_tool_derivatives, tool_twists
from planners.paths.waypoints import LEAST_VIA_TOLERANCE, read_joint_waypoints

SPANS_DIRECT, SPANS_PER_LEG = 4, (3, 6)
"""Spans of the spline from start to goal, and between via points: more shorten motions by less than 0.1 %. Where the control
points cannot stay inside the joint limits, more, so that no control point belongs to two via points."""
SHORTEST_LEG = 1e-6
"""Shortest distance between two configurations of the path [rad, m]."""
STRAIGHT_RATE = 1e-12
"""Largest difference of q' from that of a straight line [1]: rounding."""


class ViaPoint:
    """A configuration or pose on the way.

    Parameters
    ----------
    target : (n,) or (4, 4) array
        Configuration [rad, m], or T_base_tool [m].
    tolerance : Tolerance, or (2,) tuple of float, optional
        Largest distance [m] and angle [rad] of the tool from the target; by default the configuration is passed exactly, and
        a pose by the configuration that is chosen for it.
    """

    def __init__(self, target: ArrayLike, tolerance: ToleranceLike | None = None) -> None:
        expected = "a configuration (n,) or a pose (4, 4)"
        self.target: Array = real_array(target, "target", expected).copy()
        if self.target.ndim != 1 and self.target.shape != (4, 4):
            raise InvalidInput("target", f"shape {self.target.shape}", expected)
        self.tolerance = None if tolerance is None else Tolerance.of(tolerance)
        for value in () if self.tolerance is None else (self.tolerance.position, self.tolerance.rotation):
            if value < LEAST_VIA_TOLERANCE:
                allowed = f"{LEAST_VIA_TOLERANCE:g} m and rad or more; or none, for a point that is passed exactly"
                raise InvalidInput("tolerance", f"{value:g}", allowed)

    @property
    def is_pose(self) -> bool:
        """Whether the target is a pose."""
        return self.target.ndim == 2


class Via(NamedTuple):
    """A via point of a path: its path parameter, configuration and pose, and the tolerance of the tool or None for exactly."""

    s: float
    q: Array
    pose: Array
    tolerance: Tolerance | None


class PointToPoint(PiecewisePath):
    """Joint path from a configuration to a goal, through via points that are passed without a stop.

    q(s) is a B-spline of degree 5. At first it is the straight line in joint space, or the curve through the via points with
    the least ∫ |q''|² ds. A plan with the law ``optimal`` chooses its shape together with the timing (`Plan.freedom`). s ends
    at the length of the line through the points in joint space. Between two points it grows with the square root of their
    distance (centripetal), so a short leg between long ones does not make the curve overshoot. The control points stay inside
    the joint limits, so the path does.

    Parameters
    ----------
    robot : Robot
        The arm.
    q_start : (n,) array
        Configuration at the start [rad, m].
    *points : ViaPoint, (n,) or (4, 4) array
        Via points and, last, the goal. The goal is reached exactly. For poses, the configurations inside the limits are
        chosen for which the line through all points is the shortest in joint space. A point that equals the one before
        is merged with it. ``dropped`` lists the merged points; the start counts as 0.
    usable : callable, optional
        Says which of configurations (k, n) may be chosen for a pose; by default all. If none may, all may.

    Raises
    ------
    InvalidInput
        An invalid arm or point, a configuration outside the limits, points that all equal the start, a goal with a tolerance.
    NoSolution
        A pose that no configuration reaches.
    """

    name: ClassVar[str] = "point_to_point"
    notes: tuple[str, ...] = ()
    in_joints = True
    points: Sequence[ViaPoint] = ()
    corners: Array | None = None  # (k, n), of the way around obstacles near which the path began

    def __init__(
        self, robot: Robot, q_start: ArrayLike, *points: ViaPoint | ArrayLike, usable: Callable[[Array], Flags] | None = None
    ) -> None:  # fmt: skip
        check_robot(robot)
        if not points:
            raise InvalidInput("points", "none", "a goal, with via points before it")
        vias = [point if isinstance(point, ViaPoint) else ViaPoint(point) for point in points]
        if vias[-1].tolerance is not None:
            raise InvalidInput("points", "a goal with a tolerance", "a goal that is reached exactly")
        self.robot, self.unit = robot, "m" if robot.prismatic.all() else "rad"
        q = choose_configurations(robot, check_start(robot, q_start, "q_start"), [one.target for one in vias], usable)
        kept = np.append(0, 1 + np.flatnonzero(np.linalg.norm(np.diff(q, axis=0), axis=1) > SHORTEST_LEG))
        if len(kept) < 2:
            raise InvalidInput("points", "only points that equal the start", "a point with other joints")
        kept[-1] = len(q) - 1  # the goal is reached exactly
        self.dropped = tuple(np.setdiff1d(np.arange(len(q)), kept).tolist())
        q, vias = q[kept], [vias[i - 1] for i in kept[1:]]
        self.points = vias
        legs = np.linalg.norm(np.diff(q, axis=0), axis=1)
        s = np.append(0.0, np.cumsum(np.sqrt(legs)))
        s *= legs.sum() / s[-1]
        poses = [point.target if point.is_pose else robot.fk(x) for point, x in zip(vias, q[1:], strict=True)]
        self.vias = tuple(
            Via(float(at), x, se3.nearest_pose(pose), point.tolerance)
            for at, x, pose, point in zip(s[1:-1], q[1:-1], poses[:-1], vias[:-1], strict=True)
        )
        for parts in (SPANS_DIRECT,) if len(legs) == 1 else SPANS_PER_LEG:
            inner = np.unique(np.concatenate([np.linspace(a, b, parts + 1)[:-1] for a, b in itertools.pairwise(s)])[1:])
            self.spline = ControlCurve(float(s[-1]), 0, inner)
            first = self.spline.interpolate(s, q)
            self.coefficients: Array = self.spline.move_inside(s, q, first, robot.limits.lower, robot.limits.upper)
            if not self.list_missed():
                break

    @classmethod
    def from_csv(
        cls, robot: Robot, file: str | os.PathLike[str], *, unit: str | None = None, columns: Names = None,
        ignore: Names = None,
    ) -> Self:  # fmt: skip
        """Return the path through the configurations and poses of a table.

        The header names the joints, ``q1_deg``, … (``q1_mm`` if it slides) or ``q1``, … [rad, m], and optionally the columns of
        poses of `Polyline.from_csv`. A row is a configuration or a pose; other cells are empty. The first row is the start,
        a configuration. The last row is the goal. Without an orientation, poses have that of the tool at the start.

        Parameters
        ----------
        robot : Robot
            The arm.
        file : str or path
            The table. Its columns ``tolerance_mm`` and ``tolerance_deg`` are the tolerances of via points; empty: exactly.
        unit, columns, ignore
            As in `Polyline.from_csv`.

        Returns
        -------
        PointToPoint
            Through all rows.

        Raises
        ------
        InvalidInput
            As for `PointToPoint`; a file that cannot be read, or invalid columns or cells; the error names line and column.
        NoSolution
            A pose that no configuration reaches.
        """
        check_robot(robot)
        table = read_table(file, columns, ignore)
        start, *points = read_joint_waypoints(robot, table, unit)

        def name(text: object) -> str:
            return re.sub(r"\bpoint (\d+)", lambda i: table.locate(int(i[1]) + 1), str(text))

        try:
            path = cls(robot, start.target, *(ViaPoint(*point) for point in points))
        except InvalidInput as error:
            raise InvalidInput(name(error.argument), name(error.got), name(error.expected)) from None
        except NoSolution as error:
            raise NoSolution(name(error.reason), advice=error.advice) from None
        path.notes = warn_of_assumptions(file, table.notes)
        return path

    def with_coefficients(self, coefficients: Array) -> PointToPoint:
        """Return the path with other control points.

        Parameters
        ----------
        coefficients : (C, n) array
            Control points [rad, m].

        Returns
        -------
        PointToPoint
            The path.
        """
        return self._build(self.robot, self.spline, coefficients.copy(), self.vias, self.corners)

    @classmethod
    def _build(
        cls, robot: Robot, spline: ControlCurve, coefficients: Array, vias: tuple[Via, ...], corners: Array | None
    ) -> Self:
        """Return the path of a spline, which is not examined."""
        path = object.__new__(cls)
        path.robot, path.unit, path.vias, path.corners = robot, "m" if robot.prismatic.all() else "rad", vias, corners
        path.spline, path.coefficients = spline, coefficients
        return path

    def along(self, legs: Sequence[Array], inner: Array) -> PointToPoint:
        """Return the path near polylines in joint space.

        The control points are on the polylines, so the path stays in the convex hull of six at a time, and as near to their
        corners as the knots are dense.

        Parameters
        ----------
        legs : sequence of (k, n) arrays
            A polyline for each leg, from the start or a via point to the next one or the goal [rad, m]. A via point that is a
            pose may be passed in another configuration.
        inner : (m,) array
            Knots between start and goal [rad, or m], of the length along the polylines.

        Returns
        -------
        PointToPoint
            The path; it passes the via points within their tolerance only where the knots are dense.
        """
        corners = np.concatenate([legs[0][:1], *(leg[1:] for leg in legs)])
        s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
        at = s[np.cumsum([len(leg) - 1 for leg in legs])]
        spline = ControlCurve(float(s[-1]), 0, inner)
        ends = [leg[-1] for leg in legs[:-1]]
        vias = tuple(via._replace(s=float(x), q=q) for via, x, q in zip(self.vias, at[:-1], ends, strict=True))
        points = np.stack([np.interp(spline.greville, s, x) for x in corners.T], axis=1)
        return self._build(self.robot, spline, points, vias, corners)

    @property
    def end(self) -> float:
        """Length in joint space of the line through the points [rad, or m]."""
        return self.spline.end

    @property
    def breaks(self) -> Array:
        """Knots of the spline; the ends of a straight line."""
        return self.spline.breaks[[0, -1]] if self._is_straight else self.spline.breaks

    @cached_property
    def _is_straight(self) -> bool:
        """Whether the path is a straight line at a constant rate."""
        rates = self.spline.control_points(self.coefficients, 1)
        return bool(np.abs(rates - rates[0]).max() <= STRAIGHT_RATE)

    def configurations(self, robot: Robot, s: ArrayLike, order: int = 0) -> Array:
        """Return configurations at s, or their derivatives."""
        check_arm(robot, self.robot)
        return self.coordinates(np.asarray(s, dtype=np.float64))[:, order]

    @property
    def ranges(self) -> tuple[()]:
        """Nothing: the control points stay inside the joint limits."""
        return ()

    def coordinates(self, s: Array) -> Array:
        """Return the joints along the path.

        Parameters
        ----------
        s : (k,) array
            Path parameters [rad, or m].

        Returns
        -------
        (k, 4, n) array
            Configurations and their first three derivatives in s [rad, m].
        """
        return self.spline.basis(np.clip(s, 0.0, self.end)).combine(self.coefficients)

    @property
    def via_errors(self) -> Array:
        """Distance [m] and angle [rad] of the tool from each via point where the path passes it, (k, 2)."""
        q = self.coordinates(np.array([via.s for via in self.vias]))[:, 0]
        poses = np.array([via.pose for via in self.vias]).reshape(-1, 4, 4)
        return np.asarray(np.linalg.norm(se3.error(self.robot.fk(q), poses).reshape(-1, 2, 3), axis=2))

    def list_missed(self) -> list[Via]:
        """Return the via points that the path misses by more than their tolerance."""
        missed = []
        for via, (position, rotation) in zip(self.vias, self.via_errors, strict=True):
            most = via.tolerance
            exact = most is None and bool(np.abs(self.coordinates(np.array([via.s]))[0, 0] - via.q).max() <= MISSED)
            if not exact and (most is None or position > most.position or rotation > most.rotation):
                missed.append(via)
        return missed

    def _evaluate(self, x: Array, order: int) -> Array:
        joints = self.coordinates(x)
        if order == 0:
            return self.robot.fk(np.ascontiguousarray(joints[:, 0]))
        return tool_twists(self.robot, joints)[:, order - 1]

    def piece_bounds(self) -> Array:
        """Return bounds (k − 1, 2, 4) on the derivatives of position and rotation between the knots."""
        most, breaks = self.spline.derivative_bounds(self.coefficients, 4), self.breaks
        width = np.diff(breaks)
        if self._is_straight:
            most = most.max(axis=0, keepdims=True)
        s = breaks[:-1, None] + width[:, None] * np.linspace(0.0, 1.0, SPAN_SAMPLES + 1)
        return bound_tool_derivatives(self.robot, most, width, tool_twists(self.robot, self.coordinates(s.ravel())))

    def joint_bounds(self) -> Array:
        """Return bounds (k − 1, 4, n) on the derivatives of the joints between the knots, from the control points."""
        bounds = self.spline.derivative_bounds(self.coefficients, 4)[:, 1:]
        return np.asarray(bounds.max(axis=0, keepdims=True) if self._is_straight else bounds)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files, with the name and fingerprint of the arm."""
        vias = [
            {
                "s": via.s, "q": via.q.tolist(), "pose": via.pose.tolist(),
                "tolerance": None if via.tolerance is None else [via.tolerance.position, via.tolerance.rotation],
            }
            for via in self.vias
        ]  # fmt: skip
        return {
            "path": self.name, "robot": self.robot.name, "fingerprint": self.robot.fingerprint,
            "knots": self.spline.breaks.tolist(), "coefficients": self.coefficients.tolist(), "vias": vias,
            "corners": None if self.corners is None else self.corners.tolist(),
        }  # fmt: skip

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """Return the path that `to_dict` wrote, for the arm that it belongs to."""
        names = "robot", "fingerprint", "knots", "coefficients", "vias", "corners"
        name, fingerprint, knots, coefficients, vias, corners = fields(data, cls.name, *names)
        robot = check_recorded(robot, name, fingerprint)
        check_kind(vias, "vias", list, "a list of vias")
        spline, vias = ControlCurve.between(read_breaks(knots)), tuple(_read_via(via, robot.n) for via in vias)
        coefficients = read_numbers(coefficients, (spline.count, robot.n), "coefficients")
        if corners is not None:
            corners = read_numbers(corners, (len(np.atleast_1d(corners)), robot.n), "corners")
        path = cls._build(robot, spline, coefficients, vias, corners)
        if missed := path.list_missed():
            got = f"a path that misses the via point at s = {missed[0].s:.6g}"
            raise InvalidInput("coefficients", got, "one that passes it")
        return path


def _read_via(data: Any, n: int) -> Via:
    if not isinstance(data, Mapping) or set(data) != {"s", "q", "pose", "tolerance"}:
        raise InvalidInput("vias", repr(data)[:60], "mappings with s, q, pose and tolerance")
    tolerance = data["tolerance"]
    return Via(
        float(read_numbers(data["s"], (), "vias.s")), read_numbers(data["q"], (n,), "vias.q"),
        read_numbers(data["pose"], (4, 4), "vias.pose"),
        None if tolerance is None else Tolerance(*(float(x) for x in read_numbers(tolerance, (2,), "vias.tolerance"))),
    )  # fmt: skip


METHOD = PointToPoint
