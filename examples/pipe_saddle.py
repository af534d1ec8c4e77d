"""The saddle where a branch pipe meets a main pipe, in a cell: a seam by a formula, and a torch that may turn about its axis.

python examples/pipe_saddle.py [WAYPOINTS.csv]
"""

import sys

import numpy as np

import optik
import planners

out = sys.argv[1] if len(sys.argv) > 1 else "saddle.csv"
main, branch = 0.10, 0.06  # radii [m]: the main pipe is along x, the branch is vertical
torch = optik.se3.pose(optik.se3.exp_so3([0.0, np.deg2rad(45.0), 0.0]), (0.08, 0.0, 0.15))  # bent by 45°
robot = optik.load("ur5e").with_tool(torch)
centre = np.array([0.0, -0.5, 0.0])

# The seam, and the sum of both pipes' normals: the torch bisects the angle between them.
u = np.linspace(np.deg2rad(-170.0), np.deg2rad(-10.0), 17)
y, z = branch * np.sin(u), np.sqrt(main**2 - (branch * np.sin(u)) ** 2)
points = np.stack([branch * np.cos(u), y, z], axis=1)
normals = points / [branch, branch, np.inf] + points / [np.inf, main, main]
normals /= np.linalg.norm(normals, axis=1, keepdims=True)
rows = np.hstack([1e3 * (points + centre), normals])
np.savetxt(out, rows, fmt="%.6f", delimiter=",", header="x_mm,y_mm,z_mm,i,j,k", comments="")

seam = planners.Polyline.from_csv(out, orientation=optik.se3.exp_so3([np.pi, 0.0, 0.0]), blend=1e-3)
limits = planners.MotionLimits(velocity=2.0, acceleration=15.0, jerk=150.0)
side, up = np.array([0.3, 0.0, 0.0]), np.array([0.0, 0.0, 0.3])
pipes = [(centre, centre + up, branch), (centre - side, centre + side, main)]
cell = optik.Scene(
    cylinders=pipes, planes=[((0.0, 0.0, -0.15), (0.0, 0.0, 1.0))], margin=5e-3, allow=[("base", "plane1")]
)
plan = planners.plan(robot, planners.free(seam, turn=(-np.pi, np.pi)), limits=limits, scene=cell)
if not plan:
    sys.exit(f"no motion: {plan.failure.reason}; to try: {plan.failure.advice}")

low, high = np.rad2deg(plan.freedom.ranges[0].reached)
print(f"{out}: {len(rows)} waypoints")
print(f"fixed turn: {plan.freedom.fixed_duration:.3f} s; free turn: {plan.trajectory.duration:.3f} s")
print(f"gain {100.0 * plan.freedom.gain:.1f} %, turn between {low:.0f}° and {high:.0f}°")
near = plan.certificate.clearance.scene
print(f"certificate valid: {plan.certificate.is_valid}; {1e3 * near.value:.0f} mm or more between arm and cell")
