"""Independent answers to compare with: slow, plain, written from the textbook, and never by calling what is tested.

``from tests import oracles`` has them all: poses, arms, kinematics, paths, motions, and what a plan claims; by power series,
brute force, SciPy and Pinocchio.
"""

from tests.oracles.arms import PAPER, SLIDING, UR5E, Arm, Row, configurations, random_arm, span
from tests.oracles.continuation import Continuation, follow_densely
from tests.oracles.files import REPOSITORY, table
from tests.oracles.kinematics import (
    cold,
    fk,
    fk_series,
    jacobian,
    link,
    met,
    newton,
    smallest,
    speeds,
    tool_motion,
    turning_series,
)
from tests.oracles.motions import (
    Joints,
    best_uniform,
    brute_extrema,
    difference,
    double_s,
    piece_values,
    s_curve,
    value,
)
from tests.oracles.paper_iteration import Iteration, damped_least_squares
from tests.oracles.paths import derivatives_along, line_pose, nearest, off_line, pose_series, rotation_derivatives
from tests.oracles.pinocchio import Pinocchio, PinocchioDynamics, urdf
from tests.oracles.plans import contradictions, joint_extremes, tool_speeds
from tests.oracles.poses import crossing, error, moved, off_by, pose, random_pose, rot_x, rot_z, task_off_by, trans, vee

__all__ = [
    "PAPER", "REPOSITORY", "SLIDING", "UR5E", "Arm", "Continuation", "Iteration", "Joints", "Pinocchio",
    "PinocchioDynamics", "Row", "best_uniform", "brute_extrema", "cold", "configurations", "contradictions",
    "crossing", "damped_least_squares", "derivatives_along", "difference", "double_s", "error", "fk", "fk_series",
    "follow_densely", "jacobian", "joint_extremes", "line_pose", "link", "met", "moved", "nearest", "newton",
    "off_by", "off_line", "piece_values", "pose", "pose_series", "random_arm", "random_pose", "rot_x", "rot_z",
    "rotation_derivatives", "s_curve", "smallest", "span", "speeds", "table", "task_off_by", "tool_motion",
    "tool_speeds", "trans", "turning_series", "urdf", "value", "vee",
]  # fmt: skip
