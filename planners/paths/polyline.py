"""Straight segments through poses, with corners rounded within a tolerance: C³ in position and rotation."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.robot import Robot
from optik.check import real_array
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.tables import Names, read_table, warn_of_assumptions
from optik.types import Array, Flags, Indices
from planners.paths.base import PiecewisePath, fields
from planners.paths.poses import shortest_turn
from planners.paths.waypoints import check_waypoints, read_waypoints
from planners.trajectory.curve import bells

METRES_PER_RADIAN = 0.1
"""Length [m] that a rotation by 1 rad counts for, if a segment turns more than it moves: that of a gripper."""
SAME_POSE = 1e-9
"""Waypoints nearer than this [m and rad] to the previous one are the same pose."""
MERGED, SMALLEST = 0.25, np.array([1e-4, 1e-3])
"""A waypoint is merged with the previous one if it is nearer than this fraction of its tolerance, and nearer than 0.1 mm and
1 mrad, the repeatability of arms: a corner between them would nearly stop the tool."""
RETURN = 1e-4
"""Largest norm of the sum of the two directions of a corner that is a reversal, within 0.006°."""
MIDDLE = 5.0 / 64.0
"""∫f over half a corner: at its middle the path is 2h·5/64·|d₂ − d₁| from the waypoint."""


class Pieces(NamedTuple):
    """The m pieces between breaks; a straight piece is stored as a corner whose incoming rates are 0.

    p = base + d₂ b − d₁ a and R = exp(w₂ b) exp(−w₁ a) R_base, where a is the remaining part of the segment before
    the waypoint, and b the completed part of the one after it.
    """

    corner: Flags
    begin: Array
    width: Array
    position: Array
    rotation: Array
    d1: Array
    d2: Array
    w1: Array
    w2: Array


class Polyline(PiecewisePath):
    """Straight segments through poses; near each waypoint one segment is blended into the next.

    s counts a segment by its chord [m], or by 0.1 m per rad if it turns more than that; in radians if the whole path
    only turns. Along a segment of length L everything is at constant rate: dp/ds = d, ω = w. Around a
    waypoint, over 2h in s, the rate of the one segment goes down from 1 to 0 as 1 − f(u) and that of the next one up as
    f(u) = 10u³ − 15u⁴ + 6u⁵: positions of both motions are added, rotations composed. So the pose has continuous
    derivatives up to the third, and |dp/ds| ≤ 1.

    The tolerance bounds the distance from the path to the sharp polyline and from the polyline to the path. At u the path is
    at most min(F(u), F(1 − u))·2h·|d₂ − d₁| ≤ 2h·5/64·|d₂ − d₁| from a point of the sharp polyline (F = ∫f), which covers
    the whole sharp corner as u goes from 0 to 1, and is rotated against it by at most 2h·5/64·|w₂ − w₁| (the
    exponential map of SO(3) does not stretch). h is the largest that keeps both within the tolerance, and at most half of
    either segment. Waypoints that nearly repeat the previous one are first merged with it, well within their tolerance.

    A path that reverses its direction raises InvalidInput, since the tool has to stop there.

    Parameters
    ----------
    waypoints : (k, 4, 4) array
        T_base_tool, at least two different ones. The rotation from one to the next is the shortest one.
    blend : float or (k − 2,) array
        Largest distance of the path from each inner waypoint [m].
    blend_rotation : float or (k − 2,) array
        Largest rotation of the path against the sharp polyline there [rad].

    Attributes
    ----------
    waypoints : (m + 1, 4, 4) array
        The waypoints that the path passes.
    dropped : tuple of int
        Indices of merged waypoints: those within a quarter of their tolerance, 0.1 mm and 1 mrad of one that is kept (of
        the end: within half of the tolerance).
    corners : (m − 1,) array
        Path parameters of the inner waypoints [m, or rad].
    segments : int
        Number of segments between the given waypoints, merged ones included.

    Raises
    ------
    InvalidInput
        Fewer than two different poses, a turn within 1e-6 rad of 180°, a path that reverses its direction, or a tolerance
        that is not above 0: a sharp corner needs a stop, so make each line a part of a `planners.Program`.
    """

    name: ClassVar[str] = "polyline"
    notes: tuple[str, ...] = ()

    def __init__(self, waypoints: ArrayLike, *, blend: ArrayLike = 1e-3, blend_rotation: ArrayLike = 1e-2) -> None:
        self._given = check_waypoints(waypoints)
        self._blend = _check_tolerances(blend, "blend", "m", len(self._given) - 2)
        if self._blend.size and self._blend.min() > 1.0:
            warn_of_assumptions("blend", [f"{self._blend.min():g} m: are these millimetres?"])
        self._blend_rotation = _check_tolerances(blend_rotation, "blend_rotation", "rad", len(self._given) - 2)
        kept, room = _merge_waypoints(self._given, self._blend, self._blend_rotation)
        self.dropped = tuple(sorted(set(range(len(self._given))) - set(kept)))
        self.segments, self._kept = len(self._given) - 1, kept
        self.waypoints: Array = self._given[kept]
        chords, turns, length, only_turns = _measure_segments(self.waypoints, kept)
        self.turns_only, self.unit = only_turns, "rad" if only_turns else "m"
        ends = np.cumsum(length)
        self._end = float(ends[-1])
        self.corners: Array = ends[:-1]
        _check_returns(chords / length[:, None], turns / length[:, None], kept)
        inner = np.array(kept[1:-1], dtype=np.int64)
        half = _find_half_widths(chords, turns, length, *room[inner].T)
        self._pieces = _build_pieces(self.waypoints, chords, turns, length, half)
        self._breaks: Array = np.append(_find_begins(self._pieces, length, half), self._end)

    @classmethod
    def from_csv(
        cls, file: str | os.PathLike[str], *, orientation: ArrayLike | None = None, blend: float = 1e-3,
        blend_rotation: float = 1e-2, robot: Robot | None = None, unit: str | None = None, columns: Names = None,
        ignore: Names = None,
    ) -> Self:  # fmt: skip
        """Return the polyline through the waypoints of a table.

        The first line is a header. All lines have its separator: semicolons, tabs, commas or spaces. Decimal commas are read,
        too. The names identify the columns, in any order, in upper or lower case, with units such as ``x_mm`` or ``x [mm]``:

        - the position ``x,y,z`` [m];
        - the orientation, if any: a quaternion ``qx,qy,qz,qw``; ``roll,pitch,yaw`` [rad] with R = Rz(yaw) Ry(pitch) Rx(roll); a
          rotation vector ``rx,ry,rz`` [rad]; KUKA's ``A,B,C`` [deg], with x,y,z in millimetres; or a tool axis
          ``i,j,k`` of CAM files or surface normal ``nx,ny,nz`` of any length. It points away from the workpiece: the tool's z
          axis is opposite. Of all orientations with that axis, a waypoint has the one nearest to the waypoint before.

        Positions and orientations are those of the tool in the base frame. Empty lines and lines that begin with ``#`` are
        skipped. Assumptions are listed in the attribute ``notes`` of the result, and in an `AssumptionWarning`.

        Parameters
        ----------
        file : str or path
            The table.
        orientation : (3, 3) array, optional
            Rotation of the tool at all waypoints [1], for a file without an orientation. For a file with tool axes, the first
            waypoint has the orientation nearest to it.
        blend, blend_rotation : float
            As of `Polyline` [m, rad].
        robot : Robot, optional
            The arm: points beyond three times its reach are refused, because they are probably in millimetres.
        unit : {"m", "mm", "cm", "in"}, optional
            Unit of x,y,z, if the header has none.
        columns : str or sequence of str, optional
            Names of the columns of a file without a header, or new names of all columns: ``"x,y,z"``.
        ignore : str or sequence of str, optional
            Columns of the file that are left out.

        Returns
        -------
        Polyline
            Through all rows.

        Raises
        ------
        InvalidInput
            A file that cannot be read; unknown columns or an invalid value (the error names line and column); no
            ``orientation`` although the file needs one; points beyond 100 m; waypoints that do not form a polyline.
        """
        table = read_table(file, columns, ignore)
        path = cls(read_waypoints(table, orientation, robot, unit), blend=blend, blend_rotation=blend_rotation)
        path.notes = warn_of_assumptions(file, table.notes)
        return path

    @property
    def end(self) -> float:
        """Length of the sharp polyline [m, or rad]."""
        return self._end

    @property
    def breaks(self) -> Array:
        """Path parameters at which segments and rounded corners meet, both ends included."""
        return self._breaks

    def _evaluate(self, x: Array, order: int) -> Array:
        piece = np.searchsorted(self._breaks[1:-1], x, side="right")
        if order == 0:
            poses = np.zeros((x.size, 4, 4))
            _write_poses(self._pieces, piece, x, poses)
            return poses
        out = np.zeros((x.size, 6))
        _write_twists(self._pieces, piece, x, order, out)
        return out

    def piece_bounds(self) -> Array:
        """Return bounds (pieces, 2, 4) on the derivatives of position and rotation."""
        # With |w₂ − exp(w₂ b) w₁| = |w₂ − w₁| and |w₂ × exp(w₂ b) w₁| = |w₂ × w₁| the derivatives of ω are bounded term
        # by term, those of R by the Bell polynomials of the bounds on |ω|, |ω'|, |ω''|, |ω'''|.
        c = self._pieces
        rate = np.where(c.corner, 1.0 / c.width, 0.0)
        f1, f2, f3 = 1.875 * rate, 10.0 / np.sqrt(3.0) * rate**2, 60.0 * rate**3  # the greatest |f'|, |f''|, |f'''|
        bend = np.linalg.norm(c.d2 - c.d1, axis=1)
        speed = np.maximum(np.linalg.norm(c.d1, axis=1), np.linalg.norm(c.d2, axis=1))
        position = np.stack([speed, bend * f1, bend * f2, bend * f3], axis=1)
        n2 = np.linalg.norm(c.w2, axis=1)
        twist, cross = np.linalg.norm(c.w2 - c.w1, axis=1), np.linalg.norm(np.cross(c.w1, c.w2), axis=1)
        g1 = np.maximum(np.linalg.norm(c.w1, axis=1), n2)
        g2 = twist * f1 + cross / 4.0
        g3 = twist * f2 + 2.0 * f1 * cross + 4.0 / 27.0 * n2 * cross
        g4 = twist * f3 + 3.0 * (f2 + f1**2) * cross + 3.0 * f1 * n2 * cross + 27.0 / 256.0 * n2**2 * cross
        g2, g3, g4 = (np.where(c.corner, g, 0.0) for g in (g2, g3, g4))
        rotation = np.empty((g1.size, 5))
        bells(np.stack([np.zeros(g1.size), g1, g2, g3, g4], axis=1), rotation)
        return np.stack([position, rotation[:, 1:]], axis=1)

    def least_on_pieces(self, values: Array) -> Array:
        """Return values of the pieces: a rounded corner has the lesser value of its two segments."""
        kept = np.minimum.reduceat(values, self._kept[:-1])
        after = np.cumsum(self._pieces.corner)
        return np.minimum(kept[after], kept[np.where(self._pieces.corner, after - 1, after)])

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files."""
        return {
            "path": self.name, "waypoints": self._given.tolist(),
            "blend": self._blend.tolist(), "blend_rotation": self._blend_rotation.tolist(),
        }  # fmt: skip

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """Return the polyline that `to_dict` wrote."""
        waypoints, blend, rotation = fields(data, cls.name, "waypoints", "blend", "blend_rotation")
        return cls(waypoints, blend=blend, blend_rotation=rotation)


