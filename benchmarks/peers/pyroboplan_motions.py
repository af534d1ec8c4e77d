"""pyroboplan as a peer of blocks ``[[motion]]``, in Drake's environment, which it needs."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from benchmarks.peers.base import Absent
from benchmarks.peers.ik.drake import METHOD as DRAKE
from benchmarks.peers.models import list_solids, make_solid
from optik.arm.robot import Robot
from optik.errors import NoSolution
from optik.scene import Scene
from optik.types import Array
from planners.limits import MotionLimits
from planners.trajectory import Trajectory


def move_by_pyroboplan(
    robot: Robot, limits: MotionLimits, scene: Scene, ends: tuple[Array, Array]
) -> tuple[Array, Trajectory, float, float]:
    """Return the vertices of pyroboplan's path, its motion, which stops there, and CPU times of the search and in all [ms]."""
    if why := DRAKE.missing():
        raise Absent(why)
    if limits.velocity is None or limits.acceleration is None or robot.shapes is None:
        raise NoSolution("it takes limits of velocity and acceleration, and an arm with shapes")
    solids, (link, a, b, radius) = list_solids(scene), robot.shapes.capsules
    capsules = [make_solid("Capsule", *one) for one in zip(a, b, radius, strict=True)]
    low, high, bounds = robot.limits.lower.tolist(), robot.limits.upper.tolist(), limits.arrays(robot.n)
    model = {
        "joints": list(zip(robot.fixed.tolist(), robot.prismatic.tolist(), robot.joint_names, low, high, strict=True)),
        "shapes": [(at, kind, sizes, T.tolist()) for at, (kind, sizes, T) in zip(link.tolist(), capsules, strict=True)],
        "pairs": robot.shapes.pairs.tolist(), "limits": [bounds[name].tolist() for name in ("velocity", "acceleration")],
    }  # fmt: skip
    checked = np.argwhere(scene.pair_mask(robot) & (link > 0)[:, None])
    objects = [(0, kind, sizes, T.tolist()) for kind, sizes, T in solids]
    problem = {"objects": objects, "pairs": np.add(checked, (0, len(capsules))).tolist()}
    answer = DRAKE.start("pyroboplan", model, keep=True).ask(problem, [q.tolist() for q in ends])
    if not answer.raw["path"]:
        raise NoSolution("it found no path")
    q, v, a = (np.array(answer.raw[name]).T for name in ("positions", "velocities", "accelerations"))
    motion = Trajectory(PPoly(np.array([0.5 * a, v[:-1], q[:-1]]), np.array(answer.raw["times"][0])))
    if not np.allclose(motion([0.0, motion.end]), ends, rtol=0.0, atol=1e-9):
        raise NoSolution("its motion misses the start or the goal")
    return np.array(answer.raw["path"]), motion, answer.raw["search_ns"] / 1e6, (answer.cpu_ns or 0) / 1e6
