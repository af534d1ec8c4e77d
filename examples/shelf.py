"""Move the hand from one compartment of a shelf to another: proved free, and as fast as the limits allow.

python examples/shelf.py [--out shelf.json]
"""

import argparse

import numpy as np

import optik
import planners

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--out", help="file of the motion, for `optik view FILE --html PAGE`")
out = parser.parse_args().out


def board(
    centre: tuple[float, float, float], edges: tuple[float, float, float]
) -> tuple[np.ndarray, tuple[float, ...]]:
    """Return a box of a scene."""
    pose = np.eye(4)
    pose[:3, 3] = centre
    return pose, edges


boards = [board((0.72, 0.0, z), (0.36, 0.84, 0.02)) for z in (0.10, 0.45, 0.80)]
boards += [board((0.72, y, 0.45), (0.36, 0.02, 0.72)) for y in (-0.42, 0.0, 0.42)]
shelf = optik.Scene(boxes=boards, margin=0.005)

robot = optik.load("panda_hand")
forwards = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # the hand points into the shelf
rest = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
low, high = (optik.se3.pose(forwards, position) for position in ((0.60, -0.21, 0.28), (0.60, 0.21, 0.62)))
take = planners.plan(robot, planners.PointToPoint(robot, rest, low), scene=shelf, avoid=True)
print(f"into the shelf: {take.status}, {take.trajectory.duration:.2f} s")
q = take.trajectory(take.trajectory.duration)
move = planners.plan(robot, planners.PointToPoint(robot, q, high), scene=shelf, avoid=True)
print(
    f"to the other compartment: {move.status}, {move.trajectory.duration:.2f} s; {move.search.samples} random configurations"
)
clearance = move.certificate.clearance
for words, kind in clearance.kinds.items():
    print(
        f"proved {words}: at least {1e3 * kind.value:.2f} mm (margin {1e3 * kind.margin:g} mm), {' and '.join(kind.pair)}"
    )
if out:
    move.save(out)