@compiled
def _blend_integral(u: float) -> float:
    """Return F(u) = ∫f from 0 to u: the length that a segment has covered at u, over 2h."""
    return u * u * u * u * (2.5 + u * (u - 3.0))


@compiled
def _write_poses(pieces: Pieces, piece: Indices, x: Array, poses: Array) -> None:
    """Write the poses (k, 4, 4) at x (k,), which are on the given pieces (k,)."""
    first, second, w = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for k in range(x.shape[0]):
        i, T = piece[k], poses[k]
        a, b = 0.0, x[k] - pieces.begin[i]
        if pieces.corner[i]:
            width = pieces.width[i]
            u = min(max(b / width, 0.0), 1.0)
            a, b = width * _blend_integral(1.0 - u), width * _blend_integral(u)
        for j in range(3):
            T[j, 3] = pieces.position[i, j] - a * pieces.d1[i, j] + b * pieces.d2[i, j]
            w[j] = -a * pieces.w1[i, j]
        T[3, 3] = 1.0
        se3.exp_rotation(w, first)
        for j in range(3):
            w[j] = b * pieces.w2[i, j]
        se3.exp_rotation(w, second)
        for j in range(3):
            for m in range(3):
                w[m] = second[j, 0] * first[0, m] + second[j, 1] * first[1, m] + second[j, 2] * first[2, m]
            for m in range(3):
                R = pieces.rotation[i]
                T[j, m] = w[0] * R[0, m] + w[1] * R[1, m] + w[2] * R[2, m]


