"""Worlds of planners that prove safety, ARMOUR's 100 and SPARROWS' 14: motions certified for all masses × 0.97 to × 1.03.

The environment variable ``RIVALS`` names a folder with ``armour`` and ``sparrows``, the repositories roahmlab/armour and
roahmlab/sparrows, which are read and never copied. The arm, its speed and torque limits and its rotors are those of ARMOUR's
script ``kinova_run_100_worlds.m``, which models no friction; the limits of acceleration and jerk are ours. The torque is
affine in the factor of the masses, so that the two ends prove all between. Contacts are sought at 1 kHz
between the arm's own meshes and the boxes, by coal. The guide
motions of SPARROWS' folder ``results`` are judged as tables of waypoints; nothing follows about SPARROWS' planner.
"""

from __future__ import annotations

import os
import warnings
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np
from scipy.io import loadmat

from optik import Robot, Scene
from optik.types import Array
from planners import MotionLimits, Trajectory, certify, load_trajectory, plan
from planners.limits.member import MemberValue
from tests import oracles
from tests.figures.figure import Row, Value, main
from tests.planners.contacts import instants

FACTORS = {"light": 0.97, "heavy": 1.03}
ROTORS = (
    8.03,
    11.99620246153036,
    9.002542786175152,
    11.58064393167063,
    8.466504091791412,
    8.853706937374243,
    8.858730366468532,
)
VELOCITY = (1.3963,) * 4 + (1.2218,) * 3
TORQUE = (56.7,) * 4 + (29.4,) * 3
ACCELERATION, JERK = 5.0, 50.0
"""Limits of the script [rad/s, N·m] and ours [rad/s², rad/s³]."""
WORLDS, SCENARIOS = 100, 14


def folder() -> Path:
    return Path(os.environ["RIVALS"])


def urdf() -> Path:
    return folder() / "armour/urdfs/kinova_arm/kinova_without_gripper.urdf"


@cache
def arm(factor: float = 1.0) -> Robot:
    """The Kinova without its gripper, with all masses times a factor and without friction."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        robot = Robot.from_urdf(urdf(), shapes=True)
    own = robot.inertia
    assert own is not None
    return robot.with_inertia(type(own)(own.mass * factor, own.com, own.tensor * factor, motor=np.array(ROTORS)))


@cache
def limits() -> MotionLimits:
    """The limits, with the torques of both ends of the masses."""
    of_factor = {
        f"{name}.torque": MemberValue(arm(f), tuple(range(7)), np.array(TORQUE)) for name, f in FACTORS.items()
    }
    return MotionLimits(np.array(VELOCITY), ACCELERATION, JERK, extra=of_factor)


def read_world(number: int) -> tuple[str, Array, Array, Scene]:
    """Name, start, goal and boxes: the rows of the file are start, goal, a separator, and centre and edges of each box."""
    worlds = sorted((folder() / "armour/kinova_src/saved_worlds/random").glob("scene_*.csv"))
    scenarios = sorted((folder() / "sparrows/kinova_scenarios").glob("scene_*.csv"))
    file = [*worlds[:WORLDS], *scenarios[:SCENARIOS]][number]
    rows = [[float(x) for x in line.split(",") if x.strip()] for line in file.read_text().splitlines()]
    boxes = [(_at(row[:3]), tuple(row[3:6])) for row in rows[3:] if len(row) >= 6]
    return file.parent.name + "/" + file.stem, np.array(rows[0][:7]), np.array(rows[1][:7]), Scene(boxes=boxes)


def _at(position: list[float]) -> Array:
    T = np.eye(4)
    T[:3, 3] = position
    return T


def measure(case: int) -> Row:
    """One world; or a guide motion of SPARROWS' folder."""
    if case >= WORLDS + SCENARIOS:
        return judge_guide(case - WORLDS - SCENARIOS)
    robot, (name, start, goal, scene) = arm(), read_world(case)
    row: Row = {"name": name, "boxes": len(scene.names)}
    row["ends"] = all(robot.limits.contains(q) and not Meshes(scene).touches(q) for q in (start, goal))
    if not case:
        plan(robot, goal, start, limits=limits(), scene=scene, avoid=True)  # compiles
    begin = process_time()
    motion = plan(robot, goal, start, limits=limits(), scene=scene, avoid=True)
    row |= {"cpu": process_time() - begin, "status": str(motion.status), "valid": bool(motion)}
    if motion.has_motion:
        row |= {"T": motion.trajectory.duration} | sample(scene, motion.trajectory)
    return row | {"reason": "" if motion.failure is None else motion.failure.reason[:160]}


