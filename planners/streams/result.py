"""Retargeted: the motion to a new target, its relation to the target, and its certificate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from optik.arm.motors import ranges_of
from optik.arm.robot import Robot
from optik.check import describe_ratio, format_ratio
from optik.scene import Scene
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis, find_position_violations, reach_of
from planners.certificate.certificate import RATIO_ROUNDING
from planners.certificate.clearance import Clearance, clearance
from planners.certificate.violation import Violation, word_of_limit
from planners.limits import DERIVATIVES, LOADED, TOOL_SPEEDS, Extreme, MotionLimits, ToolExtreme, kind_of
from planners.limits.base import sides
from planners.streams.motion import JointCubics, cubic_extrema
from planners.streams.reference import BASIS
from planners.trajectory import State, Trajectory, shift_pieces

# ---------------- the certificate of a motion that joins another one


CONTINUOUS = 1e-9
"""Largest discontinuity of q, q̇ and q̈ that counts as rounding [rad, rad/s, rad/s², or m]."""
EXCESS = 1e-9
"""Largest excess of a ratio over 1 that counts as rounding: the state may stand exactly on a limit."""


@dataclass(frozen=True, eq=False, repr=False)
class StreamCertificate:
    """Proved properties of a motion from a moving state to rest.

    Attributes
    ----------
    joint_names : tuple of str
        Of the position margins.
    duration : float
        Of the motion [s].
    position_margin, t_position_margin : (n,) array
        Least distances to the position limits, exact [rad, m], and their times [s].
    subjects : mapping of str to tuple of str
        What each limit bounds: the joints, the tool, or combinations of joints.
    peaks : mapping of str to Extreme or ToolExtreme
        Peak values and their ratios to the limits: exact for velocity, acceleration and jerk, proved bounds for others.
    discontinuity : (3,) array
        Largest discontinuities of q, q̇ and q̈, also to the motion that it continues and to the rest at its end.
    clearance : Clearance or None
        Proved least distances between arm, scene and links; None without a scene.
    not_covered : tuple of str
        Properties that are not examined.
    """

    joint_names: tuple[str, ...]
    duration: float
    position_margin: Array
    t_position_margin: Array
    subjects: Mapping[str, tuple[str, ...]]
    peaks: Mapping[str, Extreme | ToolExtreme]
    discontinuity: Array
    clearance: Clearance | None
    not_covered: tuple[str, ...]

    @cached_property
    def violations(self) -> tuple[Violation, ...]:
        """The violations: first those of positions, then those of limits, the largest first; empty if there is none."""
        found = find_position_violations(self.position_margin, self.joint_names, self.t_position_margin)
        for name, peak in sorted(self.peaks.items(), key=lambda item: -np.nanmax(item[1].ratio, initial=0.0)):
            if not np.any(peak.ratio > 1.0):
                continue
            ratio, where, t = peak.worst(self.subjects[name])
            if ratio > 1.0 + (EXCESS if name in DERIVATIVES else RATIO_ROUNDING):
                words = f"{name} of {where} is {describe_ratio(ratio)} at t = {t:.6g} s"
                found.append(Violation(words, t, word_of_limit(name), where if kind_of(name).subject is None else None))
        for value, name in zip(self.discontinuity, ("position", "velocity", "acceleration"), strict=True):
            if not value <= CONTINUOUS:
                found.append(Violation(f"the {name} is discontinuous by {value:.3g}", 0.0, "limits"))
        return (*found, *(() if self.clearance is None else self.clearance.find_violations()))

    @property
    def reasons(self) -> tuple[str, ...]:
        """Texts of the violations; empty if the certificate is valid."""
        return tuple(violation.words for violation in self.violations)

    @property
    def is_valid(self) -> bool:
        """Whether all limits are respected at every instant, the motion is continuous, and it ends at rest."""
        return not self.violations

    def __repr__(self) -> str:
        return str(self)

    def __str__(self) -> str:
        verdict = "valid" if self.is_valid else f"NOT valid: {self.reasons[0]}"
        lines = [f"certificate {verdict}", f"duration {self.duration:.3g} s, then at rest"]
        for name, peak in self.peaks.items():
            ratio, where, t = peak.worst(self.subjects[name])
            lines += [] if np.isnan(ratio) else [f"peak / limit, {name}: {format_ratio(ratio)} ({where} at {t:.3g} s)"]
        return "\n".join([*lines, f"not covered: {', '.join(self.not_covered)}"])


def other_limits(limits: MotionLimits) -> tuple[str, ...]:
    """Return the names of the given limits that are not derivatives of single joints."""
    return tuple(name for name in limits.names if name not in DERIVATIVES and limits.value(name) is not None)


def trajectory_of(curve: JointCubics | Trajectory) -> Trajectory:
    """Return a motion as a trajectory."""
    return curve.trajectory if isinstance(curve, JointCubics) else curve


def certify_joined(
    robot: Robot, curve: JointCubics | Trajectory, limits: MotionLimits, state: Array, scene: Scene | None
) -> StreamCertificate:
    """Return the certificate of a motion that continues a state (3, n) of the running motion."""
    out, jump = np.empty((4, 4, robot.n)), np.empty(3)
    if isinstance(curve, JointCubics):
        cubic_extrema(curve.knots, curve.count, curve.c, state, out, jump)
    else:
        out[:] = [curve.extrema(order) for order in range(4)]
        first, last = np.array([curve.ends(order) for order in range(3)]).swapaxes(0, 1)
        steps = np.concatenate([first[:, :1] - state[:, None], first[:, 1:] - last[:, :-1]], axis=1)
        jump[:] = np.maximum(np.abs(steps).max(axis=(1, 2)), [0.0, *np.abs(last[1:, -1]).max(axis=1)])
    reach, limited = out[0], ranges_of(robot)
    if robot.motors is not None:
        reach = np.array(reach_of(robot, trajectory_of(curve))[0])
    lower, upper = reach[0] - limited.lower, limited.upper - reach[1]
    bounds, others = limits.bounds(robot.n), other_limits(limits)
    least, greatest, t_least, t_greatest = out[1:].swapaxes(0, 1)
    low, high = np.array([sides(bounds[name]) for name in DERIVATIVES]).swapaxes(0, 1)
    below, above = least / low, greatest / high
    down = below > above
    worst = np.where(down, -least, greatest), np.maximum(below, above), np.where(down, t_least, t_greatest)
    peaks: dict[str, Extreme | ToolExtreme] = {name: Extreme(*x) for name, *x in zip(DERIVATIVES, *worst, strict=True)}
    if others:
        motion = MotionAnalysis(robot, trajectory_of(curve))
        peaks |= {name: kind_of(name).judge(motion, bounds[name]) for name in others}
    subjects = {name: kind_of(name).subjects(robot, bounds[name]) for name in peaks}
    free = [name.replace("_", " ") for name in (*LOADED, *TOOL_SPEEDS) if name not in others]
    return StreamCertificate(
        limited.names, curve.end, np.minimum(lower, upper), np.where(lower < upper, reach[2], reach[3]), subjects, peaks,
        jump,
        None if scene is None else clearance(robot, trajectory_of(curve), scene),
        ("the path of the tool", *free, *([] if scene is not None else ["contact"])),
    )  # fmt: skip


# ---------------- retargeted


JOINED_WITHIN = 0.01
"""Distance of every joint to the paced chunk at which a motion has joined it [rad, m]."""


class RetargetStatus(StrEnum):
    """The kind of motion that `retarget` found.

    JOINED: it goes onto the chunk or the plan. GOAL: it goes to joints, or at a velocity. KEPT: it is the running motion,
    because no other was proved.
    """

    JOINED = "joined"
    GOAL = "goal"
    KEPT = "kept"


class PacedReference(NamedTuple):
    """The paced reference of a chunk.

    ``c`` (k, n) are the coefficients of a uniform quintic B-spline with intervals ``h`` [s] of the chunk's time. ``s`` is the
    chunk's time at the instants ``when`` (m,) of the motion [s], linear between them. ``error`` [rad, m] is the largest
    distance to a target.
    """

    c: Array
    h: float
    when: Array
    s: Array
    error: float

    def error_of(self, motion: Trajectory) -> Trajectory:
        """Return the difference between a motion and the paced reference, as exact polynomials."""
        k, at, s = len(self.c), self.when, self.s
        windows = np.lib.stride_tricks.sliding_window_view(self.c, 6, axis=0)  # (k − 5, n, 6)
        spline = np.einsum("ap,ina->pin", BASIS[0] / self.h ** np.arange(6), windows)[::-1]
        inside = np.arange(1, k - 5) * self.h
        crossed = np.interp(inside[(inside > s[0]) & (inside < s[-1])], s, at)
        t = np.unique(np.concatenate([motion.knots, at[at < motion.end], crossed[crossed < motion.end]]))
        t = t[np.append(True, np.diff(t) > 1e-12)]
        begin, middle = t[:-1], 0.5 * (t[:-1] + t[1:])
        piece = np.searchsorted(motion.knots, middle) - 1
        q = shift_pieces(motion.padded[:, piece], begin - motion.knots[piece])
        i = np.clip(np.searchsorted(at, middle) - 1, 0, at.size - 2)
        moves = (middle > at[0]) & (middle < at[-1])
        rate = np.where(moves, (s[i + 1] - s[i]) / (at[i + 1] - at[i]), 0.0)
        place = np.interp(begin, at, s)
        span = np.clip((np.interp(middle, at, s) / self.h).astype(int), 0, k - 6)
        r = shift_pieces(spline[:, span], place - span * self.h)
        return Trajectory(scipy.interpolate.PPoly(q - r * rate[:, None] ** np.arange(5, -1, -1)[:, None, None], t))


@dataclass(frozen=True, eq=False)
class Retargeted:
    """The result of `retarget`: a motion from the running motion's state to rest. ``bool(result)``: it goes to the target.

    Attributes
    ----------
    status : RetargetStatus
        JOINED, GOAL or KEPT.
    reason : str
        Why the running motion was kept; empty otherwise.
    robot, limits
        The arm, and the limits that the certificate covers.
    at : float
        Time of the running motion at which this motion begins [s].
    curve : JointCubics or Trajectory
        The motion as it was found; `trajectory` is the same.
    certificate : StreamCertificate
        Of the motion; of a kept one for these limits, which it may exceed, and without its scene.
    skipped, repaired : int
        Targets of the chunk before its entry, and targets that were changed. A target is changed if it is outside the ranges,
        or if it alone repeats the one before.
    reference : PacedReference or None
        The paced reference of a chunk.
    clipped, jumps : int
        Targets of the chunk that were clipped to the ranges; those at which a joint with limits jumps by more than π.
    scatter : float
        Largest standard deviation of the chunk's targets about a smooth curve, over the joints [rad, m].
    cut : str
        Why a chunk of poses ends before its last one; empty if it does not.
    """

    status: RetargetStatus
    reason: str
    robot: Robot
    limits: MotionLimits
    at: float
    curve: JointCubics | Trajectory
    certificate: StreamCertificate
    skipped: int = 0
    repaired: int = 0
    reference: PacedReference | None = field(default=None, repr=False)
    clipped: int = 0
    jumps: int = 0
    scatter: float = 0.0
    cut: str = ""

    def __bool__(self) -> bool:
        return self.status is not RetargetStatus.KEPT

    def __str__(self) -> str:
        words = {
            RetargetStatus.JOINED: "joins the target",
            RetargetStatus.GOAL: "goes to the target",
            RetargetStatus.KEPT: f"keeps the running motion: {self.reason}",
        }
        lines = [f"{words[self.status]}, from t = {self.at:.6g} s"]
        if self.reference is not None and self:
            after = self.joined_after
            when = "never" if after is None else f"after {after:.3g} s"
            lines.append(f"within {1e3 * JOINED_WITHIN:g} mrad of the paced chunk {when}, pace {self.pace:.3g}")
            lines.append(f"{self.skipped} targets skipped, {self.repaired} repaired")
        return "\n".join([*lines, *([self.cut] if self and self.cut else []), str(self.certificate)])

    def state(self, t: float) -> State:
        """Return position, velocity and acceleration.

        Parameters
        ----------
        t : float
            Time since `at` [s]; after the end the arm is at rest.

        Returns
        -------
        tuple of (n,) arrays
            q, q̇, q̈ [rad, rad/s, rad/s², or m].
        """
        return state_of(self.trajectory, t)

    @cached_property
    def trajectory(self) -> Trajectory:
        """The motion, ``trajectory(t, order)`` for t [s] since `at`, as a `Trajectory`, which `planners.certify` judges."""
        return trajectory_of(self.curve)

    @property
    def pace(self) -> float:
        """Mean rate at which the motion goes through the chunk, over that of the chunk [1]; 1 without a chunk."""
        if self.reference is None:
            return 1.0
        when, s = self.reference.when, self.reference.s
        done = np.flatnonzero(s >= s[-1] - 1e-9)[0]
        return float((s[done] - s[0]) / (when[done] - when[0]))

    @cached_property
    def _error(self) -> Trajectory | None:
        return None if self.reference is None else self.reference.error_of(self.trajectory)

    @cached_property
    def joined_after(self) -> float | None:
        """Time since `at` from which every joint stays within 10 mrad of the paced chunk, proved [s]; None if there is none."""
        if self._error is None or not self:
            return None
        far = np.flatnonzero(self._error.piece_worst(0).max(axis=1) > JOINED_WITHIN)
        t = self._error.knots
        if far.size and far[-1] == t.size - 2:
            return None
        return float(t[far[-1] + 1]) if far.size else 0.0

    @property
    def deviation(self) -> float | None:
        """Proved largest distance of a joint to the paced chunk after `joined_after`, else of the whole motion [rad, m]."""
        if self._error is None:
            return None
        after = 0.0 if self.joined_after is None else self.joined_after
        return float(self._error.piece_worst(0)[self._error.knots[:-1] >= after].max())


def state_of(trajectory: Trajectory, t: float) -> State:
    """Return q, q̇ and q̈ of a motion at a time [s]; after its end it is at rest."""
    if t >= trajectory.end:
        q = trajectory(trajectory.end)
        return q, np.zeros_like(q), np.zeros_like(q)
    return trajectory(t), trajectory(t, 1), trajectory(t, 2)
