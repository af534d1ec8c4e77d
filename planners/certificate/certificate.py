"""Certificate: what a trajectory keeps, from its polynomials and not from samples, whatever law made it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik import kinematics
from optik.arm.limits import LIMIT_TOLERANCE
from optik.arm.robot import Robot
from optik.check import check_number
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.kinematics import Chain
from optik.types import Array
from planners.certificate.bounds import MotionBounds
from planners.certificate.continuity import jumps as find_jumps
from planners.certificate.continuity import rest, steps
from planners.certificate.coverage import Coverage, check_span, coverage
from planners.certificate.path_error import PathError, path_error
from planners.certificate.tool_speed import tool_speed
from planners.limits import ALL_LIMITS, DERIVATIVES, TOOL_SPEEDS, MotionLimits
from planners.paths.base import Path
from planners.trajectory import Trajectory

COVERED = (1e-5, 1e-5)
"""How far along the path [m, rad] a motion may begin and end from where it should, and go back, where no tolerance is given."""

RATES = (1e-6, 1e9)
"""Of a controller [1/s]: beyond, its samples tell nothing."""

PERIODS = 1_000_000
"""Most periods of a controller that are all looked at."""


EXACT = 1e-12
"""What rounding may take from a ratio of exactly 1."""


class Extreme(NamedTuple):
    """Exact worst absolute value of each joint (n,), over its limit (n,), and when [s] (n,)."""

    value: Array
    ratio: Array
    time: Array


class ToolExtreme(NamedTuple):
    """Greatest speed, proved, its ratio to the limit (NaN where there is none), and when it is nearly reached [s]."""

    value: float
    ratio: float
    time: float


class Binding(NamedTuple):
    """How fast along the path, and which joint and limit say no: for the m pieces of a motion, exact.

    ``t`` and ``s`` (m + 1,) are times and places of their ends, ``speed`` (m,) is the mean of ds/dt. ``ratio`` (m,) is the
    worst value over its limit on the piece, 0 where nothing is limited; ``limit`` (m,) names that limit and ``joint`` (m,)
    its joint, ``"tool"`` for limits of the tool.
    """

    t: Array
    s: Array
    speed: Array
    ratio: Array
    limit: tuple[str, ...]
    joint: tuple[str, ...]


class Failure(NamedTuple):
    """A promise that does not hold: what, when [s], and the joint, where it is one."""

    words: str
    t: float
    joint: str | None = None


@dataclass(frozen=True, eq=False)
class Certificate:
    """What a trajectory keeps. Certificates are equal only where they are the same object.

    Attributes
    ----------
    joint_names : tuple of str
        In the order of all arrays.
    law : str
        Name of the law that made it.
    keeps : tuple of str
        The limits that the law promises: `holds` judges exactly these, and the position limits.
    velocity, acceleration, jerk : Extreme
        Exact worst values over the limits; NaN ratios where there is no limit. Infinite jerk where acceleration jumps.
    sampled_jerk : (n,) array
        Largest difference of accelerations at the controller's rate, over its period [rad/s³]: what a controller sees.
    rate : float
        That rate [1/s].
    position_margin : (n,) array
        Least room to the position limits, exact [rad or m]; negative where one is broken.
    path_error : PathError
        Tool against path: proved bounds for every instant.
    tolerance : (2,) tuple of float, or None
        What the distance [m] and the angle [rad] are judged by; None where nobody asked.
    tool_speed, rotation_speed : ToolExtreme
        Greatest speed of the tool's point [m/s] and of its rotation [rad/s]: proved bounds, their ratios to the limits (NaN
        where there is none) and when.
    singular_value, t_singular_value : float
        Smallest singular value of the Jacobian, and when: the least of a grid, refined around its least places.
    binding : Binding
        Which joint and limit say no, piece by piece along the path.
    coverage : Coverage
        Which part of the path the motion runs through.
    continuous : int
        How many derivatives are continuous, standstill before a start and after an end at rest included: 0 to 3; −1
        where the position itself jumps.
    rest : (2,) tuple of bool
        Whether the velocity is zero at the start and at the end.
    """

    joint_names: tuple[str, ...]
    law: str
    keeps: tuple[str, ...]
    duration: float
    velocity: Extreme
    acceleration: Extreme
    jerk: Extreme
    sampled_jerk: Array
    rate: float
    position_margin: Array
    path_error: PathError
    tolerance: tuple[float, float] | None
    tool_speed: ToolExtreme
    rotation_speed: ToolExtreme
    singular_value: float
    t_singular_value: float
    binding: Binding
    coverage: Coverage
    continuous: int
    rest: tuple[bool, bool]

    def worst(self, field: str) -> tuple[float, str, float]:
        """Worst ratio of a limit, its joint (``"tool"`` for the tool's) and its time; NaN where nothing is limited.

        Raises
        ------
        InvalidInput
            No limit of that name.
        """
        if field not in ALL_LIMITS:
            raise InvalidInput("field", repr(field), f"one of: {', '.join(ALL_LIMITS)}")
        if field in TOOL_SPEEDS:
            tool: ToolExtreme = getattr(self, field)
            return tool.ratio, "tool", tool.time
        extreme: Extreme = getattr(self, field)
        if np.isnan(extreme.ratio).all():
            return float("nan"), "", float("nan")
        i = int(np.nanargmax(extreme.ratio))
        return float(extreme.ratio[i]), self.joint_names[i], float(extreme.time[i])

    @property
    def failures(self) -> tuple[Failure, ...]:
        """The promises that do not hold; empty where the certificate holds."""
        found = []
        for field in self.keeps:
            ratio, joint, t = self.worst(field)
            if ratio > 1.0 + EXACT:
                words = f"{field} of {joint} is {ratio:.9g} of its limit at t = {t:.6g} s"
                found.append(Failure(words, t, None if joint == "tool" else joint))
        if self.continuous < 1:
            found.append(Failure(f"the {'position' if self.continuous < 0 else 'velocity'} jumps", 0.0))
        margin = int(np.argmin(self.position_margin))
        if self.position_margin[margin] < -LIMIT_TOLERANCE:
            joint, beyond = self.joint_names[margin], -self.position_margin[margin]
            found.append(Failure(f"{joint} passes its range by {beyond:.3g} (rad or m)", 0.0, joint))
        return (*found, *self._uncovered(), *self._off_path())

    def _uncovered(self) -> list[Failure]:
        """In which ways the motion does not run through its path, forwards, and come to rest at its end."""
        c = self.coverage
        late, early, back = (not np.less_equal(x, self.tolerance or COVERED).all() for x in c.missing)
        found = []
        if late:
            found.append(Failure(f"the motion begins at s = {c.begin:.6g} of its path, not at {c.wanted[0]:.6g}", 0.0))
        if early:
            words = f"the motion ends at s = {c.end:.6g} of its path, not at {c.wanted[1]:.6g}"
            found.append(Failure(words, self.duration))
        if back:
            words = f"the motion goes back along its path, to s = {c.back:.6g} at t = {c.t_back:.6g} s"
            found.append(Failure(words, c.t_back))
        if not self.rest[1]:
            found.append(Failure("the motion does not end at rest", self.duration))
        return found

    def _off_path(self) -> list[Failure]:
        """How the tool leaves its path by more than the tolerance."""
        off, found = self.path_error, []
        if self.tolerance is not None and off.distance > self.tolerance[0]:
            words = f"the tool is up to {off.distance:.3g} m off its path at t = {off.t_distance:.6g} s"
            found.append(Failure(words, off.t_distance))
        if self.tolerance is not None and off.angle > self.tolerance[1]:
            words = f"the tool is turned by up to {off.angle:.3g} rad at t = {off.t_angle:.6g} s"
            found.append(Failure(words, off.t_angle))
        return found

    @property
    def broken(self) -> tuple[str, ...]:
        """The promises that do not hold, in words; empty where the certificate holds."""
        return tuple(failure.words for failure in self.failures)

    @property
    def holds(self) -> bool:
        """Whether all that the law promises is kept exactly, at every instant, and the motion runs through its path.

        That is: the limits in ``keeps`` and the position limits, no jump of position or velocity, the tool within the
        tolerance where there is one, all of the path run through forwards, and rest at its end.
        """
        return not self.broken

    def to_dict(self) -> dict[str, Any]:
        """Plain data for files; infinite and undefined numbers as None."""
        out: dict[str, Any] = {
            "law": self.law, "keeps": list(self.keeps), "holds": self.holds, "broken": list(self.broken),
            "duration": self.duration, "rate": self.rate, "continuous": self.continuous, "rest": list(self.rest),
            "tool_speed": _tool_dict(self.tool_speed), "rotation_speed": _tool_dict(self.rotation_speed),
            "singular_value": self.singular_value, "t_singular_value": self.t_singular_value,
            "path_error": self.path_error._asdict(), "coverage": self.coverage._asdict(), "joint_names": list(self.joint_names),
            "tolerance": None if self.tolerance is None else list(self.tolerance),
        }  # fmt: skip
        for field in DERIVATIVES:
            out[field] = {k: plain(v) for k, v in getattr(self, field)._asdict().items()}
        out["sampled_jerk"] = plain(self.sampled_jerk)
        out["position_margin"] = plain(self.position_margin)
        b = self.binding
        out["binding"] = {k: plain(getattr(b, k)) for k in ("t", "s", "speed", "ratio")}
        out["binding"] |= {"limit": list(b.limit), "joint": list(b.joint)}
        return out


def plain(values: Array) -> list[float | None]:
    """List of numbers that JSON can hold: None for infinity (a jump) and for what is undefined (no limit)."""
    return [float(v) if np.isfinite(v) else None for v in values]


def _tool_dict(tool: ToolExtreme) -> dict[str, float | None]:
    return {"value": tool.value, "ratio": tool.ratio if np.isfinite(tool.ratio) else None, "time": tool.time}


def certify(
    robot: Robot,
    path: Path,
    trajectory: Trajectory,
    limits: MotionLimits,
    *,
    law: str = "",
    keeps: tuple[str, ...] = ALL_LIMITS,
    rate: float = 1000.0,
    tolerance: tuple[float, float] | None = None,
    span: tuple[float, float] | None = None,
) -> Certificate:
    """Find what a trajectory keeps, between its samples too.

    Parameters
    ----------
    robot : Robot
        The arm.
    path : Path
        What the tool should follow.
    trajectory : Trajectory
        The motion.
    limits : MotionLimits
        What it is held against.
    law : str
        Name of the law that made it.
    keeps : tuple of str
        What that law promises.
    rate : float
        The controller's rate [1/s], for `Certificate.sampled_jerk`.
    tolerance : (2,) tuple of float, optional
        Largest distance [m] and angle [rad] to the path with which the certificate holds.
    span : (2,) tuple of float, optional
        Places of the path where the motion shall begin and end; by default the path's own ends.

    Returns
    -------
    Certificate
        With exact extrema of the polynomials, one-sided values at jumps included.

    Raises
    ------
    InvalidInput
        Things of another kind, a trajectory of another number of joints, a path without length, a rate or a tolerance that is
        not above 0, an unknown name in ``keeps``, a span that is none.
    """
    kinds = {
        "robot": (robot, Robot),
        "path": (path, Path),
        "trajectory": (trajectory, Trajectory),
        "limits": (limits, MotionLimits),
    }
    for argument, (value, kind) in kinds.items():
        if not isinstance(value, kind):
            raise InvalidInput(argument, repr(value)[:60], f"a {kind.__name__}")
    if trajectory.n != robot.n:
        raise InvalidInput("trajectory", f"{trajectory.n} joints", f"the {robot.n} of {robot.name}")
    span = check_span(span, path)
    if unknown := [field for field in keeps if field not in ALL_LIMITS]:
        raise InvalidInput("keeps", repr(unknown[0])[:60], f"names out of: {', '.join(ALL_LIMITS)}")
    if tolerance is not None:
        tolerance = check_tolerance(tolerance)
    bound = limits.arrays(robot.n)
    extremes = {f: _extreme(trajectory, order, bound[f]) for order, f in enumerate(DERIVATIVES, start=1)}
    jumps, standing = find_jumps(trajectory), rest(trajectory)
    for order in range(3):  # what jumps has infinite derivatives, of every higher order
        if jumps[order].any():
            for field in DERIVATIVES[order:]:
                extremes[field] = _infinite_at_jumps(trajectory, order, extremes[field], jumps[order], bound[field])
    reach = trajectory.extrema(0)
    bounds = MotionBounds(robot, trajectory)
    enough = (1.0, 1.0) if tolerance is None else (tolerance[0] / 1.1, tolerance[1] / 1.1)
    off, passage = path_error(robot, path, trajectory, bounds, enough)
    speeds = tool_speed(robot, trajectory, bounds)
    singular_value, t_singular_value = _smallest_singular_value(robot, trajectory)
    return Certificate(
        joint_names=robot.joint_names,
        law=law,
        keeps=keeps,
        duration=trajectory.duration,
        **extremes,
        sampled_jerk=_sampled_jerk(trajectory, rate),
        rate=rate,
        position_margin=np.minimum(reach.least - robot.limits.lower, robot.limits.upper - reach.greatest),
        path_error=off,
        tolerance=tolerance,
        tool_speed=_tool_extreme(speeds.speed, limits.tool[0], speeds.t_speed),
        rotation_speed=_tool_extreme(speeds.rotation, limits.tool[1], speeds.t_rotation),
        singular_value=singular_value,
        t_singular_value=t_singular_value,
        binding=_binding(trajectory, limits, passage.s[passage.knot], bounds),
        coverage=coverage(path, passage, span),
        continuous=next((order - 1 for order in range(4) if jumps[order].any()), 3),
        rest=standing,
    )


def check_tolerance(tolerance: tuple[float, float]) -> tuple[float, float]:
    """Return a tolerance (distance [m], angle [rad]), both above 0."""
    expected = "two numbers above 0: a distance [m] and an angle [rad]"
    if not isinstance(tolerance, tuple | list) or len(tolerance) != 2:
        raise InvalidInput("tolerance", repr(tolerance)[:60], expected)
    distance, angle = (check_number(x, "tolerance", expected, above=0.0) for x in tolerance)
    return distance, angle


def _tool_extreme(value: float, limit: float, time: float) -> ToolExtreme:
    return ToolExtreme(value, value / limit if np.isfinite(limit) else float("nan"), time)


def _binding(trajectory: Trajectory, limits: MotionLimits, places: Array, bounds: MotionBounds) -> Binding:
    """Worst ratio of every piece, its limit and its joint."""
    robot, t = bounds.robot, trajectory.knots
    bound = limits.arrays(robot.n)
    worst = [trajectory.piece_worst(order) / bound[f] for order, f in enumerate(DERIVATIVES, start=1)]
    for part, limit in zip((slice(0, 3), slice(3, 6)), limits.tool, strict=True):
        speed = np.maximum(*(np.linalg.norm(side.motion[:, 0, part], axis=1) for side in bounds.ends))
        worst.append(speed[:, None] / limit)
    ratios = np.concatenate(worst, axis=1)
    joints = [*robot.joint_names * 3, "tool", "tool"]
    names = [f for f in DERIVATIVES for _ in range(robot.n)] + list(TOOL_SPEEDS)
    which = ratios.argmax(axis=1)
    return Binding(
        t=t,
        s=places,
        speed=np.diff(places) / np.diff(t),
        ratio=ratios[np.arange(len(which)), which],
        limit=tuple(names[i] for i in which),
        joint=tuple(joints[i] for i in which),
    )


def _smallest_singular_value(robot: Robot, trajectory: Trajectory) -> tuple[float, float]:
    """Least of a grid of instants, then of finer ones around the least of them."""
    end = trajectory.end
    low, high, count = 0.0, end, 121
    while True:
        t, values = np.linspace(low, high, count), np.empty(count)
        _singular_values(robot.chain, trajectory.padded, trajectory.knots, t, values)
        k = int(values.argmin())
        if high - low <= 1e-4 * end:  # the least value is flat: 1e-8 of it
            return float(values[k]), float(t[k])
        low, high, count = t[max(k - 1, 0)], t[min(k + 1, t.size - 1)], 9


@compiled
def _singular_values(chain: Chain, c: Array, knots: Array, t: Array, out: Array) -> None:
    """Smallest singular values of the Jacobian at instants t (k,) of quintics c (6, m, n)."""
    q = np.empty((t.shape[0], c.shape[2]))
    for k in range(t.shape[0]):
        i = min(max(np.searchsorted(knots, t[k], side="right") - 1, 0), c.shape[1] - 1)
        u = t[k] - knots[i]
        for j in range(c.shape[2]):
            value = 0.0
            for power in range(6):
                value = value * u + c[power, i, j]
            q[k, j] = value
    kinematics.singular_values_batch(chain, q, out)


def _extreme(trajectory: Trajectory, order: int, bound: Array) -> Extreme:
    extrema = trajectory.extrema(order)
    ratio = np.where(np.isfinite(bound), extrema.worst / bound, np.nan)
    return Extreme(extrema.worst, ratio, extrema.t_worst)


def _infinite_at_jumps(
    trajectory: Trajectory, order: int, extreme: Extreme, jumps: NDArray[np.bool_], bound: Array
) -> Extreme:
    """Extreme of the derivative of what jumps: infinite, at the largest jump of each joint."""
    size = np.where(jumps, np.abs(steps(trajectory, order)), 0.0)
    jumping = jumps.any(axis=0)
    when = trajectory.knots[size.argmax(axis=0)]
    infinite = np.where(np.isfinite(bound), np.inf, np.nan)
    return Extreme(
        np.where(jumping, np.inf, extreme.value),
        np.where(jumping, infinite, extreme.ratio),
        np.where(jumping, when, extreme.time),
    )


def _sampled_jerk(trajectory: Trajectory, rate: float) -> Array:
    """Largest difference of accelerations over whole periods of a controller, over the period."""
    if not RATES[0] <= check_number(rate, "rate", "samples per second") <= RATES[1]:
        raise InvalidInput("rate", f"{rate:.9g}", f"samples per second, in [{RATES[0]:g}, {RATES[1]:g}]")
    periods = max(int(trajectory.end * rate + 1e-9), 1)
    first = np.arange(min(periods, PERIODS))
    if periods > PERIODS:  # a motion of days: those around the knots, where accelerations change fastest, and a sample
        around = np.floor(trajectory.knots[:, None] * rate) + np.arange(-1, 2)
        first = np.concatenate([np.linspace(0, periods - 1, PERIODS), np.clip(around.ravel(), 0, periods - 1)])
    begin, end = (np.minimum(np.floor(i) / rate, trajectory.end) for i in (first, first + 1))
    difference: Array = np.abs(trajectory(end, 2) - trajectory(begin, 2)).max(axis=0) * rate
    return difference
