"""planners: which way an arm moves, and how fast, with a certificate of what the motion keeps."""

from planners.certificate import Certificate, certify
from planners.curve import Curve
from planners.follow import Followed, FollowStatus, JointPath, Stop, follow
from planners.paths.line import Line
from planners.plan import Plan, PlanStatus, laws, make_law, plan
from planners.timing.base import MotionLimits, TimeLaw
from planners.trajectory import Trajectory

__all__ = [
    "Certificate",
    "Curve",
    "FollowStatus",
    "Followed",
    "JointPath",
    "Line",
    "MotionLimits",
    "Plan",
    "PlanStatus",
    "Stop",
    "TimeLaw",
    "Trajectory",
    "certify",
    "follow",
    "laws",
    "make_law",
    "plan",
]
