"""Trajectories of serial arms along paths, with a certificate of the limits that they respect."""

from optik.scene import Scene
from planners.certificate.active import Binding
from planners.certificate.certificate import Certificate, certify
from planners.certificate.clearance import Clearance, Closest
from planners.certificate.path_error import PathError
from planners.controller import simulate_controller
from planners.curve import Curve
from planners.files import formats, load_motion, save
from planners.files._setpoints import load_trajectory
from planners.following.follow import Followed, FollowStatus, JointPath, PlanFailure, follow
from planners.limits import MotionLimits
from planners.motion import Motion
from planners.paths import Path, make_path, path_of, paths
from planners.paths.arc import Arc
from planners.paths.joint_line import JointLine
from planners.paths.line import Line
from planners.paths.polyline import Polyline
from planners.plan import Plan, PlanSeconds, PlanStatus, plan
from planners.replan import replan
from planners.ros.export import from_ros, to_ros
from planners.timing import TimeLaw, laws, make_law
from planners.trajectory import Trajectory

__all__ = [
    "Arc",
    "Binding",
    "Certificate",
    "Clearance",
    "Closest",
    "Curve",
    "FollowStatus",
    "Followed",
    "JointLine",
    "JointPath",
    "Line",
    "Motion",
    "MotionLimits",
    "Path",
    "PathError",
    "Plan",
    "PlanFailure",
    "PlanSeconds",
    "PlanStatus",
    "Polyline",
    "Scene",
    "TimeLaw",
    "Trajectory",
    "certify",
    "follow",
    "formats",
    "from_ros",
    "laws",
    "load_motion",
    "load_trajectory",
    "make_law",
    "make_path",
    "path_of",
    "paths",
    "plan",
    "replan",
    "save",
    "simulate_controller",
    "to_ros",
]
