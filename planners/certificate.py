"""Certificate: what a trajectory keeps, from its polynomials and not from samples, whatever law made it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from optik import se3
from optik.check import check_count, check_number
from optik.errors import InvalidInput
from optik.robot import LIMIT_TOLERANCE, Robot
from planners.paths.base import Path
from planners.timing.base import DERIVATIVES, MotionLimits
from planners.trajectory import Trajectory

Array = NDArray[np.float64]

JUMP = 1e-5
"""A derivative jumps where its one-sided values differ by more than this part of its greatest value: above rounding."""

PERIODS = 1_000_000
"""Most periods of a controller that are all looked at."""


class Extreme(NamedTuple):
    """Exact worst absolute value of each joint (n,), over its limit (n,), and when [s] (n,)."""

    value: Array
    ratio: Array
    time: Array


class PathError(NamedTuple):
    """Worst distance and angle between tool and path over a dense grid of instants, and when.

    The largest of samples, not a proved bound: between them it may be larger by what the tool moves off in half a step.
    """

    distance: float
    angle: float
    t_distance: float
    t_angle: float
    instants: int


@dataclass(frozen=True)
class Certificate:
    """What a trajectory keeps.

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
        Tool against path.
    tool_speed : float
        Greatest tool speed on the same instants [m/s].
    rotation_speed : float
        Greatest angular speed of the tool on them [rad/s].
    singular_value, t_singular_value : float
        Smallest singular value of the Jacobian on them, and when.
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
    tool_speed: float
    rotation_speed: float
    singular_value: float
    t_singular_value: float
    continuous: int
    rest: tuple[bool, bool]

    def worst(self, field: str) -> tuple[float, str, float]:
        """Worst ratio of one of velocity, acceleration, jerk, its joint and its time; NaN without limits.

        Raises
        ------
        InvalidInput
            Another field.
        """
        if field not in DERIVATIVES:
            raise InvalidInput("field", repr(field), "velocity, acceleration or jerk")
        extreme: Extreme = getattr(self, field)
        if np.isnan(extreme.ratio).all():
            return float("nan"), "", float("nan")
        i = int(np.nanargmax(extreme.ratio))
        return float(extreme.ratio[i]), self.joint_names[i], float(extreme.time[i])

    @property
    def broken(self) -> tuple[str, ...]:
        """The promises that do not hold, in words; empty where the certificate holds."""
        words = []
        for field in self.keeps:
            ratio, joint, t = self.worst(field)
            if ratio > 1.0:
                words.append(f"{field} of {joint} is {ratio:.9g} of its limit at t = {t:.6g} s")
        if self.continuous < 1:
            words.append(f"the {'position' if self.continuous < 0 else 'velocity'} jumps")
        margin = int(np.argmin(self.position_margin))
        if self.position_margin[margin] < -LIMIT_TOLERANCE:
            words.append(f"{self.joint_names[margin]} passes its range by {-self.position_margin[margin]:.3g} rad")
        return tuple(words)

    @property
    def holds(self) -> bool:
        """Whether all that the law promises, and the position limits, are kept exactly."""
        return not self.broken

    def to_dict(self) -> dict[str, Any]:
        """Plain data for files; infinite and undefined numbers as None."""
        out: dict[str, Any] = {
            "law": self.law, "keeps": list(self.keeps), "holds": self.holds, "broken": list(self.broken),
            "duration": self.duration, "rate": self.rate, "continuous": self.continuous, "rest": list(self.rest),
            "tool_speed": self.tool_speed, "rotation_speed": self.rotation_speed,
            "singular_value": self.singular_value, "t_singular_value": self.t_singular_value,
            "path_error": self.path_error._asdict(), "joint_names": list(self.joint_names),
        }  # fmt: skip
        for field in DERIVATIVES:
            out[field] = {k: plain(v) for k, v in getattr(self, field)._asdict().items()}
        out["sampled_jerk"] = plain(self.sampled_jerk)
        out["position_margin"] = plain(self.position_margin)
        return out


def plain(values: Array) -> list[float | None]:
    """List of numbers that JSON can hold: None for infinity (a jump) and for what is undefined (no limit)."""
    return [float(v) if np.isfinite(v) else None for v in values]


