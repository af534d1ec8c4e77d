"""An arm from a URDF: read it, check what was read, solve, and plan a line with a certificate.

python examples/own_urdf.py [ARM.urdf]
"""

import sys
from pathlib import Path

import numpy as np

import optik
import planners

file = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("arm.urdf")
robot = optik.Robot.from_urdf(file)  # tip= and base= choose another chain
print(f"{robot.name}: {robot.n} joints, {', '.join(robot.joint_names)}")

q0 = robot.limits.middle + 0.2 * robot.limits.half * np.array([(-1.0) ** i for i in range(robot.n)])
start = robot.fk(q0)
goal = robot.fk(q0 + 0.1)  # some pose nearby

answer = optik.solve_ik(robot, goal, q0)
print(f"IK: {answer.status}, position error {1e3 * answer.position_error:.1e} mm after {answer.iterations} iterations")
if not answer:
    sys.exit(answer.status.advice)

# A URDF has velocity limits at most; a controller needs acceleration and jerk limits, too.
limits = planners.MotionLimits(velocity=1.0, acceleration=5.0, jerk=50.0)
plan = planners.plan(robot, planners.Line(start, goal), q0, limits=limits)
if not plan:
    sys.exit(f"no motion: {plan.failure.reason}; to try: {plan.failure.advice}")
proof = plan.certificate
print(
    f"line: {plan.trajectory.duration:.3f} s, at most {1e6 * proof.path_error.distance:.2g} µm off the line at any instant"
)
worst = max(getattr(proof, name).ratio.max() for name in ("velocity", "acceleration", "jerk"))
print(f"certificate valid: {proof.is_valid}; worst value over its limit: {worst:.6f}")
