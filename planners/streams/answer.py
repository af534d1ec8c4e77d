"""retarget(): from the moving state of the running motion onto another target, within the limits, in about a millisecond."""

from __future__ import annotations

from collections import deque
from typing import Any

from optik.arm.robot import Robot
from optik.check import check_number, format_value
from optik.errors import InvalidInput
from optik.scene import Scene
from planners.limits import MotionLimits
from planners.motion.motion import Motion, get_motion
from planners.planning.result import Plan
from planners.streams.engine import Retargeter
from planners.streams.result import Retargeted
from planners.streams.stream import begin


def retarget(
    motion: Any, at: float, onto: Any, *, limits: MotionLimits | None = None, tolerance: float = 0.005,
    pace: float = 1.0, align: str = "nearest", longest: float = 0.04, scene: Scene | None = None,
    robot: Robot | None = None,
) -> Retargeted:  # fmt: skip
    """Return a motion from the moving state of the running motion onto another target.

    A chunk is followed as closely as the limits allow: repeated targets are repaired, the targets are smoothed within the
    tolerance, their pace is lowered where the limits demand it, and the joints track them. Joints and plans are entered by
    time-optimal motions. Every result ends at rest. If none is proved, the running motion goes on, without a new proof.

    Parameters
    ----------
    motion : Plan, Motion or Retargeted; with `robot` also Trajectory or (3, n) array
        The running motion, or the measured state (q, q̇, q̈) at ``at=0``; then the running motion is the stop from this state.
    at : float
        Its time at which the new motion begins [s].
    onto : Chunk, (n,) array, or Plan, Motion or Retargeted
        Targets at a fixed rate; joints to stop at [rad, m]; or another motion, which is entered where it ends soonest.
    limits : MotionLimits, optional
        By default those of the running motion, or of `robot`. Velocity, acceleration and jerk of all joints must be limited.
    tolerance : float
        Largest distance between a target and the smoothed chunk [rad, m]; four times it where they scatter.
    pace : float
        Largest rate of the chunk, over its own; above 1 to be faster than the chunk says [1].
    align : {"nearest", "clock"}
        "nearest" enters the chunk where it is nearest to the arm, but not later than by its clock; "clock" by its clock.
    longest : float
        Longest duration of a piece [s]: shorter ones follow more closely, at more work. Slow motions have longer ones.
    scene : Scene, optional
        Obstacles, which the motion is proved to avoid.
    robot : Robot, optional
        The arm of a trajectory or a state.

    Returns
    -------
    Retargeted
        The motion and its certificate. JOINED for a chunk or a motion, GOAL for joints, KEPT if the running motion goes on.

    Raises
    ------
    InvalidInput
        An argument of another type, size or range, a missing limit, or a state that is not stopped within the limits.
    """
    at = check_number(at, "at", "a time of the running motion [s], at least 0", least=0.0)
    options: dict[str, Any] = {"tolerance": tolerance, "pace": pace, "align": align, "longest": longest}
    if robot is None:
        if not isinstance(motion, Retargeted | Plan | Motion) and not hasattr(motion, "motion"):
            expected = "a Plan, Motion or Retargeted; or with robot= also a Trajectory or a state (q, q̇, q̈)"
            raise InvalidInput("motion", format_value(motion, 60), expected)
        motion = motion if isinstance(motion, Retargeted | Plan) else get_motion(motion)
        robot, limits = motion.robot, motion.limits if limits is None else limits
    for known in _engines:
        same = known.robot is robot and known.limits is limits and known.scene is scene
        if same and all(isinstance(x, float | str) and x == getattr(known, name) for name, x in options.items()):
            break
    else:
        known = Retargeter(robot, limits, scene=scene, **options)
        _engines.appendleft(known)
    return known.run(begin(known, motion, "motion"), at, onto)


_engines = deque[Retargeter](maxlen=4)
"""Those of the last calls, which the next call with the same objects uses again."""