@compiled
def _write_twists(pieces: Pieces, piece: Indices, x: Array, order: int, out: Array) -> None:
    """Write the twists (k, 6) at x (k,), which are on the given pieces (k,), or their first or second derivatives."""
    R, y, w = np.empty((3, 3)), np.empty(3), np.empty(3)
    for k in range(x.shape[0]):
        i = piece[k]
        d1, d2, w1, w2, width = pieces.d1[i], pieces.d2[i], pieces.w1[i], pieces.w2[i], pieces.width[i]
        if not pieces.corner[i]:
            if order == 1:
                out[k, :3], out[k, 3:] = d2, w2
            continue
        u = min(max((x[k] - pieces.begin[i]) / width, 0.0), 1.0)
        f, f1 = u * u * u * (10.0 + u * (6.0 * u - 15.0)), 30.0 * (u * (1.0 - u)) ** 2 / width
        f2, g = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / width**2, 1.0 - f
        # ω = f w₂ + (1 − f) y, where y = exp(w₂ b) w₁ turns with the segment after the waypoint: y' = f w₂×y
        for j in range(3):
            w[j] = width * _blend_integral(u) * w2[j]
        se3.exp_rotation(w, R)
        for j in range(3):
            y[j] = R[j, 0] * w1[0] + R[j, 1] * w1[1] + R[j, 2] * w1[2]
        for j in range(3):
            m, n = (j + 1) % 3, (j + 2) % 3
            side = w2[m] * y[n] - w2[n] * y[m]
            bent = w2[j] * (w2[0] * y[0] + w2[1] * y[1] + w2[2] * y[2]) - y[j] * (w2[0] ** 2 + w2[1] ** 2 + w2[2] ** 2)
            if order == 1:
                out[k, j], out[k, 3 + j] = d1[j] + f * (d2[j] - d1[j]), f * w2[j] + g * y[j]
            elif order == 2:
                out[k, j], out[k, 3 + j] = f1 * (d2[j] - d1[j]), f1 * (w2[j] - y[j]) + g * f * side
            else:
                out[k, j] = f2 * (d2[j] - d1[j])
                out[k, 3 + j] = f2 * (w2[j] - y[j]) + (1.0 - 3.0 * f) * f1 * side + g * f * f * bent


