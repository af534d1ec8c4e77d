"""Kinds of limits: on derivatives of every joint, on torques and on the tool's speeds; and their registry by name."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from optik import dynamics
from optik.arm.inertia import Load
from optik.arm.limits import check_positive
from optik.arm.plain import read_numbers
from optik.arm.robot import Robot
from optik.errors import InvalidInput, UnknownName
from optik.plugins.files import is_path
from optik.registry import build_method, find_described, names
from optik.types import Array, Flags
from planners.limits.base import Limit, middle_and_half, ratio_to_limit, scale_of, sides, symmetric_limit
from planners.limits.inputs import Extreme, Gears, LimitedMotion, PathPoints, ToolExtreme
from planners.limits.member import MemberLimit
from planners.paths.base import Path
from planners.trajectory import Extrema
from planners.trajectory.curve import chain_rows


class DerivativeLimit(Limit):
    """A limit on a time derivative of every joint, judged by the exact extrema of the polynomials inside the pieces.

    The peak value is infinite where a lower derivative is discontinuous.
    """

    def rows(self, at: PathPoints, limit: Array) -> Array:
        """Return the rows at points of a joint path."""
        rows = chain_rows([at.q(order) for order in range(1, self.order + 1)])
        if limit.ndim == 1:
            return rows / limit[:, None]
        if self.order == 1:  # ṡ ≥ 0: the sign of q' selects the side, and the value keeps its sign
            lower, upper = sides(limit)
            return np.asarray(rows / np.where(rows < 0.0, -lower[:, None], upper[:, None]))
        return center_rows(np.concatenate([rows, np.zeros_like(rows)], axis=2), limit)

    def judge(self, motion: LimitedMotion, limit: Array) -> Extreme:
        """Return the peak value of a motion, its ratio to the limit, and its time."""
        extrema = motion.trajectory.extrema(self.order)
        if limit.ndim == 1:
            ratio = np.where(np.isfinite(limit), extrema.worst / limit, np.nan)
            extreme = Extreme(extrema.worst, ratio, extrema.t_worst)
        else:
            extreme = _nearest_side(extrema, limit)
        for order in range(self.order):
            if motion.jumps[order].any():
                extreme = _infinite_at_jumps(motion, order, extreme, motion.jumps[order], limit)
        return extreme

    def piece_ratios(self, motion: LimitedMotion, limit: Array) -> Array:
        """Return the ratios on each piece of a motion."""
        if limit.ndim == 1:
            return motion.trajectory.piece_worst(self.order) / limit
        return np.maximum(*(ratio_to_limit(value, limit) for value in motion.trajectory.piece_range(self.order)))

    def stretch_factor(self, motion: LimitedMotion, limit: Array) -> float:
        """Return the least factor by which a motion is stretched in time to respect the limit."""
        return scale_of(float(self.piece_ratios(motion, limit).max()), self.order)


def center_rows(rows: Array, limit: Array) -> Array:
    """Return rows over a limit with two sides; the limit is respected where |rows · monomials| ≤ 1."""
    middle, half = middle_and_half(*sides(limit))
    out: Array = rows / half[:, None]
    out[..., 3] -= middle / half
    return out


def _nearest_side(extrema: Extrema, limit: Array) -> Extreme:
    """Return the least or the greatest value of each joint, whichever has the larger ratio to its side of the limit."""
    free = np.isinf(limit[0])
    lower, upper = np.where(free, -1.0, limit[0]), np.where(free, 1.0, limit[1])
    below, above = extrema.least / lower, extrema.greatest / upper
    down = below > above
    value, time = np.where(down, -extrema.least, extrema.greatest), np.where(down, extrema.t_least, extrema.t_greatest)
    return Extreme(value, np.where(free, np.nan, np.maximum(below, above)), time)


def _infinite_at_jumps(motion: LimitedMotion, order: int, extreme: Extreme, jumps: Flags, limit: Array) -> Extreme:
    """Return an extreme with infinite values at the largest discontinuity of this order of each joint that has one."""
    size = np.where(jumps, np.abs(motion.steps(order)), 0.0)
    jumping = jumps.any(axis=0)
    when = motion.trajectory.knots[size.argmax(axis=0)]
    infinite = np.where(np.isfinite(symmetric_limit(limit)), np.inf, np.nan)
    return Extreme(
        np.where(jumping, np.inf, extreme.value),
        np.where(jumping, infinite, extreme.ratio),
        np.where(jumping, when, extreme.time),
    )


class Velocity(DerivativeLimit):
    """Velocity limit of each joint."""

    name: ClassVar[str] = "velocity"
    units: ClassVar[tuple[str, str]] = ("rad/s", "m/s")
    order: ClassVar[int] = 1
    sided: ClassVar[bool] = True


class Acceleration(DerivativeLimit):
    """Acceleration limit of each joint."""

    name: ClassVar[str] = "acceleration"
    units: ClassVar[tuple[str, str]] = ("rad/s²", "m/s²")
    order: ClassVar[int] = 2
    sided: ClassVar[bool] = True


class Jerk(DerivativeLimit):
    """Jerk limit of each joint."""

    name: ClassVar[str] = "jerk"
    units: ClassVar[tuple[str, str]] = ("rad/s³", "m/s³")
    order: ClassVar[int] = 3


class LoadedLimit(Limit):
    """A limit on the joint torques, or on their rates. It is not evaluated if no joint has a finite limit.

    A payload given as an interval is two loads, the lightest and the heaviest. The torque is affine in the payload's mass, so
    one of the two has the peak value.
    """

    homogeneous: ClassVar[bool] = False
    rate: ClassVar[bool]
    """Whether the limit is on the rates of the torques, and not on the torques."""
    columns: ClassVar[int]
    """Number of columns of the rows: the full set of monomials of the limit's order."""

    def rows(self, at: PathPoints, limit: Any) -> Array:
        """Return the rows at points of a joint path."""
        if not self.is_given(limit):
            return np.zeros((at.s.size, 1, self.columns))
        each = [self._rows_of(at, limit, load) for load in at.joint_path.robot.loads]
        return each[0] if len(each) == 1 else np.concatenate(each, axis=1)

    @abstractmethod
    def _rows_of(self, at: PathPoints, limit: Any, load: Load) -> Array:
        """Return the rows (k, n, columns) of one load."""

    def _pair(self, limit: Any) -> Array:
        """Return the lower and the upper limits (2, n)."""
        return np.stack(sides(limit))

    def _gears(self, robot: Robot, limit: Any) -> Gears | None:
        """Return the motors whose torques are limited; None if they are those of the joints."""
        return None

    def judge(self, motion: LimitedMotion, limit: Any) -> Extreme:
        """Return the peak value of a motion, its ratio to the limit, and its time."""
        lower, upper = pair = self._pair(limit)
        if not self.is_given(limit):
            return Extreme(*np.full((3, upper.size), np.nan))
        proved = motion.torque_ratios(pair, rate=self.rate, gears=self._gears(motion.robot, limit))
        limited = np.isfinite(upper)
        value = proved.ratio * np.where(limited, np.where(proved.upper, upper, -lower), 1.0)
        extreme = Extreme(value, np.where(limited, proved.ratio, np.nan), proved.time)
        jumping = motion.jumps[: self.order].any(axis=(0, 2))
        if not jumping.any():
            return extreme
        infinite = np.full(upper.size, np.inf)
        when = np.full(upper.size, motion.trajectory.knots[jumping.argmax()])
        return Extreme(infinite, np.where(limited, infinite, np.nan), when)

    def piece_ratios(self, motion: LimitedMotion, limit: Any) -> Array:
        """Return the ratios on each piece of a motion."""
        pair = self._pair(limit)
        if not self.is_given(limit):
            return np.zeros((motion.trajectory.knots.size - 1, pair.shape[1]))
        return motion.torque_piece_ratios(pair, rate=self.rate, gears=self._gears(motion.robot, limit))

    def stretch_factor(self, motion: LimitedMotion, limit: Any) -> float:
        """Return the least factor by which a motion is stretched in time to respect the limit."""
        if not self.is_given(limit):
            return 0.0
        return motion.torque_stretch(self._pair(limit), rate=self.rate, gears=self._gears(motion.robot, limit))


