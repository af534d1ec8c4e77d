"""Ruckig on the path parameter s, section by section: jerk-limited motion with bounds for each section."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import ruckig

from optik.errors import NoSolution
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.following.follow import JointPath
from planners.limits import ALL_LIMITS, MotionLimits
from planners.motion.motion import stretch_analysed
from planners.timing._sectional import Ramp, constant_limits, find_sections, law_of, make_table, phases_of, profile
from planners.timing.base import TimeLaw, refit
from planners.timing.smooth import least_duration

SHORTEST_CRUISE = 1e-9
"""Least time at constant speed between two ramps, over the time of one: a shorter one is rounding."""


def velocity_control(
    start: tuple[float, float], goal: tuple[float, float], acceleration: float, jerk: float
) -> list[tuple[float, float]]:
    """Return the phases (duration, jerk) of the time-optimal motion between two states (Berscheid and Kröger, RSS 2021).

    Ruckig's velocity interface: it has no target position that could be overshot, and its polynomial roots stay well apart. The
    position interface ends the whole process where a distance is just the least one (0.19.4: an exception that cannot
    be caught).
    """
    problem, answer = ruckig.InputParameter(1), ruckig.Trajectory(1)
    problem.control_interface = ruckig.ControlInterface.Velocity
    problem.current_position = [0.0]
    problem.current_velocity, problem.current_acceleration = [start[0]], [start[1]]
    problem.target_velocity, problem.target_acceleration = [goal[0]], [goal[1]]
    problem.max_acceleration, problem.max_jerk = [acceleration], [jerk]
    try:
        result = ruckig.Ruckig(1).calculate(problem, answer)
    except ruckig.RuckigError:  # numbers too far apart for its roots
        result = ruckig.Result.Error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise NoSolution(f"Ruckig found no motion along s ({result})")
    profile = answer.profiles[0][0]
    phases = [*zip(profile.brake.t, profile.brake.j, strict=True), *zip(profile.t, profile.j, strict=True)]
    return [(float(h), float(j)) for h, j in phases if h > 0.0]


class RuckigLaw(TimeLaw):
    """Sections of s, each with its own bounds on ṡ, s̈ and s⃛, so that one bad point does not slow the whole path.

    Dynamic programming over candidate path parameters and speeds finds a chain of ramps. Each ramp is evaluated at sampled
    instants by the chain rule, q̈ = q' s̈ + q'' ṡ² and q⃛ = q' s⃛ + 3 q'' ṡ s̈ + q''' ṡ³. A local search then improves the ends,
    the speeds and the shapes. Each ramp is two sections, divided at its greatest acceleration, with this acceleration and a
    jerk as bounds. Ruckig (Berscheid and Kröger, RSS 2021) computes the motion of each section. Finally the whole motion is
    stretched uniformly until its exact extrema respect the limits. On a straight line in joint space, whose limits are the same
    everywhere, the motion is one section from rest to rest.

    Ruckig is used on the scalar s only: its joint waypoints would leave the path, and are sent to a cloud service.
    """

    name: ClassVar[str] = "ruckig"
    enforced: ClassVar[tuple[str, ...]] = ALL_LIMITS

    def _time(self, joint_path: JointPath, limits: MotionLimits) -> MotionAnalysis:
        bound, table = limits.arrays(joint_path.robot.n), make_table(joint_path, limits)
        if (constant := constant_limits(joint_path.path, table)) is None:
            ramps = find_sections(table, joint_path.path.breaks, least_duration(joint_path, limits))
            law = law_of(ramps, [_solve(ramp) for ramp in ramps])
        else:
            law = law_of([Ramp(0.0, 0.0, joint_path.end, 0.0, 0.5, 0.5)], [_cross(joint_path.end, *constant)])
        motion = MotionAnalysis(joint_path.robot, refit(joint_path, law, bound["jerk"]), joint_path.path)
        return stretch_analysed(motion, limits, self.list_enforced(limits))


def _cross(length: float, speed: float, acceleration: float, jerk: float) -> Array:
    """Return the phases (·, 2) of the time optimum from rest to rest over a length with constant limits on ṡ, s̈ and s⃛."""
    # the greatest speed after half the length: with a constant acceleration v² / a + v a / j = length, else 2 √(v³ / j)
    peak = acceleration**2 / jerk
    flat = 0.5 * peak * (np.sqrt(1.0 + 4.0 * length * acceleration / peak**2) - 1.0)
    speed = min(speed, flat if flat >= peak else np.cbrt(0.25 * jerk * length**2))
    up = np.array(velocity_control((0.0, 0.0), (speed, 0.0), acceleration, jerk))
    rise = up[:, 0].sum()
    cruise = length / speed - rise
    return np.concatenate([up, [[cruise, 0.0]] if cruise > SHORTEST_CRUISE * rise else np.empty((0, 2)), up[::-1]])


def _solve(ramp: Ramp) -> Array:
    """Return the phases (·, 2) of a ramp: durations and jerks from Ruckig for its two sections.

    Speeds are relative to v0 in units of v1 − v0, and times in units of the ramp's duration, so that Ruckig's numbers are of
    size 1 on any path. Between v0 and v1 the speed is monotonic.
    """
    wanted = phases_of(ramp)
    if len(wanted) == 1:
        return wanted  # at constant speed there is nothing to solve
    duration, _ = profile(ramp.s1 - ramp.s0, ramp.v0, ramp.v1, ramp.rise, ramp.fall)
    rise, flat, fall = wanted[:, 0] / duration
    peak = 1.0 / (1.0 - 0.5 * (rise + fall))
    half = peak * 0.5 * (rise + flat)  # the speed in the middle of the flat part
    first = _section((0.0, 0.0), (half, peak), peak, peak / rise)
    second = _section((half, peak), (1.0, 0.0), peak, peak / fall)
    phases = np.array([first[0], first[1] + second[0], second[1]])
    if not np.allclose(phases, (rise, flat, fall), rtol=0.0, atol=1e-7):
        raise NoSolution(f"Ruckig left the section from s = {ramp.s0:.6g} to {ramp.s1:.6g}", s=ramp.s0)
    peak = (ramp.v1 - ramp.v0) / (duration * (0.5 * phases[0] + phases[1] + 0.5 * phases[2]))  # v1, to the last bit
    phases *= duration
    return np.array([[phases[0], peak / phases[0]], [phases[1], 0.0], [phases[2], -peak / phases[2]]])


def _section(start: tuple[float, float], goal: tuple[float, float], acceleration: float, jerk: float) -> list[float]:
    """Return the durations of Ruckig's two phases from one (speed, acceleration) to another."""
    times = [h for h, _ in velocity_control(start, goal, acceleration, jerk) if h > 1e-9]
    if len(times) != 2:
        raise NoSolution(f"Ruckig found {len(times)} phases for a section of two")
    return times


METHOD = RuckigLaw
