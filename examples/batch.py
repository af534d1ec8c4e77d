"""A million targets in one call, on all cores.

python examples/batch.py [COUNT]
"""

import sys
import time

import numpy as np

import optik

count = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
robot = optik.load("panda")
rng = np.random.default_rng(2)
goals = rng.uniform(robot.limits.lower, robot.limits.upper, (count, robot.n))
starts = np.clip(goals + rng.normal(0.0, 0.1, goals.shape), robot.limits.lower, robot.limits.upper)
targets = robot.fk(goals)  # (count, 4, 4)

optik.solve_ik_batch(robot, targets[:100], starts[:100])  # compiles, once
begin = time.perf_counter()
answers = optik.solve_ik_batch(robot, targets, starts)
seconds = time.perf_counter() - begin

print(
    f"{answers.solved.sum():,} of {count:,} solved in {seconds:.2f} s: {count / seconds / 1e6:.2f} million per second"
)
print(f"largest position error of the solved targets: {answers.position_error[answers.solved].max():.1e} m")
for index in np.flatnonzero(~answers.solved)[:3]:
    print(f"target {index}: {answers.result(index).status}")