def torque_rows(at: PathPoints, load: Load) -> Array:
    """Return the rows of the torques, without Coulomb friction: τ = p s̈ + c ṡ² + f ṡ + g.

    p = M q', c = M q'' + C(q, q') q', f is the viscous friction times q', and g the torque of gravity.
    """
    found = _coefficients(at, load)
    return np.stack([found[:, 0], found[:, 1], load.viscous * at.q(1), found[:, 2]], axis=-1)


def torque_rate_rows(at: PathPoints, load: Load) -> Array:
    """Return the rows of the torque rates, without Coulomb friction: τ̇ = p s⃛ + d ṡ s̈ + c' ṡ³ + g' ṡ + b (q' s̈ + q'' ṡ²).

    d = p' + 2 c, and b is the viscous friction; p, c and g are those of `torque_rows`.
    """
    found = _coefficients(at, load)
    friction = (load.viscous * at.q(1), load.viscous * at.q(2))
    return np.stack([found[:, 0], found[:, 3], found[:, 4], found[:, 5], *friction], axis=-1)


def _coefficients(at: PathPoints, load: Load) -> Array:
    """Return the coefficients (k, 6, n) of `optik.dynamics.path_torques` at the points, computed once for each load."""
    kept = at.torques.get(id(load))
    if kept is None:
        path = np.stack([at.q(order) for order in range(4)])
        kept = np.empty((path.shape[1], 6, path.shape[2]))
        dynamics.path_torques(at.joint_path.robot.chain, load.bodies, path, kept)
        at.torques[id(load)] = kept
    return kept


