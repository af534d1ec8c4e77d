"""Follow a Cartesian path with the joints: IK sample by sample, checked steps, exact derivatives along s."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optik import kinematics, se3
from optik.check import check_count
from optik.errors import InvalidInput
from optik.ik import IKResult, IKSolver, IKStatus
from optik.ik._problem import check_start
from optik.robot import Robot
from planners.curve import Curve
from planners.hermite import through
from planners.paths.base import Path

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

START_TOLERANCE = 1e-4
"""How far the tool may stand from the path's start [m and rad]: a real arm's reading, not another place."""
LARGEST_STEP = 0.25
"""Largest joint motion between two samples [rad or m]; the midpoint alone lets q4 turn against q6."""
PATH_TOLERANCE = 1e-5
"""Largest distance [m] and angle [rad] between samples; a branch flip leaves the path by centimetres."""
SMALLEST_SINGULAR_VALUE = 1e-4
"""Below this the joint speed for a tool speed of 1 m/s passes 10,000 rad/s: no motion follows the path there."""
POLISHED = 1e-10
"""Error that the polish must leave behind [m and rad]; it reaches 1e-15 unless the Jacobian has lost rank."""


POLISH_MOVES = 0.02
"""Largest joint motion of the polish [rad or m]: more would be another configuration."""


AT_LIMIT = 1e-3
"""How near a joint stands to its limit to be named as what stops a path [rad or m]."""


APART = 2e-4
"""Least distance of spline nodes [m or rad]: 1e-16 of rounding in q becomes 60e-16 / APART³ = 1e-3 in the third derivative."""


MOST_SAMPLES = 100_000
"""More would only take time."""


class FollowStatus(StrEnum):
    """How following a path ended."""

    SOLVED = "solved"
    NO_IK = "no_ik"
    OUTSIDE_LIMITS = "outside_limits"
    BRANCH_JUMP = "branch_jump"
    SINGULAR = "singular"


@dataclass(frozen=True)
class Stop:
    """Where and why a motion ended early."""

    status: StrEnum
    s: float
    joint: str | None
    reason: str
    advice: str


class IKRecord(NamedTuple):
    """What the IK method itself did at each sample (k,), before the polish: errors [m, rad] and iterations."""

    position_error: Array
    rotation_error: Array
    iterations: NDArray[np.int64]


class JointPath(Curve):
    """Configurations q(s) along a path: quintic Hermite between polished samples with exact q', q''.

    Attributes
    ----------
    robot : Robot
        The arm.
    path : Path
        What it follows; s has its unit.
    knots : (k,) array
        The samples in s.
    nodes : (m,) array
        The knots that the spline passes through: those at least `APART` from each other, so that rounding in q does not
        show in q'''.
    q : (k, n) array
        Configurations there.
    derivatives : (k, 3, n) array
        Exact q', q'', q''' there.
    singular_values : (k,) array
        Smallest singular value of the Jacobian there.
    ik : IKRecord
        What the method left before the polish.
    """

    parameter = "s"

    def __init__(self, robot: Robot, path: Path, knots: Array, q: Array, derivatives: Array, ik: IKRecord) -> None:
        self.robot, self.path, self.knots, self.q, self.derivatives, self.ik = robot, path, knots, q, derivatives, ik
        self.singular_values = np.linalg.svd(robot.jacobian(q), compute_uv=False)[:, -1]
        chosen = _apart(knots)
        self.nodes = knots[chosen]
        spline = through(self.nodes, q[chosen], derivatives[chosen, 0], derivatives[chosen, 1])
        self._orders = [spline, *(spline.derivative(order) for order in (1, 2, 3))]

    @property
    def end(self) -> float:
        """Last s: the path's own end, or where the good part of it ends."""
        return float(self.knots[-1])

    def _evaluate(self, x: Array, order: int) -> Array:
        values: Array = self._orders[order](x)
        return values

    @cached_property
    def deviation(self) -> tuple[float, float]:
        """Worst distance [m] and angle [rad] to the path at the same s, on seven points between any two nodes."""
        worst = _between(self.robot, self.path, self._orders[0], np.arange(1, 8) / 8.0)
        return float(worst[:, 0].max()), float(worst[:, 1].max())


class Followed(NamedTuple):
    """The joint path, or the good part of it and why it stops. ``bool(followed)`` is success."""

    joint_path: JointPath | None
    stop: Stop | None

    def __bool__(self) -> bool:
        return self.stop is None