def certify(
    robot: Robot,
    path: Path,
    trajectory: Trajectory,
    limits: MotionLimits,
    *,
    law: str = "",
    keeps: tuple[str, ...] = DERIVATIVES,
    rate: float = 1000.0,
    instants: int = 3001,
) -> Certificate:
    """Find what a trajectory keeps.

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
    instants : int
        Size of the grid for the tool's distance, its speed and the singular values.

    Returns
    -------
    Certificate
        With exact extrema of the polynomials, one-sided values at jumps included.

    Raises
    ------
    InvalidInput
        A trajectory of another number of joints, fewer than 2 instants, a rate that is not above 0.
    """
    if trajectory.n != robot.n:
        raise InvalidInput("trajectory", f"{trajectory.n} joints", f"the {robot.n} of {robot.name}")
    check_count(instants, "instants", 2)
    bound = limits.arrays(robot.n)
    extremes = {f: _extreme(trajectory, order, bound[f]) for order, f in enumerate(DERIVATIVES, start=1)}
    jumps = [_jumps(trajectory, order) for order in range(4)]
    for order, field in enumerate(DERIVATIVES):  # what jumps has an infinite derivative
        if jumps[order].any():
            extremes[field] = _infinite_at_jumps(trajectory, order, extremes[field], jumps[order], bound[field])
    reach = trajectory.extrema(0)
    t = np.linspace(0.0, trajectory.end, instants)
    q, dq = trajectory(t), trajectory(t, 1)
    J = robot.jacobian(q)
    twist = np.einsum("kij,kj->ki", J, dq)
    smallest = np.linalg.svd(J, compute_uv=False)[:, -1]
    k = int(np.argmin(smallest))
    return Certificate(
        joint_names=robot.joint_names,
        law=law,
        keeps=keeps,
        duration=trajectory.duration,
        **extremes,
        sampled_jerk=_sampled_jerk(trajectory, rate),
        rate=rate,
        position_margin=np.minimum(reach.least - robot.limits.lower, robot.limits.upper - reach.greatest),
        path_error=_path_error(robot, path, t, q),
        tool_speed=float(np.linalg.norm(twist[:, :3], axis=1).max()),
        rotation_speed=float(np.linalg.norm(twist[:, 3:], axis=1).max()),
        singular_value=float(smallest[k]),
        t_singular_value=float(t[k]),
        continuous=next((order - 1 for order in range(4) if jumps[order].any()), 3),
        rest=_rest(trajectory),
    )


def _extreme(trajectory: Trajectory, order: int, bound: Array) -> Extreme:
    extrema = trajectory.extrema(order)
    ratio = np.where(np.isfinite(bound), extrema.worst / bound, np.nan)
    return Extreme(extrema.worst, ratio, extrema.t_worst)


def _jumps(trajectory: Trajectory, order: int) -> NDArray[np.bool_]:
    """Where (m + 1, n) a derivative steps by more than rounding."""
    scale = trajectory.extrema(order).worst.max()
    return np.asarray(np.abs(steps(trajectory, order)) > JUMP * max(scale, 1e-12))


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
    check_number(rate, "rate", "samples per second, above 0", above=0.0)
    periods = max(int(trajectory.end * rate + 1e-9), 1)
    first = np.arange(min(periods, PERIODS))
    if periods > PERIODS:  # a motion of days: those around the knots, where accelerations change fastest, and a sample
        around = np.floor(trajectory.knots[:, None] * rate) + np.arange(-1, 2)
        first = np.concatenate([np.linspace(0, periods - 1, PERIODS), np.clip(around.ravel(), 0, periods - 1)])
    begin, end = (np.minimum(np.floor(i) / rate, trajectory.end) for i in (first, first + 1))
    difference: Array = np.abs(trajectory(end, 2) - trajectory(begin, 2)).max(axis=0) * rate
    return difference


def _path_error(robot: Robot, path: Path, t: Array, q: Array) -> PathError:
    tool = robot.fk(q)
    e = se3.error(tool, path.pose(path.nearest(tool)))
    distance, angle = np.linalg.norm(e[:, :3], axis=1), np.linalg.norm(e[:, 3:], axis=1)
    i, j = int(distance.argmax()), int(angle.argmax())
    return PathError(float(distance[i]), float(angle[j]), float(t[i]), float(t[j]), t.size)


def _rest(trajectory: Trajectory) -> tuple[bool, bool]:
    first, last = trajectory.ends(1)
    slow = 1e-9 * float(trajectory.extrema(1).worst.max())
    return bool((np.abs(first[0]) <= slow).all()), bool((np.abs(last[-1]) <= slow).all())


def steps(trajectory: Trajectory, order: int) -> Array:
    """How far (m + 1, n) a derivative steps at all knots; an end at rest counts as standstill before or after it."""
    first, last = trajectory.ends(order)
    start, end = _rest(trajectory) if order else (False, False)  # standstill is somewhere: q does not jump to it
    before = first[:1] if start else np.zeros_like(first[:1])
    after = -last[-1:] if end else np.zeros_like(last[-1:])
    return np.concatenate([before, trajectory.jumps(order), after])
