"""Section 4.1 of the paper, pose by pose: k iterations at each pose of the line, from the answer before, and a motion."""

from __future__ import annotations

import numpy as np

from optik import se3
from optik.arm.robot import Robot
from optik.errors import NoSolution
from optik.ik import IKSolver, Tolerance
from optik.types import Array
from planners.fit import fit_to_limits
from planners.following.follow import PlanFailure
from planners.following.joint_path import IKRecord, JointPath
from planners.limits import MotionLimits
from planners.motion import Motion
from planners.paths.line import Line
from planners.plan import Plan, PlanStatus, make_law

POSES = 151
"""Poses of the line: 3 s at intervals of 0.02 s, as in the paper."""
WIDE = Tolerance(1.0, 4.0)
"""Tolerance of the certificate [m, rad]; it is wide, because the remaining error of the iterations is measured here."""


def answers_along(line: Line, start: Array, solver: IKSolver) -> Array:
    """Return the answers (151, n) of a method that is stopped at each pose of the line, each from the answer before."""
    q = [start]
    for pose in line.pose(np.linspace(0.0, line.end, POSES)[1:]):
        q.append(solver.solve(pose, q[-1]).q)
    return np.array(q)


def plan_through(robot: Robot, line: Line, q: Array, solver: str, law: str) -> Plan:
    """Return the motion through the answers q (151, n) at the poses of a line.

    Between the answers the joints follow quintics, with the rates J⁻¹V and zero second derivatives at the answers (eq. 17).
    The time law finds the speed within the limits of the arm.
    """
    s = np.linspace(0.0, line.end, POSES)
    derivatives = np.zeros((POSES, 3, robot.n))
    derivatives[:, 0] = (np.linalg.pinv(robot.jacobian(q)) @ line(s, 1)[..., None])[..., 0]
    e = np.linalg.norm(se3.error(robot.fk(q), line.pose(s)).reshape(POSES, 2, 3), axis=2)
    joints = JointPath(robot, line, s, q, derivatives, IKRecord(e[:, 0], e[:, 1], np.zeros(POSES, dtype=np.int64), s))
    limits, timed = MotionLimits.of(robot), make_law(law)
    try:
        enforced = timed.list_enforced(limits)
        trajectory = fit_to_limits(robot, timed.run(joints, limits), limits, enforced, line)
    except NoSolution as error:
        failure = PlanFailure.from_error(PlanStatus.TIMING_INFEASIBLE, error)
        return Plan(robot, line, limits, PlanStatus.TIMING_INFEASIBLE, solver, law, joints, failure, None, None)
    proof = Motion(robot, line, limits, trajectory, law, enforced, WIDE).certify()
    why = PlanFailure(PlanStatus.NOT_PROVED, 0.0, None, f"the certificate is not valid: {'; '.join(proof.reasons)}", "")
    status, found = (PlanStatus.SOLVED, None) if proof.is_valid else (PlanStatus.NOT_PROVED, why)
    return Plan(robot, line, limits, status, solver, law, joints, found, trajectory, proof)
