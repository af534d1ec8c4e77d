"""Trajectories of serial arms along paths, with a certificate of the limits that they respect."""

from planners.certificate.certificate import Certificate
from planners.certificate.certification import certify
from planners.files import load_motion, save
from planners.files.setpoints import load_trajectory
from planners.following.follow import follow
from planners.group.combine import combine
from planners.group.result import GroupPlan
from planners.limits import MotionLimits
from planners.limits.moveit import load_limits
from planners.motion import Motion, stretch_to_limits
from planners.paths import Path
from planners.paths.arc import Arc
from planners.paths.free_path import free
from planners.paths.joint_line import JointLine
from planners.paths.line import Line
from planners.paths.point_to_point import PointToPoint
from planners.paths.polyline import Polyline
from planners.paths.spline import Spline
from planners.plan import plan
from planners.planning import Plan
from planners.program import Part, Program, ProgramPlan, load_program
from planners.replan import replan
from planners.ros.export import to_ros
from planners.search import SearchResult, find_path
from planners.streams import Retargeted, retarget, stream
from planners.timing import laws, make_law
from planners.trajectory import Trajectory

__all__ = [  # noqa: RUF022 -- by task
    # plan a motion
    "plan", "combine", "free", "follow", "find_path", "laws", "make_law",
    # paths, limits, programs
    "Path", "Line", "Arc", "Polyline", "Spline", "JointLine", "PointToPoint", "MotionLimits", "load_limits", "Program", "Part",
    "load_program",
    # what results
    "Plan", "ProgramPlan", "GroupPlan", "Motion", "Trajectory", "Certificate", "SearchResult", "Retargeted",
    # prove, store, send
    "certify", "stretch_to_limits", "save", "load_motion", "load_trajectory", "to_ros",
    # while the arm moves
    "replan", "retarget", "stream",
]  # fmt: skip
