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

LIMITS = ("velocity", "acceleration", "jerk")
print("peak / limit; above 1 where the law does not enforce the limit")
print("law             T [s]  velocity  acceleration      jerk  enforced by the law")
for law in planners.laws():
    plan = planners.plan(robot, line, q0, timing=law, limits=limits, allow=("limits", "jerk"))
    if not plan:
        print(f"{law:14} {plan.status}")
        continue
    velocity, acceleration, jerk = (plan.certificate.worst(name)[0] for name in LIMITS)
    enforced = [name for name in LIMITS if name in planners.make_law(law).enforced]
    peaks = f"{velocity:10.3f}{acceleration:14.3f}{jerk:10.3f}"
    print(f"{law:14} {plan.trajectory.duration:6.3f}{peaks}  {', '.join(enforced) or 'none'}")