STANDING_SHARE = 1e-9
"""Fraction of the largest |q'| of all joints below which a joint is at rest: it is rounding error of the path."""


class Torque(LoadedLimit):
    """Torque limit of each joint; the torque includes friction.

    Coulomb friction is f sign(q̇). Where a joint rests or reverses, it is the least favourable value in [−f, f].
    """

    name: ClassVar[str] = "torque"
    units: ClassVar[tuple[str, str]] = ("N·m", "N")
    order: ClassVar[int] = 2
    sided: ClassVar[bool] = True
    rate: ClassVar[bool] = False
    columns: ClassVar[int] = 4

    def _rows_of(self, at: PathPoints, limit: Array, load: Load) -> Array:
        lower, upper = sides(limit)
        free = ~np.isfinite(upper - lower)
        lower, upper = np.where(free, -1.0, lower), np.where(free, 1.0, upper)
        sign, still = _senses(at)
        rows = torque_rows(at, load).copy()
        rows[:, :, 3] += load.coulomb * sign - 0.5 * (lower + upper)
        half = 0.5 * (upper - lower) - load.coulomb * still
        # Friction alone may exceed the limit: then no motion respects it.
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(free[:, None], 0.0, rows / np.maximum(half, 0.0)[:, :, None])


def _senses(at: PathPoints) -> tuple[Array, Array]:
    """Return the sign (k, n) of each joint's motion along the path, 0 where it rests or reverses; and 1 there, else 0.

    All joints rest at both ends of the path. A joint counts as reversing at both of two adjacent points if its sign changes
    between them.
    """
    q1 = at.q(1)
    sign = np.where(np.abs(q1) > STANDING_SHARE * np.abs(q1).max(initial=0.0), np.sign(q1), 0.0)
    turning = sign[1:] * sign[:-1] < 0.0
    turning &= (np.diff(at.s) > 0.0)[:, None]
    still = sign == 0.0
    still[1:] |= turning
    still[:-1] |= turning
    still |= ((at.s <= 0.0) | (at.s >= at.joint_path.end))[:, None]
    return np.where(still, 0.0, sign), still.astype(np.float64)


class TorqueRate(LoadedLimit):
    """Torque-rate limit of each joint; the rate excludes Coulomb friction, which is discontinuous where a joint reverses."""

    name: ClassVar[str] = "torque_rate"
    units: ClassVar[tuple[str, str]] = ("N·m/s", "N/s")
    order: ClassVar[int] = 3
    rate: ClassVar[bool] = True
    columns: ClassVar[int] = 6

    def _rows_of(self, at: PathPoints, limit: Array, load: Load) -> Array:
        return torque_rate_rows(at, load) / limit[:, None]