def _check_tolerances(value: Any, argument: str, unit: str, corners: int) -> Array:
    array = real_array(value, argument, f"a number [{unit}], or one for each of the {corners} inner waypoints")
    if array.ndim and array.shape != (corners,):
        allowed = f"a number, or one for each of the {corners} inner waypoints"
        raise InvalidInput(argument, f"shape {array.shape}", allowed)
    if not ((array > 0.0) & (array < np.inf)).all():
        stop = "a sharp corner needs a stop, so make each line a part of a `planners.Program`"
        got = np.array2string(array, precision=6, threshold=6)
        raise InvalidInput(argument, got, f"finite numbers above 0 [{unit}]; {stop}")
    return np.full(corners, array) if not array.ndim else array.copy()


def _merge_waypoints(waypoints: Array, blend: Array, blend_rotation: Array) -> tuple[list[int], Array]:
    """Return the indices of the waypoints that are kept, and the tolerance (k, 2) left for the corner at each."""
    # An inner waypoint near the last one kept is merged with it, one near the end with the end. So every merged waypoint
    # is within 2 `MERGED` of its tolerance of one that is kept. The corner there uses the remaining tolerance.
    last = len(waypoints) - 1
    room = np.vstack([np.full(2, np.inf), np.stack([blend, blend_rotation], axis=1), np.full(2, np.inf)])
    near = np.clip(MERGED * room, SAME_POSE, SMALLEST)
    near[last] = SAME_POSE
    kept = [0]
    for i in range(1, last + 1):
        if not _are_near(waypoints[kept[-1]], waypoints[i], near[i]):
            kept.append(i)
        elif not _are_near(waypoints[kept[-1]], waypoints[i], np.full(2, SAME_POSE)):
            room[kept[-1]] = np.minimum(room[kept[-1]], (1.0 - 2.0 * MERGED) * room[i])
    while len(kept) > 2 and kept[-1] == last and _are_near(waypoints[kept[-2]], waypoints[last], near[kept[-2]]):
        del kept[-2]
    if len(kept) < 2:
        raise InvalidInput("waypoints", f"{len(waypoints)} equal poses", "at least two poses that differ")
    return kept, room


def _are_near(a: Array, b: Array, near: Array) -> bool:
    """Return whether two poses differ by at most a distance and an angle (2,)."""
    return bool((np.linalg.norm(se3.error(a, b).reshape(2, 3), axis=1) <= near).all())


