"""A certified motion with its arm, path and limits; and the fit of motions to limits."""

from planners.motion.motion import Event, HasMotion, Motion, PlanStatus, get_motion, stretch_to_limits

__all__ = ["Event", "HasMotion", "Motion", "PlanStatus", "get_motion", "stretch_to_limits"]