AT_BREAK = 1e-9
"""Fraction of the path around a break in which the lesser of both limits holds: a law reaches the break only to rounding."""


class ToolSpeedLimit(Limit):
    """A limit on the Euclidean norm of a part of the tool's twist, judged by proved bounds.

    It has one limit (1,), or one for each segment of the path (k,).

    Attributes
    ----------
    part : int
        Part of the twist: 0 for v, 1 for ω.
    """

    part: ClassVar[int]
    order: ClassVar[int] = 1
    subject: ClassVar[str | None] = "tool"

    def check(self, value: Any) -> Any:
        """Return a valid value of the limit; raise InvalidInput for another one."""
        if not isinstance(value, list | tuple | np.ndarray) or (isinstance(value, np.ndarray) and value.ndim == 0):
            return super().check(value)
        each = check_positive(value, len(value), self.name) if len(value) else np.zeros(0)
        if not each.size:
            raise InvalidInput(self.name, "no numbers", "a number above 0, or one for each segment of the path")
        return float(each[0]) if each.size == 1 else each

    def array(self, value: ArrayLike | None, n: int) -> Array:
        """Return a valid value as an array."""
        limit = np.inf if value is None else value
        return check_positive(limit, np.size(limit), self.name)

    def from_plain(self, data: Any, n: int) -> Array | float | None:
        """Return a value from plain data."""
        if isinstance(data, list):
            return read_numbers(data, (len(data),), f"limits.{self.name}")
        return super().from_plain(data, n)

    def rows(self, at: PathPoints, limit: Array) -> Array:
        """Return the rows at points of a joint path."""
        norm = (
            np.linalg.norm(at.twist[:, 3 * self.part : 3 * self.part + 3], axis=1)
            if np.isfinite(limit).any()
            else np.zeros(at.s.size)
        )
        here = limit[0] if limit.size == 1 else limit_at(at.joint_path.path, limit, at.s, self.name)
        return np.asarray((norm / here)[:, None, None])

    def judge(self, motion: LimitedMotion, limit: Array) -> ToolExtreme:
        """Return the peak value of a motion, its ratio to the limit, and its time."""
        value, time = motion.tool_speed_bound(self.part)
        if not np.isfinite(limit).any():
            return ToolExtreme(value, float("nan"), time)
        if limit.size == 1:
            return ToolExtreme(value, value / float(limit[0]), time)
        ratio, time = motion.tool_speed_ratio(limits_on_pieces(motion.path, limit, self.name), self.part)
        return ToolExtreme(value, ratio, time)

    def piece_ratios(self, motion: LimitedMotion, limit: Array) -> Array:
        """Return the ratios on each piece of a motion."""
        speeds = motion.tool_speed_ends(self.part)
        if limit.size == 1:
            return np.asarray(np.maximum(*speeds)[:, None] / limit)
        allowed = inside_ends(motion.path, limit, motion.knot_positions, self.name)
        return np.asarray(np.maximum(*(v / most for v, most in zip(speeds, allowed, strict=True)))[:, None])


def limits_on_pieces(path: Path, limit: Array, name: str) -> Array:
    """Return the limits on the pieces between a path's breaks; the lesser one on a piece that belongs to two segments."""
    if limit.size != path.segments:
        several = f"{path.segments} numbers, one for each segment of the {path.name}, or one number"
        one = f"one number: a {path.name} has one segment"
        raise InvalidInput(f"limits.{name}", f"{limit.size} numbers", several if path.segments > 1 else one)
    return path.least_on_pieces(limit)


def limit_at(path: Path, limit: Array, s: Array, name: str) -> Array:
    """Return the limits at positions along a path; at a break the lesser of both sides."""
    pieces, inner, near = limits_on_pieces(path, limit, name), path.breaks[1:-1], AT_BREAK * path.end
    return np.minimum(pieces[np.searchsorted(inner, s - near)], pieces[np.searchsorted(inner, s + near)])


def inside_ends(path: Path, limit: Array, s: Array, name: str) -> tuple[Array, Array]:
    """Return the limits just after the start, and just before the end, of intervals of a path."""
    pieces, inner, near = limits_on_pieces(path, limit, name), path.breaks[1:-1], AT_BREAK * path.end
    return pieces[np.searchsorted(inner, s[:-1] + near)], pieces[np.searchsorted(inner, s[1:] - near)]


