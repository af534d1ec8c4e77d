"""A weld seam at constant speed, from waypoints to a certified ROS 2 message; ROS is not needed.

python examples/seam_to_ros.py [OUT.yaml]
"""

import sys

import numpy as np

import optik
import planners

out = sys.argv[1] if len(sys.argv) > 1 else "seam.yaml"
robot = optik.load("ur5e")
q0 = np.deg2rad([0.0, -100.0, 110.0, -100.0, -90.0, 0.0])
start = robot.fk(q0)

# Corners are rounded within 2 mm of the waypoints; the torch turns by 20° over the second segment.
x, y, z = start[:3, 3]
tilt = optik.se3.exp_so3(np.deg2rad([0.0, 20.0, 0.0]))
corners = [(x, y, z), (x, y + 0.10, z), (x + 0.08, y + 0.10, z)]
turns = [start[:3, :3], start[:3, :3], tilt @ start[:3, :3]]
seam = planners.Polyline([optik.se3.pose(R, p) for R, p in zip(turns, corners, strict=True)], blend=2e-3)

limits = planners.MotionLimits(velocity=2.0, acceleration=15.0, jerk=150.0)
weld = planners.make_law("constant_speed", speed=0.05)  # [m/s] between the two ramps
plan = planners.plan(robot, seam, q0, timing=weld, limits=limits)
if not plan:
    sys.exit(f"no motion: {plan.failure.reason}; to try: {plan.failure.advice}")

sent = planners.to_ros(
    plan, out, rate=125.0
)  # 8 ms between points; certifies the motion after controller interpolation
off = 1e6 * sent.certificate.path_error.distance
print(f"{out}: {sent.points} points, {sent.trajectory.duration:.3f} s")
print(
    f"after controller interpolation: certificate valid: {sent.certificate.is_valid}; at most {off:.2f} µm off the seam"
)
