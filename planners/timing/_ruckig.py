"""Call of Ruckig: time-optimal motion from one (speed, acceleration) to another on one axis."""

from __future__ import annotations

import ruckig

from optik.errors import NoSolution


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
    found = answer.profiles[0][0]
    phases = [*zip(found.brake.t, found.brake.j, strict=True), *zip(found.t, found.j, strict=True)]
    return [(float(h), float(j)) for h, j in phases if h > 0.0]
