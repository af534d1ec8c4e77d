"""Trajectories of serial arms along paths, with a certificate of the limits that they respect."""

from planners.certificate.certificate import Certificate
from planners.certificate.certification import certify
from planners.files import load_motion, save
from planners.files.setpoints import load_trajectory
from planners.following.follow import follow
from planners.limits import MotionLimits
from planners.limits.acceleration_by_velocity import AccelerationByVelocity
from planners.limits.grip import Grip
from planners.limits.moveit import load_limits
from planners.limits.open_container import OpenContainer
from planners.limits.suction import Suction
from planners.limits.tray import Tray
from planners.motion import Motion
from planners.motion.motion import Event
from planners.paths import Path, make_path, paths
from planners.paths.arc import Arc
from planners.paths.free_path import free
from planners.paths.joint_line import JointLine
from planners.paths.line import Line
from planners.paths.point_to_point import PointToPoint, ViaPoint
from planners.paths.polyline import Polyline
from planners.paths.spline import Spline
from planners.plan import Plan, PlanStatus, plan
from planners.program.events import PathEvent, PeriodicEvent, TimedEvent
from planners.program.file import load_program
from planners.program.parts import Dwell, Move, Part, Program, ToolChange
from planners.program.planner import ProgramPlan
from planners.replan import replan
from planners.retarget import Chunk, JogVelocity, Retargeted, RetargetStatus, Setpoint, retarget, stream
from planners.ros.export import to_ros
from planners.search import SearchResult, SearchStatus, find_path
from planners.timing import TimeLaw, laws, make_law
from planners.trajectory import Trajectory

__all__ = [
    "AccelerationByVelocity",
    "Arc",
    "Certificate",
    "Chunk",
    "Dwell",
    "Event",
    "Grip",
    "JogVelocity",
    "JointLine",
    "Line",
    "Motion",
    "MotionLimits",
    "Move",
    "OpenContainer",
    "Part",
    "Path",
    "PathEvent",
    "PeriodicEvent",
    "Plan",
    "PlanStatus",
    "PointToPoint",
    "Polyline",
    "Program",
    "ProgramPlan",
    "RetargetStatus",
    "Retargeted",
    "SearchResult",
    "SearchStatus",
    "Setpoint",
    "Spline",
    "Suction",
    "TimeLaw",
    "TimedEvent",
    "ToolChange",
    "Trajectory",
    "Tray",
    "ViaPoint",
    "certify",
    "find_path",
    "follow",
    "free",
    "laws",
    "load_limits",
    "load_motion",
    "load_program",
    "load_trajectory",
    "make_law",
    "make_path",
    "paths",
    "plan",
    "replan",
    "retarget",
    "save",
    "stream",
    "to_ros",
]