def follow(solver: IKSolver, path: Path, q_start: ArrayLike, *, samples: int = 151) -> Followed:
    """Turn a Cartesian path into a joint path, with the previous sample as the start of each solve.

    Every sample is polished by Newton before derivatives are taken (1e-6 of noise would multiply the third derivative
    by 400). A step between samples is accepted only if the joints move little AND the tool between the samples is on
    the path.

    Parameters
    ----------
    solver : IKSolver
        Built for the arm.
    path : Path
        Where the tool goes.
    q_start : (n,) array
        Configuration at the path's start.
    samples : int
        Equally spaced in s, ends included; 151 for the paper's line.

    Returns
    -------
    Followed
        On failure with the s where it stopped, the reason and what would work.

    Raises
    ------
    InvalidInput
        A path without length, a start off the path, outside the limits or not finite, fewer than 2 samples.
    """
    robot = solver.robot
    check_count(samples, "samples", 2)
    if samples > MOST_SAMPLES:
        raise InvalidInput("samples", samples, f"at most {MOST_SAMPLES}; 151 hold a line to a nanometre")
    q = check_start(robot, q_start, "q_start")
    if not path.end > 0.0:
        raise InvalidInput("path", "a length of 0", "a path whose ends differ")
    off = robot.errors(q, path.pose(0.0))
    distance, angle = float(np.linalg.norm(off[:3])), float(np.linalg.norm(off[3:]))
    if max(distance, angle) > START_TOLERANCE:
        raise InvalidInput(
            "q_start",
            f"the tool {1e3 * distance:.3g} mm and {np.degrees(angle):.3g}° from the path's start",
            f"a configuration on the path's start (within {1e3 * START_TOLERANCE:g} mm)",
        )
    knots = np.linspace(0.0, path.end, samples)
    poses = path.pose(knots)
    found, record, stop = _solve_samples(solver, knots, poses, q)
    return _checked(robot, path, knots[: len(found)], found, poses, record, stop)


def _solve_samples(solver: IKSolver, knots: Array, poses: Array, q: Array) -> tuple[Array, IKRecord, Stop | None]:
    found, errors, iterations, stop = [], [], [], None
    for s, target in zip(knots, poses, strict=True):
        result = solver.solve(target, q)
        if not result:
            stop = _no_ik(solver, s, target, result, q)
            break
        q = result.q
        found.append(q)
        errors.append((result.position_error, result.rotation_error))
        iterations.append(result.iterations)
    e = np.array(errors).reshape(-1, 2)
    return np.array(found).reshape(-1, solver.robot.n), IKRecord(e[:, 0], e[:, 1], np.array(iterations, np.int64)), stop


def _no_ik(solver: IKSolver, s: float, target: Array, result: IKResult, before: Array) -> Stop:
    """Why no configuration was found: a joint that stands at its limit, a singular arm, or just the method's word."""
    robot, limits = solver.robot, solver.robot.limits
    J = robot.jacobian(before)
    smallest = float(np.linalg.svd(J, compute_uv=False)[-1])
    wanted = before + np.linalg.lstsq(J, robot.errors(before, target), rcond=None)[0]  # to first order
    beyond = np.maximum(limits.lower - wanted, wanted - limits.upper)
    joint = robot.joint_names[int(np.argmax(beyond))] if beyond.max() > -AT_LIMIT else None
    reason = (
        f"{solver.name} found no configuration at s = {s:.6g} ({result.status}: {1e3 * result.position_error:.3g} mm and "
        f"{np.degrees(result.rotation_error):.3g}° away); {joint + ' stands at its limit; ' if joint else ''}"
        f"smallest singular value just before: {smallest:.2g}"
    )
    kind = FollowStatus.OUTSIDE_LIMITS if result.status is IKStatus.OUTSIDE_LIMITS else FollowStatus.NO_IK
    return Stop(kind, float(s), joint, reason, "a shorter line, or another start configuration")


