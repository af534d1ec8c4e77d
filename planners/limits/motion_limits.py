"""The limits of one motion: one of each kind that is given; the least duration of a move within them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import ByContent
from optik.arm.plain import read_record
from optik.arm.robot import Robot
from optik.check import check_keywords, check_kind
from optik.errors import AssumptionWarning, InvalidInput
from optik.types import Array, content
from planners.limits import kinds
from planners.limits.base import Limit, ratio_to_limit, sides, symmetric_limit
from planners.limits.inputs import PathPoints, plain
from planners.limits.kinds import ALL_LIMITS, DERIVATIVES, FIELD_LIMITS, LOADED, TOOL_SPEEDS, kind_of
from planners.paths.base import Path
from planners.trajectory.curve import monomials

# ---------------- the limits of one motion


FAR_ABOVE = 20.0
"""Ratio of a given velocity limit to the robot's own from which it is probably in degrees, as a radian has 57; and speed of a
tool [m/s] from which it is probably in millimetres."""


def _warn_of_units(robot: Robot, velocity: Any, tool_speed: Any) -> None:
    """Warn of a velocity limit that is far above those of the robot, and of one on the tool that no arm reaches."""
    if isinstance(tool_speed, int | float) and FAR_ABOVE < tool_speed < np.inf:
        warnings.warn(f"tool_speed: {tool_speed:g} m/s: are these mm/s?", AssumptionWarning, stacklevel=3)
    own, turns = robot.limits.velocity, ~robot.prismatic
    if isinstance(velocity, int | float) and own is not None and (turns & np.isfinite(own)).any():
        ratio = float(velocity) / float(own[turns].max())
        if FAR_ABOVE < ratio < np.inf:
            words = f"velocity: {velocity:g} rad/s is {ratio:.3g} times the largest limit of {robot.name}: are these degrees?"
            warnings.warn(words, AssumptionWarning, stacklevel=3)


def _find_records(robot: Robot) -> dict[str, Any]:
    """Return the records of further limits that a robot's model has, and the accelerations of an arm that brakes harder."""
    limits, found = robot.limits, dict[str, Any]()
    if limits.velocity_by_position is not None:
        found["velocity_by_position"] = limits.velocity_by_position
    if limits.deceleration is not None:
        speeding = np.full(robot.n, np.inf) if limits.acceleration is None else limits.acceleration
        line = {"acceleration": speeding, "deceleration": limits.deceleration, "free_speed": np.inf}
        found["acceleration_by_velocity"] = kind_of("acceleration_by_velocity").check(line)
        found["acceleration"] = np.maximum(speeding, limits.deceleration)
    if robot.motors is not None:
        own, E = robot.motors.limits, robot.motors.inverse
        matrices = {"velocity": E, "acceleration": E, "jerk": E}
        if robot.inertia is not None:
            matrices |= {"torque": robot.motors.matrix.T, "torque_rate": robot.motors.matrix.T}
        for name, matrix in matrices.items():
            if (limit := getattr(own, name)) is not None:
                record = {"matrix": matrix, "bound": limit, "names": robot.motors.names}
                found[f"motor_{name}"] = kind_of(f"motor_{name}").check(record)
    return found


