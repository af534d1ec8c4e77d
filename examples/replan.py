"""Stop a running motion on its path, or continue it with other limits.

python examples/replan.py
"""

import numpy as np

import optik
import planners

robot = optik.load("panda")
q0 = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.8, 0.8])
start = robot.fk(q0)
line = planners.Line(start, optik.se3.pose(start[:3, :3], start[:3, 3] + (0.0, 0.25, -0.10)))
limits = planners.MotionLimits(velocity=2.0, acceleration=10.0, jerk=500.0)
plan = planners.plan(robot, line, q0, limits=limits)
print(f"planned: {plan.trajectory.duration:.3f} s")

now = 0.2 * plan.trajectory.duration  # the arm moves: its state is that of the plan at this time
stop = planners.replan(plan, now, stop=True)
print(f"stop at {now:.3f} s: at rest {stop.trajectory.duration:.3f} s later, on the path up to "
      f"{stop.span[1] / line.end:.0%} of it; certificate valid: {stop.certificate.is_valid}")  # fmt: skip

# A person comes near: limit the tool speed to 0.25 m/s. The arm brakes until it respects this limit.
slow = planners.MotionLimits(velocity=2.0, acceleration=10.0, jerk=500.0, tool_speed=0.25)
on = planners.replan(plan, now, limits=slow)
print(f"tool speed at most 0.25 m/s after {on.within_limits_from:.3f} s; path end after {on.trajectory.duration:.3f} s")
again = planners.plan(robot, line, q0, limits=slow)
print(f"the same line within 0.25 m/s from the start: {again.trajectory.duration:.3f} s")