def _checked(
    robot: Robot, path: Path, knots: Array, q: Array, poses: Array, record: IKRecord, stop: Stop | None
) -> Followed:
    """Polish, check and differentiate the samples; keep those before the first that is wrong."""
    raw, poses = q.copy(), poses[: len(q)]
    kinematics.polish_batch(robot.fixed, robot.prismatic, robot.tool, q, poses, 6)
    residual = np.abs(robot.errors(q, poses)).max(axis=1, initial=0.0)
    moved = np.abs(q - raw).max(axis=1, initial=0.0)
    singular = np.linalg.svd(robot.jacobian(q), compute_uv=False)[:, -1]
    lost: Bools = (residual > POLISHED) | (moved > POLISH_MOVES) | (singular < SMALLEST_SINGULAR_VALUE)
    step = np.abs(np.diff(q, axis=0, prepend=q[:1]))
    checks: tuple[tuple[Bools, Callable[[int], Stop]], ...] = (
        (lost, lambda i: _singular(knots[i], singular[i])),
        (np.logical_not(robot.limits.contains(q)), lambda i: _outside(robot, knots[i], q[i])),
        (np.asarray((step > LARGEST_STEP).any(axis=1)), lambda i: _jump(robot, knots[i], step[i])),
    )
    good = len(q)
    for wrong, why in checks:
        good, stop = _before_first(wrong[:good], why, stop)
    if good < 2:
        return Followed(None, stop)
    derivatives = np.empty((good, 3, robot.n))
    twists = np.stack([path.twist(knots[:good], order) for order in (1, 2, 3)], axis=1)
    kinematics.path_derivatives(robot.fixed, robot.prismatic, robot.tool, q[:good], twists, derivatives)
    spline = through(knots[:good], q[:good], derivatives[:, 0], derivatives[:, 1])
    off = np.r_[0.0, _between(robot, path, spline, np.array([0.5])).max(axis=1)]
    kept, stop = _before_first(off > PATH_TOLERANCE, lambda i: _off(knots[i], off[i]), stop)
    if kept < 2:
        return Followed(None, stop)
    return Followed(JointPath(robot, path, knots[:kept], q[:kept], derivatives[:kept], _cut(record, kept)), stop)


def _before_first(wrong: Bools, why: Callable[[int], Stop], stop: Stop | None) -> tuple[int, Stop | None]:
    """How many samples come before the first wrong one, and the reason; the old reason where none is wrong."""
    if not wrong.any():
        return wrong.size, stop
    i = int(np.argmax(wrong))
    return i, why(i)


def _apart(knots: Array) -> NDArray[np.int64]:
    """Indices of knots that stand apart; the ends always."""
    chosen = [0]
    for i in range(1, len(knots) - 1):
        if knots[i] - knots[chosen[-1]] >= APART and knots[-1] - knots[i] >= APART:
            chosen.append(i)
    return np.array([*chosen, len(knots) - 1])


def _cut(record: IKRecord, k: int) -> IKRecord:
    return IKRecord(record.position_error[:k], record.rotation_error[:k], record.iterations[:k])


def _between(robot: Robot, path: Path, spline: Any, fractions: Array) -> Array:
    """Worst distance [m] and angle [rad] to the path at the same s in each interval of a spline, (k − 1, 2)."""
    s = (spline.x[:-1, None] + np.diff(spline.x)[:, None] * fractions).ravel()
    e = se3.error(robot.fk(spline(s)), path.pose(s))
    norms = np.stack([np.linalg.norm(e[:, :3], axis=1), np.linalg.norm(e[:, 3:], axis=1)], axis=1)
    worst: Array = norms.reshape(-1, fractions.size, 2).max(axis=1)
    return worst


def _singular(s: float, value: float) -> Stop:
    return Stop(
        FollowStatus.SINGULAR,
        float(s),
        None,
        f"the arm is singular at s = {s:.6g} (smallest singular value {value:.2g})",
        "another start configuration, or a line that keeps away from the singularity",
    )


def _outside(robot: Robot, s: float, q: Array) -> Stop:
    lower, upper = robot.limits.lower, robot.limits.upper
    i = int(np.argmax(np.maximum(lower - q, q - upper)))
    return Stop(
        FollowStatus.OUTSIDE_LIMITS,
        float(s),
        robot.joint_names[i],
        f"{robot.joint_names[i]} leaves its range [{lower[i]:.4g}, {upper[i]:.4g}] at s = {s:.6g}",
        "a shorter line or another start configuration",
    )


def _jump(robot: Robot, s: float, step: Array) -> Stop:
    i = int(np.argmax(step))
    return Stop(
        FollowStatus.BRANCH_JUMP,
        float(s),
        robot.joint_names[i],
        f"{robot.joint_names[i]} moves {step[i]:.3g} rad in one step at s = {s:.6g}: a branch jump, or too few samples",
        "more samples; if it stays, another start configuration",
    )


def _off(s: float, distance: float) -> Stop:
    return Stop(
        FollowStatus.BRANCH_JUMP,
        float(s),
        None,
        f"between samples the tool leaves the path by {distance:.2g} (m or rad) before s = {s:.6g}",
        "more samples; if it stays, another start configuration",
    )