def _measure_segments(waypoints: Array, kept: list[int]) -> tuple[Array, Array, Array, bool]:
    """Return displacements, rotations and lengths in s of the segments, and whether the tool only turns."""
    chords = np.diff(waypoints[:, :3, 3], axis=0)
    pairs = zip(waypoints[:-1], waypoints[1:], kept[1:], strict=True)
    turns = np.stack([shortest_turn(a, b, f"waypoints[{i}]") for a, b, i in pairs])
    moved, turned = np.linalg.norm(chords, axis=1), np.linalg.norm(turns, axis=1)
    only_turns = bool(moved.sum() <= 1e-6 and moved.sum() < turned.sum())  # as `Line`
    return chords, turns, np.maximum(moved, turned if only_turns else METRES_PER_RADIAN * turned), only_turns


def _check_returns(d: Array, w: Array, kept: list[int]) -> None:
    """Raise InvalidInput for a corner in whose middle the tool stops: its velocity there is half of d₁ + d₂ and w₁ + w₂."""
    back = _find_returns(d, w)
    if back.size:
        expected = "a corner without a stop; planners.Program.of(waypoints) stops there"
        raise InvalidInput(f"waypoints[{kept[back[0] + 1]}]", "a reversal of the path", expected)


def _find_returns(d: Array, w: Array) -> Indices:
    """Return the indices of the corners in whose middle the tool stops."""
    left = [np.linalg.norm(x[1:] + x[:-1], axis=1) for x in (d, METRES_PER_RADIAN * w)]
    return np.flatnonzero(np.maximum(*left) < RETURN)


def find_reversals(waypoints: Array, blend: float, blend_rotation: float) -> list[int]:
    """Return the indices of the waypoints at which a polyline with these tolerances reverses its direction."""
    poses = check_waypoints(waypoints)
    corners = len(poses) - 2
    distance = _check_tolerances(blend, "blend", "m", corners)
    kept, _ = _merge_waypoints(poses, distance, _check_tolerances(blend_rotation, "blend_rotation", "rad", corners))
    chords, turns, length, _ = _measure_segments(poses[kept], kept)
    return [kept[i + 1] for i in _find_returns(chords / length[:, None], turns / length[:, None])]


def _find_half_widths(chords: Array, turns: Array, length: Array, blend: Array, blend_rotation: Array) -> Array:
    """Return half the width h (corners,) of each corner in s."""
    room = 0.5 * np.minimum(length[:-1], length[1:])
    for parts, tolerance in ((chords, blend), (turns, blend_rotation)):
        bend = np.linalg.norm(np.diff(parts / length[:, None], axis=0), axis=1)
        with np.errstate(divide="ignore"):
            room = np.minimum(room, tolerance / (2.0 * MIDDLE * bend))
    return np.asarray(room)


def _build_pieces(waypoints: Array, chords: Array, turns: Array, length: Array, half: Array) -> Pieces:
    """Return the segments and corners; a segment that its corners cover completely has no piece."""
    d, w = chords / length[:, None], turns / length[:, None]
    starts = np.concatenate([[0.0], np.cumsum(length)[:-1]])
    left = _have_straight_part(length, half)
    zero = np.zeros(3)
    rows: list[Sequence[Any]] = []
    for i in range(len(length)):
        p, R = waypoints[i, :3, 3], waypoints[i, :3, :3]
        if i:
            h = half[i - 1]
            rows.append((True, starts[i] - h, 2.0 * h, p, R, d[i - 1], d[i], w[i - 1], w[i]))
        if left[i]:
            rows.append((False, starts[i], 1.0, p, R, zero, d[i], zero, w[i]))
    return Pieces(*(np.array(column) for column in zip(*rows, strict=True)))


def _have_straight_part(length: Array, half: Array) -> Flags:
    """Return which segments (m,) have a straight part between their corners."""
    taken = np.concatenate([[0.0], half]) + np.concatenate([half, [0.0]])
    return np.asarray(length - taken > 1e-12 * length)


def _find_begins(pieces: Pieces, length: Array, half: Array) -> Array:
    """Return s at which each piece begins: a straight one at the end of the corner before it."""
    after = np.concatenate([[0.0], np.cumsum(length)[:-1] + half])
    straight = ~pieces.corner
    begin = pieces.begin.copy()
    begin[straight] = after[_have_straight_part(length, half)]
    return begin


METHOD = Polyline
