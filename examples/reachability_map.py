"""Where an arm can hold a tool pointing down: a map of a plane, as text and as CSV.

python examples/reachability_map.py [OUT.csv]
"""

import sys

import numpy as np

import optik

out = sys.argv[1] if len(sys.argv) > 1 else "reachability.csv"
robot = optik.load("ur5e")
down = np.diag([1.0, -1.0, -1.0])  # the tool's z axis points down
x, y, z = np.linspace(-1.0, 1.0, 41), np.linspace(-1.0, 1.0, 41), 0.2  # [m], in the base frame

places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
targets = np.array([optik.se3.pose(down, (px, py, z)) for px, py in places])
starts = np.tile(np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 0.0]), (len(targets), 1))
answers = optik.solve_ik_batch(robot, targets, starts)

# The smallest singular value of the Jacobian: near 0 the arm can barely move in some direction.
sigma = np.where(answers.solved, robot.singular_values(answers.q)[:, -1], np.nan)
status = [str(answers.result(i).status) for i in range(len(targets))]
np.savetxt(
    out, np.column_stack([places, sigma]), delimiter=",", header="x [m], y [m], smallest singular value", comments=""
)

shades = " .:-=+*#%@"
grid = np.nan_to_num(sigma, nan=0.0).reshape(len(x), len(y))
level = np.ceil(grid / grid.max() * (len(shades) - 1)).astype(int)
for row in level[::2]:
    print("".join(2 * shades[value] for value in row[::2]))
print(f"{answers.solved.sum()} of {len(targets)} poses reached; proved out of reach: {status.count('unreachable')}")
print(f"table: {out}")