@check_keywords
@dataclass(frozen=True, eq=False)
class MotionLimits(ByContent):
    """Limits of a motion; None where it is not limited.

    Parameters
    ----------
    velocity, acceleration, jerk : scalar or (n,) array, optional
        Limits on the absolute values [rad/s, rad/s², rad/s³, or metres for prismatic joints]. Velocity,
        acceleration and torque also take a pair (lower, upper), lower < 0 < upper, each a scalar or an (n,) array.
    tool_speed, rotation_speed : float or (k,) array, optional
        Greatest speed of the tool's point [m/s] and of its rotation [rad/s], as Euclidean norms; one, or one for each segment
        of a polyline. A rounded corner has the lesser of the limits of its two segments.
    extra : mapping, optional
        Limits of further kinds of limits, by name or by file, such as ``{"./weighted_speed.py": 3.0}``, which is run.
    torque, torque_rate : scalar or (n,) array, optional
        Greatest torques [N·m, N] and torque rates [N·m/s, N/s] of an arm whose masses are known. The torque includes Coulomb
        friction; its rate does not.
    robot_values : mapping, optional
        Limits of the robot's model by name, set by `MotionLimits.of`. A limit that differs from its entry here was given by the
        caller (`MotionLimits.given_names`).

    Raises
    ------
    InvalidInput
        Limits that are not above 0, or not numbers.
    UnknownName
        An unknown limit in ``extra``.
    """

    velocity: ArrayLike | None = None
    acceleration: ArrayLike | None = None
    jerk: ArrayLike | None = None
    tool_speed: ArrayLike | None = None
    rotation_speed: ArrayLike | None = None
    extra: Mapping[str, Any] | None = None
    torque: ArrayLike | None = None
    torque_rate: ArrayLike | None = None
    robot_values: Mapping[str, Any] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for kind in FIELD_LIMITS:
            value = getattr(self, kind.name)
            if value is not None:
                object.__setattr__(self, kind.name, kind.check(value))
        if self.extra is None:
            return
        if not isinstance(self.extra, Mapping) or any(name in ALL_LIMITS for name in self.extra):
            raise InvalidInput(
                "extra", repr(self.extra)[:120], "a mapping from names of further limits to their values"
            )
        given = {kind_of(name): value for name, value in self.extra.items() if value is not None}
        kept = {kind.name: kind.check(value) for kind, value in given.items()}
        object.__setattr__(self, "extra", MappingProxyType(kept) if kept else None)

    def __reduce__(self) -> tuple[Any, ...]:
        values = [getattr(self, each.name) for each in fields(self)]
        return MotionLimits, tuple(dict(value) if isinstance(value, Mapping) else value for value in values)

    @property
    def content(self) -> Any:
        """The limits that are given, as hashable values."""
        return content([getattr(self, name) for name in ALL_LIMITS]), content(dict(self.extra or {}))

    @staticmethod
    def of(robot: Robot, **given: Any) -> MotionLimits:
        """Return the robot's own limits, replaced by the given limits, as on the command line.

        The constructor of `MotionLimits` does not read the robot: a quantity for which it gets no limit is not limited.

        Parameters
        ----------
        robot : Robot
            The arm.
        **given
            Arguments of `MotionLimits`, and further kinds of limits by name; None removes a limit of the robot.

        Returns
        -------
        MotionLimits
            The limits of the robot's model on velocity, acceleration and jerk, and further ones that it has, such as
            ``velocity_by_position`` and those of motors. With known masses also those on torque and torque rate.
        """
        check_kind(robot, "robot", Robot, 'a Robot, such as optik.load("ur5e")')
        _warn_of_units(robot, given.get("velocity"), given.get("tool_speed"))
        names = (*DERIVATIVES, *LOADED) if robot.inertia is not None else DERIVATIVES
        known = {name: getattr(robot.limits, name) for name in names} | _find_records(robot)
        values = known | {name: value for name, value in given.items() if name not in ("extra", "robot_values")}
        extra = {kind_of(name).name: values.pop(name) for name in [*values] if name not in ALL_LIMITS}
        return MotionLimits(**values, extra=extra | dict(given.get("extra") or {}), robot_values=known)

    @property
    def kinds(self) -> tuple[Limit, ...]:
        """All kinds of limits: those that are arguments, given or not, then the extra ones."""
        return FIELD_LIMITS if self.extra is None else (*FIELD_LIMITS, *map(kind_of, self.extra))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of `kinds`."""
        return ALL_LIMITS if self.extra is None else (*ALL_LIMITS, *self.extra)

    @property
    def given_names(self) -> tuple[str, ...]:
        """Names of the limits that the caller gave: those that differ from the robot's model."""
        own = self.robot_values or {}
        bounds = {name: self.value(name) for name in self.names}
        return tuple(n for n, b in bounds.items() if b is not None and not (n in own and np.array_equal(b, own[n])))

    def value(self, name: str) -> Any:
        """Return a limit as it was given.

        Parameters
        ----------
        name : str
            Of a limit.

        Returns
        -------
        float, (n,), (2,) or (2, n) array, or None
            In the limit's units; the last two for a pair, lower first; None if there is no limit.
        """
        return getattr(self, name) if name in ALL_LIMITS else (self.extra or {}).get(name)

    def bounds(self, n: int) -> dict[str, Array]:
        """Return the limits of all kinds as arrays.

        Parameters
        ----------
        n : int
            Number of joints.

        Returns
        -------
        dict of arrays
            By name: (n,), (2, n) for a pair, lower first, or (1,) for limits of the whole arm [as the limit's units],
            infinity without a limit, read-only; or a record.

        Raises
        ------
        InvalidInput
            A length other than n.
        """
        kept: dict[int, dict[str, Array]] = self.__dict__.setdefault("_bounds", {})  # time laws read it often
        if n not in kept:
            kept[n] = {kind.name: kind.array(self.value(kind.name), n) for kind in self.kinds}
        return dict(kept[n])

    def arrays(self, n: int) -> dict[str, Array]:
        """Return the limits on the absolute values of velocity, acceleration and jerk as arrays.

        Parameters
        ----------
        n : int
            Number of joints.

        Returns
        -------
        dict of (n,) arrays
            By name [rad/s, rad/s², rad/s³, or m]; infinity without a limit; for a pair the side nearer to zero.

        Raises
        ------
        InvalidInput
            A length other than n.
        """
        bounds = self.bounds(n)
        return {name: symmetric_limit(bounds[name]) for name in DERIVATIVES}

    def rows(self, name: str, at: PathPoints) -> Array:
        """Return the rows of one limit at points of a joint path.

        Parameters
        ----------
        name : str
            Of the limit.
        at : PathPoints
            Points of the joint path.

        Returns
        -------
        (k, m, order) array, or of more columns
            See `Limit.rows` [as 1 over the monomials].
        """
        return kind_of(name).rows(at, self.bounds(at.joint_path.robot.n)[name])

    def ratios(self, name: str, at: PathPoints, rates: Sequence[Array]) -> Array:
        """Return the values of a motion along a joint path over one limit.

        Parameters
        ----------
        name : str
            Of the limit.
        at : PathPoints
            Points of the joint path.
        rates : (k,) arrays
            ṡ, s̈, s⃛ there [m/s, m/s², m/s³, or rad]; as many as the limit's order, or more.

        Returns
        -------
        (k, m) array
            Absolute values over the limit on their side [1]; the limit is respected where they are at most 1.
        """
        kind, limit = kind_of(name), self.bounds(at.joint_path.robot.n)[name]
        two_sided = (
            kind.sided and limit.ndim == 2 and kind.homogeneous
        )  # the value scales with time, a centered row does not
        rows = kind.rows(at, np.ones(limit.shape[1]) if two_sided else limit)
        products = monomials(rates[: kind.order], full=rows.shape[2] > kind.order)
        values = np.einsum("kmi,ik->km", rows, np.stack(products))
        return ratio_to_limit(values, limit) if two_sided else np.asarray(np.abs(values))

    def select(self, names: tuple[str, ...]) -> MotionLimits:
        """Return the limits with these names; all others are free.

        Parameters
        ----------
        names : tuple of str
            Names of limits.

        Returns
        -------
        MotionLimits
            The chosen limits.
        """
        extra = {name: value for name, value in (self.extra or {}).items() if name in names}
        return replace(self, **dict.fromkeys(name for name in ALL_LIMITS if name not in names), extra=extra)

    def scale(self, factor: float, names: tuple[str, ...] | None = None) -> MotionLimits:
        """Return the limits multiplied by a factor.

        Parameters
        ----------
        factor : float
            Factor of the limits [1].
        names : tuple of str, optional
            Which limits; by default all.

        Returns
        -------
        MotionLimits
            The scaled limits.
        """
        chosen = self.names if names is None else names
        wider: dict[str, Any] = {
            name: kind_of(name).scaled(v, factor) for name in chosen if (v := self.value(name)) is not None
        }
        extra = None if self.extra is None else {name: wider.pop(name, self.extra[name]) for name in self.extra}
        return replace(self, **wider, extra=extra)

    def to_dict(self, n: int) -> dict[str, Any]:
        """Return plain data for programs: lists of n numbers, None without a limit; two of them for a pair.

        Parameters
        ----------
        n : int
            Number of joints.

        Returns
        -------
        dict
            By name, in the limits' units.
        """
        bounds = self.bounds(n)
        joints = {f: plain(b) if b.ndim == 1 else [plain(x) for x in b] for f in DERIVATIVES for b in (bounds[f],)}
        others = [kind for kind in self.kinds if kind.name not in joints]
        return joints | {kind.name: kind.to_plain(self.value(kind.name)) for kind in others}

    def to_plain(self) -> dict[str, Any]:
        """Return plain data for files, which `from_plain` reads back to the last bit."""
        given = [kind for kind in self.kinds if kind.name not in LOADED or self.value(kind.name) is not None]
        return {kind.name: kind.to_plain(self.value(kind.name)) for kind in given}

    @classmethod
    def from_plain(cls, data: Any, n: int) -> MotionLimits:
        """Return the limits from the data of `to_plain`.

        Parameters
        ----------
        data : mapping
            Plain data by name of the limit. Torque limits and added limits are optional; all others are required.
        n : int
            Number of joints.

        Returns
        -------
        MotionLimits
            The limits.

        Raises
        ------
        InvalidInput
            Missing or unknown names, or data that are not a limit.
        """
        extra = (
            tuple(key for key in data if key not in ALL_LIMITS and kinds.is_limit(key))
            if isinstance(data, dict)
            else ()
        )
        required = tuple(name for name in ALL_LIMITS if name not in LOADED)
        checked = read_record(data, (*required, *extra), "limits", optional=LOADED)
        values: dict[str, Any] = {key: kind_of(key).from_plain(value, n) for key, value in checked.items()}
        return cls(**{name: values.pop(name, None) for name in ALL_LIMITS}, extra=values)

    @property
    def tool(self) -> tuple[float, float]:
        """Greatest tool speed [m/s] and rotation speed [rad/s] of any segment, infinity without a limit."""
        speed, rotation = (
            np.inf if value is None else float(np.max(value)) for value in (self.tool_speed, self.rotation_speed)
        )
        return speed, rotation