class ToolSpeed(ToolSpeedLimit):
    """Limit on the speed |v| of the tool's point."""

    name: ClassVar[str] = "tool_speed"
    units: ClassVar[tuple[str, str]] = ("m/s", "m/s")
    part: ClassVar[int] = 0


class RotationSpeed(ToolSpeedLimit):
    """Limit on the angular speed |ω| of the tool."""

    name: ClassVar[str] = "rotation_speed"
    units: ClassVar[tuple[str, str]] = ("rad/s", "rad/s")
    part: ClassVar[int] = 1


FOLDER = "planners.limits"
"""Folder, and group of entry points, in which each further limit is a file."""
FIELD_LIMITS: tuple[Limit, ...] = (
    Velocity(), Acceleration(), Jerk(), ToolSpeed(), RotationSpeed(), Torque(), TorqueRate()
)  # fmt: skip
"""The limits that are arguments of `MotionLimits`, in the order of its arguments, of files and of reports."""
ALL_LIMITS = tuple(kind.name for kind in FIELD_LIMITS)
"""Names of the limits that are arguments of `MotionLimits`."""
DERIVATIVES = tuple(kind.name for kind in FIELD_LIMITS if isinstance(kind, DerivativeLimit))
"""Names of the limits on derivatives of every joint, by order."""
TOOL_SPEEDS = tuple(kind.name for kind in FIELD_LIMITS if kind.subject == "tool")
"""Names of the limits of the tool."""
LOADED = tuple(kind.name for kind in FIELD_LIMITS if isinstance(kind, LoadedLimit))
"""Names of the limits that need the arm's masses. Files contain them only if they are given."""
_BY_NAME = {kind.name: kind for kind in FIELD_LIMITS}
"""Limits that are fields of `MotionLimits`, by name."""
_ADDED: dict[str, Limit] = {}
"""Further limits that this process has used, by name: of files in the folder, of others, and those of `register`."""


def register(kind: Limit) -> None:
    """Register a kind of limit by its name for ``MotionLimits(extra=...)`` and motion files, in this process."""
    if not isinstance(kind, Limit):
        raise InvalidInput("kind", repr(kind)[:60], "a Limit")
    if kind.name in (*ALL_LIMITS, *names(FOLDER)) or type(_ADDED.get(kind.name, kind)) is not type(kind):
        raise InvalidInput("kind", f"the name {kind.name!r}", "a name that no other limit has")
    _ADDED[kind.name] = kind


def limit_names() -> tuple[str, ...]:
    """Return the names of all limits: arguments of `MotionLimits`, files of this folder, and others used in this process."""
    return tuple(dict.fromkeys((*ALL_LIMITS, *names(FOLDER), *_ADDED)))


def is_limit(name: str) -> bool:
    """Return whether a name is that of a limit, or of a member's limit, such as ``"arm.torque"``."""
    return name in limit_names() or (
        isinstance(name, str) and name.count(".") == 1 and name.rpartition(".")[2] in limit_names()
    )


def check_names(names: object, argument: str) -> tuple[str, ...]:
    """Check that a tuple consists of names of limits, and return it."""
    given = names if isinstance(names, tuple) else (names,)
    wrong = [name for name in given if not is_limit(name)]
    if wrong or given is not names:
        raise InvalidInput(argument, repr((wrong or given)[0])[:60], f"a tuple out of {', '.join(limit_names())}")
    return given


def kind_of(name: str) -> Limit:
    """Return the kind of limit of a name, or of a file, which is run."""
    found: Limit | None = _BY_NAME.get(name) or _ADDED.get(name)
    if found is None:
        member, _, own = name.rpartition(".")
        if member and is_limit(name):
            return _ADDED.setdefault(name, MemberLimit(member, kind_of(own)))
        if not is_path(name) and name not in names(FOLDER):
            raise UnknownName("limit", name, limit_names(), similar=find_described(FOLDER, name, limit_names()))
        found = build_method(FOLDER, name, "limit")
        if is_path(name):
            register(found)
        else:
            _ADDED[name] = found
    return found
