"""retarget(): from the moving state of the running motion onto another target, within the limits, in about a millisecond."""

from __future__ import annotations

from collections import deque
from typing import Any

from optik.check import check_number
from optik.scene import Scene
from planners.limits import MotionLimits
from planners.motion.motion import Motion, get_motion
from planners.planning.result import Plan
from planners.retarget.engine import Retargeter
from planners.retarget.result import Retargeted


def retarget(
    motion: Motion | Plan | Retargeted, at: float, onto: Any, *, limits: MotionLimits | None = None,
    tolerance: float = 0.005, pace: float = 1.0, align: str = "nearest", longest: float = 0.04,
    scene: Scene | None = None,
) -> Retargeted:  # fmt: skip
    """Return a motion from the moving state of the running motion onto another target.

    A chunk is followed as closely as the limits allow: repeated targets are repaired, the targets are smoothed within the
    tolerance, their pace is lowered where the limits demand it, and the joints track them. Joints and plans are entered by
    time-optimal motions. Every result ends at rest. If none is proved, the running motion goes on, without a new proof.

    Parameters
    ----------
    motion : Plan, Motion or Retargeted
        The running motion.
    at : float
        Its time at which the new motion begins [s].
    onto : Chunk, (n,) array, or Plan, Motion or Retargeted
        Targets at a fixed rate; joints to stop at [rad, m]; or another motion, which is entered where it ends soonest.
    limits : MotionLimits, optional
        By default those of the running motion. Velocity, acceleration and jerk of all joints must be limited.
    tolerance : float
        Largest distance between a target and the smoothed chunk [rad, m].
    pace : float
        Largest rate of the chunk, over its own; above 1 to be faster than the chunk says [1].
    align : {"nearest", "clock"}
        Enter the chunk at the place nearest to the arm, to within the tolerance, but not later than by its clock; or by its
        clock.
    longest : float
        Longest duration of a piece of the motion [s]; shorter pieces follow more closely and take more computing time.
    scene : Scene, optional
        Obstacles, which the motion is proved to avoid.

    Returns
    -------
    Retargeted
        The motion with its certificate. JOINED for a chunk or a motion, GOAL for joints, KEPT with the reason if the running
        motion goes on.

    Raises
    ------
    InvalidInput
        An argument of another type or out of range, a missing limit, or a target of another number of joints.
    """
    at = check_number(at, "at", "a time of the running motion [s], at least 0", least=0.0)
    if not isinstance(motion, Retargeted | Plan):
        motion = get_motion(motion)
    options: dict[str, Any] = {"tolerance": tolerance, "pace": pace, "align": align, "longest": longest}
    limits = motion.limits if limits is None else limits
    for known in _engines:
        same = known.robot is motion.robot and known.limits is limits and known.scene is scene
        if same and all(isinstance(x, float | str) and x == getattr(known, name) for name, x in options.items()):
            return known.run(motion.trajectory, at, onto)
    _engines.appendleft(Retargeter(motion.robot, limits, scene=scene, **options))
    return _engines[0].run(motion.trajectory, at, onto)


_engines = deque[Retargeter](maxlen=4)
"""Those of the last calls, which the next call with the same objects uses again."""