def check_path(limits: MotionLimits, path: Path) -> None:
    """Check that limits of each segment are as many as the path has segments."""
    for name in TOOL_SPEEDS:
        value = limits.value(name)
        if np.ndim(value):
            kinds.limits_on_pieces(path, np.asarray(value), name)


def tool_limits_at(limits: MotionLimits, path: Path, s: Array) -> Array:
    """Return the greatest tool speeds (k, 2) [m/s, rad/s] at positions (k,) along a path; at a break the lesser of two."""
    given = zip(TOOL_SPEEDS, map(limits.value, TOOL_SPEEDS), limits.tool, strict=True)
    each = [
        kinds.limit_at(path, np.asarray(v), s, name) if np.ndim(v) else np.full(s.size, most) for name, v, most in given
    ]
    return np.stack(each, axis=1)


def tool_limits_between(limits: MotionLimits, path: Path, s: Array) -> Array:
    """Return the greatest tool speeds (k, 2) [m/s, rad/s] between positions (k + 1,) along a path.

    If an interval has two limits, it is the lesser.
    """
    given = zip(TOOL_SPEEDS, map(limits.value, TOOL_SPEEDS), limits.tool, strict=True)
    each = [
        np.minimum(*kinds.inside_ends(path, np.asarray(v), s, name)) if np.ndim(v) else np.full(s.size - 1, most)
        for name, v, most in given
    ]
    return np.stack(each, axis=1)


