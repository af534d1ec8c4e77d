"""Use your own IK method, a file outside the package, by its path.

python examples/own_method.py
"""

from pathlib import Path

import numpy as np

import optik

method = Path(__file__).with_name("plugins") / "jt.py"  # Jacobian transpose; docs/extending.md describes such files
robot = optik.load("paper6r")
rng = np.random.default_rng(1)

# 200 reachable poses, each with a start about 0.1 rad away.
goals = rng.uniform(robot.limits.lower, robot.limits.upper, (200, robot.n))
starts = np.clip(goals + rng.normal(0.0, 0.1, goals.shape), robot.limits.lower, robot.limits.upper)
targets = robot.fk(goals)

for name in (method, "dls", "lm"):
    solver = optik.ik.make_solver(robot, name, max_iterations=200)
    results = [solver.solve(T, q0) for T, q0 in zip(targets, starts, strict=True)]
    # Success is judged by optik's own forward kinematics and the limits, never by the method's own claim.
    solved = sum(map(bool, results))
    iterations = np.median([r.iterations for r in results if r] or [np.nan])
    print(f"{Path(name).stem:10} {100 * solved / len(results):5.1f} % solved, median {iterations:.0f} iterations")