class Meshes:
    """Contacts of the arm's own meshes with boxes and with each other, by coal through Pinocchio."""

    def __init__(self, scene: Scene) -> None:
        import coal
        import pinocchio as pin

        file, self.pin = str(urdf()), pin
        self.model = pin.buildModelFromUrdf(file)
        self.geometry = pin.buildGeomFromUrdf(
            self.model, file, pin.GeometryType.COLLISION, package_dirs=[str(urdf().parent)]
        )
        links = list(range(self.geometry.ngeoms))
        for number, (T, edges) in enumerate(scene.boxes):
            box = pin.GeometryObject(f"box{number}", 0, pin.SE3(T), coal.Box(*map(float, edges)))
            added = self.geometry.addGeometryObject(box)
            for link in links[1:]:
                self.geometry.addCollisionPair(pin.CollisionPair(link, added))
        for first in links:
            for second in links[first + 2 :]:
                self.geometry.addCollisionPair(pin.CollisionPair(first, second))
        self.data, self.found = self.model.createData(), self.geometry.createData()

    def touches(self, q: Array) -> bool:
        """Whether anything is in contact at one configuration."""
        parts = [
            [np.cos(x), np.sin(x)] if joint.nq == 2 else [x] for x, joint in zip(q, self.model.joints[1:], strict=True)
        ]
        full = np.concatenate(parts)
        return bool(self.pin.computeCollisions(self.model, self.data, self.geometry, self.found, full, True))


def sample(scene: Scene, motion: Trajectory) -> Row:
    """How often the meshes touch at 1 kHz, and the largest ratios of torque (by Pinocchio, at seven factors) and speed."""
    t = instants(motion, 1000.0)
    meshes, q = Meshes(scene), motion(t)
    others = [oracles.PinocchioDynamics(arm(f)) for f in np.linspace(*FACTORS.values(), 7)]
    ratios = [
        np.abs(other.torques(motion(x), motion(x, 1), motion(x, 2))) / TORQUE for x in t[::10] for other in others
    ]
    speed = float(np.abs(motion(t, 1) / VELOCITY).max())
    return {"contacts": sum(map(meshes.touches, q)), "torque": float(np.max(ratios)), "speed": speed}


def judge_guide(number: int) -> Row:
    """The verdict on a guide motion: cubic pieces through its waypoints and velocities."""
    data = loadmat(folder() / f"sparrows/kinova_scenarios/results/traj_data_{number + 1}.mat")
    robot, (name, _start, _goal, scene) = arm(), read_world(WORLDS + number)
    head = ",".join(["t", *robot.joint_names, *(f"vel_{joint}" for joint in robot.joint_names)])
    with TemporaryDirectory() as temporary:
        file = Path(temporary) / "guide.csv"
        np.savetxt(file, np.hstack([data["time"], data["pos"], data["vel"]]), "%.17g", ",", header=head, comments="")
        motion = load_trajectory(file, robot)
    extra = {name: value for name, value in limits().extra.items()}
    proof = certify(robot, None, motion, MotionLimits(np.array(VELOCITY), extra=extra), scene=scene)
    row = {"name": f"guide {number + 1} in {name}", "valid": proof.is_valid, "T": motion.duration}
    return row | {"why": "; ".join(one.words for one in proof.violations[:4])} | sample(scene, motion)


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    worlds = [row for row in rows if "guide" not in row["name"]]
    free = [row for row in worlds if row["ends"]]
    for row in free:
        if not row["valid"]:
            print(f"    {row['name']}: {row['status']}: {row['reason']}")
    solved = [row for row in free if row["valid"]]
    cpu = np.array([row["cpu"] for row in free])
    wrong = sum(row["contacts"] or row["torque"] > 1.0 + 1e-9 for row in solved)
    return [
        Value("worlds with free ends, certified", "all", f"{len(solved)} of {len(free)}", len(solved) == len(free)),
        Value("CPU", "median ≤ 1 s", f"{np.median(cpu):.2f} s, at most {cpu.max():.1f} s", np.median(cpu) <= 1.0),
        Value("in contact, or over a torque", "0", f"{wrong}", not wrong),
    ]


if __name__ == "__main__":
    main("rivals", measure, WORLDS + 2 * SCENARIOS, judge)