def find_tool_limit_changes(limits: MotionLimits, path: Path) -> Array:
    """Return the breaks of a path (k,) at which a greatest tool speed changes."""
    if not any(np.ndim(limits.value(name)) for name in TOOL_SPEEDS):
        return np.empty(0)
    breaks, allowed = path.breaks, tool_limits_between(limits, path, path.breaks)
    return np.asarray(breaks[1:-1][(allowed[1:] != allowed[:-1]).any(axis=1)])


# ---------------- least duration of a move of the joints from rest to rest


HALVINGS = 100
"""Halvings of the interval of a joint's peak speed: from 1e9 to the last bit of 1e-12."""


def compute_least_duration(away: Array, limits: MotionLimits) -> float:
    """Return the least duration [s] of a move by `away` (n,) [rad, m]: that of the slowest joint, by its limits alone.

    A joint reaches its peak speed v from rest in v / A + A / J, or in 2 (v / J)^½ if it does not reach A; the distance is
    half of v times this. The peak speed is the limit V, or less if the distance is short.
    """
    bounds, d = limits.bounds(away.size), np.abs(away)
    V, J, (lower, upper) = bounds["velocity"], bounds["jerk"], sides(bounds["acceleration"])
    ramps = np.where(away > 0.0, upper, -lower), np.where(away > 0.0, -lower, upper)

    def ramp_time(v: Array) -> Array:
        with np.errstate(over="ignore", invalid="ignore"):  # limits may be infinite
            return np.asarray(sum(np.where(v * J > A * A, v / A + A / J, 2.0 * np.sqrt(v / J)) for A in ramps))

    low, high = np.zeros(d.size), np.minimum(V, 1e9)
    for _ in range(HALVINGS):
        v = 0.5 * (low + high)
        short = 0.5 * v * ramp_time(v) < d
        low, high = np.where(short, v, low), np.where(short, high, v)
    return float((0.5 * ramp_time(high) + d / high).max(initial=0.0, where=d > 0.0))
