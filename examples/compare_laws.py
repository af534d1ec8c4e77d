"""Compare all time laws on one line: durations and certificates.

python examples/compare_laws.py
"""

import numpy as np

import optik
import planners

robot = optik.load("paper6r")
q0 = np.deg2rad([20.0, -35.0, 40.0, 25.0, 50.0, -30.0])
start = robot.fk(q0)
line = planners.Line(start, optik.se3.pose(start[:3, :3], start[:3, 3] + (-0.12, 0.0, 0.20)))
limits = planners.MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)

print("a ratio above 1: this law does not enforce that limit (quintic enforces none), and allow= permits it")
print("law             T [s]  |q̇|/limit  |q̈|/limit  jerk/limit  off the line [µm]  certificate valid")
for law in planners.laws():
    plan = planners.plan(robot, line, q0, timing=law, limits=limits, allow=("limits", "jerk"))
    if not plan:
        print(f"{law:14} {plan.status}")
        continue
    proof = plan.certificate
    worst = [getattr(proof, name).ratio.max() for name in ("velocity", "acceleration", "jerk")]
    off = 1e6 * proof.path_error.distance
    ratios = "".join(f"{ratio:12.3f}" for ratio in worst)
    print(f"{law:14} {plan.trajectory.duration:6.3f}{ratios}{off:19.4f}  {proof.is_valid}")
