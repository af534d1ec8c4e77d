"""The time-optimal programme along a path with free coefficients: its limits and their derivatives at any coefficients."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.dynamics import Bodies
from optik.types import Array, Flags, Indices
from planners.choice.columns import Local, Scales, Window, fill, fill_further, joint_changes, tool_changes, trace_path
from planners.choice.torques import torque_changes
from planners.limits import ALL_LIMITS, PathPoints, kind_of
from planners.limits.base import middle_and_half, sides
from planners.limits.kinds import torque_rate_rows, torque_rows
from planners.limits.motion_limits import tool_limits_at
from planners.paths.base import Path
from planners.paths.control_curve import DEGREE, Basis
from planners.paths.screws import move_along
from planners.timing.interior_point.newton import Border, Problem, make_border
from planners.timing.interior_point.programme import SHORTEST_INTERVAL, TimingProblem

SPEED_PEAK = 1.0 / 3.0
"""Fraction of an interval after which the speed of a motion peaks whose acceleration reverses inside it."""
LEAST_RANGE = 1e-6
"""Least slack [rad, m, as the limit] that a static part leaves of a limit: less makes the limit unattainable."""

NO_SPEED_LIMIT = 1e6
"""Bound on the speed in units of the problem: speeds have rows here, since the bound of all joints together has kinks."""
DIFFERENCE = 1e-7
"""Step of the differences of rows, relative to the largest joint value or derivative above 1."""
SURE_DIRECTION = 0.2
"""Fraction of the largest |q'| of the initial path above which a joint's direction of motion is taken as given."""


def is_known(limit: str) -> bool:
    """Return whether the choice of a shape knows a further limit: one on the speed of a part of the arm."""
    kind = kind_of(limit)
    return kind.order == 1 and kind.subject is not None


class ToolCoordinates(NamedTuple):
    """Coordinates of a tool: screws (d, 6), the given poses and twists at the grid points, rows (r, n) of null-space ones."""

    screws: Array
    poses: Array
    twists: Array
    rows: Array


class ChoicePlace(NamedTuple):
    """Joints at the grid points for coefficients p: path (4, K + 1, n), points for limits, fields of the coordinates."""

    p: Array
    path: Array
    points: PathPoints
    fields: Array


class Statics(ABC):
    """Further limits on the path alone, in rows of the grid points.

    A constraint value is a value over its limit, at most 1.
    """

    count: int
    bends: int

    @abstractmethod
    def values(self, place: ChoicePlace) -> Array:
        """Return the values (K + 1, count); 0 or less where there is no limit."""

    @abstractmethod
    def write(self, place: ChoicePlace, joints: Array, y: Array, columns: Array, bends: Array, begin: Indices) -> None:
        """Write the derivatives (K + 1, count, W) in the coefficients from the first one of each window on.

        joints (K + 1, 4, D, n) are those of the joints in the coordinates, empty if these are the joints. The sum of the
        squares of bends (K + 1, bends, W) is the curvature, with multipliers y (K + 1, count).
        """

    def allows(self, place: ChoicePlace) -> bool:
        """Return whether a step may end here."""
        return True

    def renew(self, place: ChoicePlace) -> tuple[Indices, Indices]:
        """Choose what the rows limit from here on; return the grid points and rows that changed."""
        return np.empty(0, np.int64), np.empty(0, np.int64)


class LinePath(NamedTuple):
    """Robot and path, as limits read a joint path; configurations are given with the points."""

    robot: Robot
    path: Path
    end: float

    def __call__(self, x: object, order: int = 0) -> Array:
        """Return nothing: all derivatives are given with the points."""
        raise AssertionError(f"derivative {order} was not given at {x}")


class FreeProgramme:
    """Limits along a path q(s, p), at the grid points of a programme on the path's initial coefficients.

    Parameters
    ----------
    given : TimingProblem
        Programme on the initial path: its grid, initial guess and units.
    basis : Basis
        Basis functions at its grid points.
    free : (P,) array of bool
        Whether a coefficient is free, of D for each control point.
    tool : ToolCoordinates, optional
        Coordinates of the tool; without them the coefficients are those of the joints.
    *statics : Statics
        Further limits on the configurations.
    """

    def __init__(
        self, given: TimingProblem, basis: Basis, free: Flags, D: int, tool: ToolCoordinates | None, *statics: Statics
    ) -> None:  # fmt: skip
        robot, self.limits, self.s = given.joint_path.robot, given.limits, given.s
        self.given, self.basis, self.D, self.tool, self.statics = given, basis, D, tool, statics
        self.robot, self.line = robot, LinePath(robot, given.joint_path.path, float(given.s[-1]))
        self.window = Window(basis.values, basis.first.astype(np.int64), np.ascontiguousarray(free))
        self.n, self.K, self.bounds = robot.n, given.s.size - 1, given.limits.bounds(robot.n)
        # of further limits it has columns for speeds of bodies; the timing of the chosen path respects all of them
        self.further = tuple(name for name in given.limits.extra or () if is_known(name))
        self.has = {name: bool(np.isfinite(self.bounds[name]).any()) for name in ALL_LIMITS}
        length, time = given.units
        self.v1, self.time = length / time, np.array([length / time, length / time**2, length / time**3])
        self.tool_limits = tool_limits_at(given.limits, given.joint_path.path, given.s)
        first, K = self.window.first, self.K
        self.begin, self.stay = first * D, np.empty(K + 1, np.int64)
        self.stay[1:], self.stay[0] = (first[1:] + DEGREE + 1) * D, 0
        jump = int(np.diff(first).max(initial=0))
        self.width = (DEGREE + 1 + jump) * D
        self.scales, self.offset, self.torque_offset = self._make_scales(given)
        counts = self.scales.counts
        self.rows = int(counts.sum() - counts[4] + bin(counts[4]).count("1"))
        self.speeds = int(counts[0] + counts[1] + counts[7])
        self.least, self.top = SHORTEST_INTERVAL * given.problem.tau, np.full(K + 1, NO_SPEED_LIMIT)

    # ------------------------------------------------------------ configurations

    def place(self, p: Array, near: Array) -> ChoicePlace | None:
        """Return the joints for coefficients p (C, D), by Newton's method from others (4, K + 1, n); None if it fails."""
        f = self.basis.combine(p)
        fields = np.empty((0, 0, 4, 6))
        if self.tool is None:
            path = np.ascontiguousarray(np.swapaxes(f, 0, 1))
        else:
            d, K = len(self.tool.screws), self.K
            poses, twists, fields = self.tool.poses.copy(), self.tool.twists.copy(), np.empty((K + 1, d, 4, 6))
            move_along(self.tool.screws, np.ascontiguousarray(f[:, :, :d]), poses, twists, fields)
            rows = np.zeros((K + 1, 4, *self.tool.rows.shape))
            rows[:, 0] = self.tool.rows
            q = np.ascontiguousarray(np.swapaxes(near, 0, 1))
            if not trace_path(self.robot.chain, poses, twists, rows, np.ascontiguousarray(f[:, :, d:]), q):
                return None
            path = np.ascontiguousarray(np.swapaxes(q, 0, 1))
        points = PathPoints(self.line, self.s, (path[0], path[1], path[2], path[3]))
        return ChoicePlace(p, path, points, fields)

    # ------------------------------------------------------------ constraint values

    def _make_scales(self, given: TimingProblem) -> tuple[Scales, Array, Array]:
        """Return the factors of the limits; the offsets of accelerations (n,), and those of torques (L, K + 1, n)."""
        robot, n, K, bounds = self.robot, self.n, self.K, self.bounds
        middle, half = middle_and_half(*sides(bounds["acceleration"]))
        loads = robot.loads if self.has["torque"] or self.has["torque_rate"] else ()
        torque, offset = np.zeros((len(loads), K + 1, n)), np.zeros((len(loads), K + 1, n))
        q1 = given.joint_path(given.s, 1)
        sure = np.abs(q1) > SURE_DIRECTION * np.abs(q1).max()
        for load, out, centre in zip(loads, torque, offset, strict=True):
            least, most = sides(bounds["torque"])
            # Coulomb friction may have either sign where another path may reverse a joint.
            least = least - load.coulomb * np.where(sure & (q1 > 0.0), 1.0, -1.0)
            most = most - load.coulomb * np.where(sure & (q1 < 0.0), -1.0, 1.0)
            centre[:], width = middle_and_half(least, most)
            out[:] = 2.0 / np.maximum(2.0 * width, LEAST_RANGE)
        with np.errstate(divide="ignore"):
            rate = np.tile(1.0 / bounds["torque_rate"], (len(loads) if self.has["torque_rate"] else 0, 1))
            tool = 1.0 / self.tool_limits**2
        lower, upper = robot.limits.lower, robot.limits.upper
        ranged = self.tool is not None and np.isfinite(upper - lower).any()
        span = 2.0 / np.maximum(upper - lower, LEAST_RANGE)
        loaded = self.has["torque"] or self.has["torque_rate"]
        tools: Flags = np.asarray(np.isfinite(self.tool_limits).any(axis=0))
        further = self._further(np.stack([given.joint_path(given.s, order) for order in range(4)])).shape[1]
        counts = [
            n * self.has["velocity"], n * (loaded and self.has["velocity"]), n * self.has["acceleration"],
            n * len(loads) * self.has["torque"], int(tools[0]) + 2 * int(tools[1]), n * int(ranged),
            sum(one.count for one in self.statics), further,
        ]  # fmt: skip
        peak = np.append(SPEED_PEAK * given.problem.tau * given.units[1], 0.0)
        viscous = np.array([load.viscous for load in loads]).reshape(-1, n)
        scales = Scales(
            np.zeros((K + 1, n)), 1.0 / half, 1.0 / bounds["jerk"], torque, rate, viscous, tool, span, peak, self.time,
            np.array(counts, np.int64),
        )  # fmt: skip
        return scales, middle / half, offset

    def _further(self, path: Array) -> Array:
        """Return the rows (K + 1, c) of further speeds over their limits, per unit of ṡ, for joints (4, K + 1, n)."""
        at = PathPoints(self.line, self.s, (path[0], path[1], path[2], path[3]))
        rows = [self.limits.rows(name, at)[..., 0] for name in self.further]
        return np.concatenate(rows, axis=1) if rows else np.empty((self.K + 1, 0))

    def _further_changes(self, path: Array) -> Array:
        """Return the derivatives (K + 1, c, n, 2) of these rows in q and q', by differences."""
        here, beside = self._further(path), path.copy()
        out = np.empty((*here.shape, self.n, 2))
        for order in range(2):
            h = DIFFERENCE * max(float(np.abs(path[order]).max()), 1.0)
            for j in range(self.n):
                beside[order, :, j] += h
                out[:, :, j, order] = (self._further(beside) - here) / h
                beside[order, :, j] = path[order, :, j]
        return out

    def problem(self, place: ChoicePlace) -> Problem:
        """Return the problem whose rows are those of the joints' path."""
        fixed, (q, q1, q2, q3), scales = self.given.problem, place.path, self.scales
        n, counts, (v, a, j) = self.n, scales.counts, self.time
        if counts[0]:
            low, high = sides(self.bounds["velocity"])
            scales.speed[:] = 1.0 / np.where(q1 < 0.0, -low, high)
        node, row = np.zeros((self.K + 1, self.rows, 4)), 0
        for part in range(2):
            if counts[part]:
                node[:, row : row + n, 2] = q1 * scales.speed * v
                if part:
                    node[:, row : row + n, 0] = q1 * scales.speed * (scales.peak * a)[:, None]
                row += n
        if counts[7]:
            node[:, row : row + counts[7], 2] = self._further(place.path) * v
            row += counts[7]
        if counts[2]:
            at = node[:, row : row + n]
            at[..., 0], at[..., 1] = q1 * (scales.acceleration * a), q2 * (scales.acceleration * v * v)
            at[..., 3] = -self.offset
            row += n
        for load in range(counts[3] // n):
            values = torque_rows(place.points, self.robot.loads[load]) * np.array([a, v * v, v, 1.0])
            values[..., 3] -= self.torque_offset[load]
            node[:, row : row + n] = values * scales.torque[load][..., None]
            row += n
        if counts[4]:
            twist = self.robot.jacobian(q) @ q1[..., None]
            for part in range(2):
                if counts[4] >> part & 1:
                    speed = twist[:, 3 * part : 3 * part + 3, 0]
                    node[:, row, 1] = (speed * speed).sum(axis=1) * scales.tool[:, part] * v * v
                    row += 1
        if counts[5]:
            node[:, row : row + n, 3] = (q - self.robot.limits.middle) * scales.range
            row += n
        for one in self.statics:
            node[:, row : row + one.count, 3] = one.values(place)
            row += one.count
        edge = np.zeros((self.K, 2, n * (1 + len(scales.rate)), 6))
        values = np.zeros((self.K + 1, n, 6))
        values[..., 0], values[..., 2] = q1 * (scales.jerk * j), q3 * (scales.jerk * v**3)
        values[..., 1] = q2 * (3.0 * scales.jerk * v * a)
        edge[:, 0, :n], edge[:, 1, :n] = values[:-1], values[1:]
        for load, factor in enumerate(scales.rate):
            values = torque_rate_rows(place.points, self.robot.loads[load]) * factor[:, None]
            values = values * np.array([j, v * a, v**3, v, a, v * v])
            block = slice(n * (1 + load), n * (2 + load))
            edge[:, 0, block], edge[:, 1, block] = values[:-1], values[1:]
        return Problem(fixed.ds, fixed.tau, self.least, self.top, node, edge, fixed.goal)

    def make_border(self) -> Border:
        """Return a border for the columns of this programme."""
        edges = 2 * self.n * (1 + len(self.scales.rate))
        columns, cross = np.zeros((self.K + 1, self.rows + edges, self.width)), np.zeros((self.K, 5, self.width))
        bends = np.zeros((self.K + 1, sum(one.bends for one in self.statics), self.width))
        return make_border(columns, cross, bends, self.begin, self.stay, np.zeros((self.window.free.size, self.D)))

    def fill(self, place: ChoicePlace, z: Array, y: Array, border: Border) -> None:
        """Write the derivatives of the constraint values in the coefficients, with multipliers y (K + 1, m + 2 e)."""
        K, n, scales, chain = self.K, self.n, self.scales, self.robot.chain
        joints = np.empty((0, 4, self.D, n))
        if self.tool is not None:
            joints = np.empty((K + 1, 4, self.D, n))
            joint_changes(chain, self.tool.rows, place.fields, place.path, joints)
        torques = np.empty((len(scales.viscous), K + 1, 6, n, n, 4))
        for load, out in zip(self.robot.loads if len(torques) else (), torques, strict=True):
            write_torque_changes(self.robot, load.bodies, place.path, out)
        twist, tool = np.empty((0, 6)), np.empty((0, 6, n, 2))
        if scales.counts[4]:
            twist, tool = np.empty((K + 1, 6)), np.empty((K + 1, 6, n, 2))
            tool_changes(chain, place.path, twist, tool)
        local = Local(torques, twist, tool, joints)
        fill(z, y, scales, local, self.window, self.D, border.columns, border.cross)
        if self.further:
            changes = self._further_changes(place.path)
            fill_further(z, y, scales, local, changes, self.window, self.D, border.columns, border.cross)
        row, bend = self.rows - sum(one.count for one in self.statics), 0
        for one in self.statics:
            rows, bends = slice(row, row + one.count), border.bends[:, bend : bend + one.bends]
            one.write(place, joints, y[:, rows], border.columns[:, rows], bends, self.begin)
            row, bend = row + one.count, bend + one.bends

    def allows(self, place: ChoicePlace) -> bool:
        """Return whether a step may end at a place."""
        return all(one.allows(place) for one in self.statics)

    def renew(self, place: ChoicePlace) -> tuple[Indices, Indices]:
        """Choose anew what further limits limit; return the grid points and rows that changed."""
        row, none = self.rows - sum(one.count for one in self.statics), np.empty(0, np.int64)
        points, rows = [none], [none]
        for one in self.statics:
            k, i = one.renew(place)
            points.append(k)
            rows.append(i + row)
            row += one.count
        return np.concatenate(points), np.concatenate(rows)

    def gather(self, y: Array, border: Border) -> Array:
        """Return Σ y ∂c/∂p (P,) over all constraint values, from the columns of a border."""
        part = np.einsum("kr,krw->kw", y[:, : self.rows], border.columns[:, : self.rows])
        part[:-1] += np.einsum("kr,krw->kw", y[:-1, self.rows :], border.columns[:-1, self.rows :])
        total = np.zeros(self.window.free.size + self.width)
        np.add.at(total, self.begin[:, None] + np.arange(self.width), part)
        return total[: self.window.free.size]


def write_torque_changes(robot: Robot, bodies: Bodies, path: Array, out: Array) -> None:
    """Write what `torque_changes` does for the joints of an arm, which the axes of its chain may follow."""
    follow = robot.linkage
    if follow is None:
        torque_changes(robot.chain, bodies, path, out)
        return
    axes, M = np.stack([follow.spread(q, order) for order, q in enumerate(path)]), follow.matrix
    each = np.empty((*out.shape[:2], len(M), len(M), 4))
    torque_changes(robot.axes.chain, bodies, axes, each)
    out[:] = np.einsum("kcijo,im,jn->kcmno", each, M, M)
