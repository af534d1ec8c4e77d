"""StreamCertificate: what is proved of a motion that joins a running one, within a fraction of a millisecond."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from optik.arm.motors import ranges_of
from optik.arm.robot import Robot
from optik.check import format_ratio
from optik.scene import Scene
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.certificate import RATIO_ROUNDING
from planners.certificate.checks import find_position_violations, reach_of
from planners.certificate.clearance import Clearance, clearance
from planners.certificate.violation import Violation, word_of_limit
from planners.limits import DERIVATIVES, LOADED, TOOL_SPEEDS, Extreme, MotionLimits, ToolExtreme, kind_of
from planners.limits.base import sides
from planners.retarget.cubics import JointCubics, cubic_extrema
from planners.trajectory import Trajectory

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
                words = f"{name} of {where} is {format_ratio(ratio)} of its limit at t = {t:.6g} s"
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
            lines += [] if np.isnan(ratio) else [f"peak / limit, {name}: {ratio:.3g} ({where} at {t:.3g} s)"]
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
    found = np.where(down, -least, greatest), np.maximum(below, above), np.where(down, t_least, t_greatest)
    peaks: dict[str, Extreme | ToolExtreme] = {name: Extreme(*x) for name, *x in zip(DERIVATIVES, *found, strict=True)}
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
