"""Plan one line by every IK method and time law: plans, motions, tool, samples and the moving arm."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks._arms import arm_with
from benchmarks.blocks._scenes import scene_named
from benchmarks.blocks._torques import torques_at
from benchmarks.blocks.timing.plans.nearest import clearance_frame, nearest_picture
from benchmarks.blocks.timing.plans.settings import LineTask
from benchmarks.problems.base import start_of
from benchmarks.records import RunFolder
from optik import se3
from optik.arm.model import unit_factors
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik import make_solver
from optik.scene.contact import check_scene
from optik.types import Array
from planners.certificate.checks import steps
from planners.limits import MotionLimits
from planners.limits._motion import plain
from planners.paths.line import Line
from planners.plan import Plan, make_law, plan

PLANS = "line/plans.json"
"""Summaries of all plans; it is written last, and marks the end of the work."""

NEAREST = "line/nearest.json"
"""How the arm stands at the instant of its least clearance, by law."""

MOTION_INSTANTS = 751
"""Instants of a motion that are kept for plots: a pixel each, five to an interval of the paper's line."""

TOOL_INSTANTS = 1501
"""Instants of the tool's deviation that are kept: it swings between the samples, so the largest of several is drawn."""

PICTURES = 61
"""Pictures of the moving arm: enough to look smooth, few enough for a small page."""

PLAN_REPEATS = 3
"""Plans timed; the median is kept, so the one that compiles does not count."""


def check_line(task: LineTask) -> tuple[Robot, Array, Line]:
    """Robot, start and path of the task."""
    robot = arm_with(task.robot, task.payload)
    q = start_of(robot, task.start_deg)
    start = robot.fk(q)
    path = Line(start, se3.pose(start[:3, :3], start[:3, 3] + task.move_m))
    if not path.end:
        raise InvalidInput("the line: move_m", task.move_m, "a motion")
    for law in task.laws:
        make_law(law).need(MotionLimits.of(robot), robot)
    if task.scene:
        check_scene(robot, scene_named(task.scene, task.margin))
    return robot, q, path


def _around(task: LineTask) -> dict[str, Any]:
    """Arguments of `plan` on the scene: none where the task has none."""
    return {"scene": scene_named(task.scene, task.margin)} if task.scene else {}


def plan_once(task: LineTask) -> None:
    """Plan the line once by every law and with the first IK method, which compiles what planning takes."""
    robot, q, path = check_line(task)
    for law in task.laws:
        plan(
            robot,
            path,
            q,
            solver=make_solver(robot, task.solvers[0]),
            timing=law,
            samples=task.samples,
            **_around(task),
        )


def run_line(task: LineTask, folder: RunFolder) -> None:
    """Plan the line by every method and law, and write what reports show."""
    robot, q, path = check_line(task)
    plans: dict[tuple[str, str], Plan] = {}
    summaries: list[dict[str, Any]] = []
    seconds: list[float] = []
    for name in task.solvers:
        solver = make_solver(robot, name)
        for law in task.laws:
            seconds.clear()
            for _ in range(PLAN_REPEATS):
                begin = time.perf_counter()
                planned = plan(robot, path, q, solver=solver, timing=law, samples=task.samples, **_around(task))
                seconds.append(time.perf_counter() - begin)
            plans[name, law] = planned
            summaries.append(_summary(planned, float(np.median(seconds))))
    good = {k: p for k, p in plans.items() if p}
    if good:
        shown = list({p.law: p for p in reversed(good.values())}.values())[::-1]  # by the first IK method of each law
        folder.write("line/motion.parquet", pl.concat([_motion(p) for p in shown]))
        folder.write("line/tool.parquet", pl.concat([_tool(p) for p in shown]))
        first = {p.solver: p for p in reversed(good.values())}
        folder.write("line/samples.parquet", pl.concat([_samples(p) for p in first.values()]))
        folder.write("line/frames.parquet", pl.concat([_frames(p) for p in shown]))
        if task.scene:
            folder.write("line/clearance.parquet", pl.concat([clearance_frame(p) for p in shown]))
            folder.write_json(NEAREST, [picture for p in shown if (picture := nearest_picture(p)) is not None])
    folder.write_json(PLANS, summaries)


def _summary(planned: Plan, seconds: float) -> dict[str, Any]:
    """What the report says of a plan: what `Plan.to_dict` has but the polynomials, and how well it ends."""
    out = planned.to_dict()
    out.pop("knots", None)
    out.pop("coefficients", None)
    out["seconds"] = seconds
    out["name"] = f"{planned.solver} + {planned.law}"
    out["length"] = planned.path.end
    if planned:
        joints = planned.joint_path
        off = np.abs(planned.trajectory(planned.trajectory.end) - joints(joints.end)).max()
        out |= {
            "samples": len(joints.knots),
            "knots_in_time": len(planned.trajectory.knots),
            "end_error": float(off),
            "q_start_deg": (joints.q[0] * unit_factors(planned.robot)).tolist(),
            "q_end_deg": (joints.q[-1] * unit_factors(planned.robot)).tolist(),
            "joint_path_distance": joints.deviation[0],
            "joint_path_angle": joints.deviation[1],
            "ik_position_error": float(joints.ik.position_error.max()),
            "ik_rotation_error": float(joints.ik.rotation_error.max()),
            "ik_iterations": int(joints.ik.iterations.sum()),
        }
        t = planned.trajectory
        out["jumps"] = {
            name: plain(np.abs(steps(t, order)).max(axis=0))
            for order, name in enumerate(("position", "velocity", "acceleration", "jerk"))
        }
    return out


def _motion(planned: Plan) -> pl.DataFrame:
    """Motion q, q̇, q̈, jerk of every joint, one row for each instant and joint."""
    motion = planned.trajectory
    t = np.linspace(0.0, motion.end, MOTION_INSTANTS)
    values = [motion(t, order) for order in range(4)]
    joints = planned.robot.joint_names
    return pl.DataFrame(
        {
            "solver": planned.solver,
            "law": planned.law,
            "t": np.repeat(t, len(joints)),
            "joint": list(joints) * MOTION_INSTANTS,
            **{name: v.ravel() for name, v in zip(("q", "dq", "ddq", "jerk"), values, strict=True)},
            **_torques(planned, t),
        }
    )


def _torques(planned: Plan, t: Array) -> dict[str, Array]:
    """Torques and their rates, of the load whose value is larger at each instant, and Coulomb friction; none without masses."""
    robot, motion = planned.robot, planned.trajectory
    if robot.inertia is None:
        return {}
    found = [np.take_along_axis(x, np.abs(x).argmax(axis=0)[None], axis=0)[0] for x in torques_at(robot, motion, t)]
    friction = np.broadcast_to(robot.inertia.coulomb, found[0].shape)
    return dict(zip(("torque", "torque_rate", "coulomb"), (x.ravel() for x in (*found, friction)), strict=True))


def _tool(planned: Plan) -> pl.DataFrame:
    """Where the tool is, and how far from the path, one row an instant."""
    t = np.linspace(0.0, planned.trajectory.end, TOOL_INSTANTS)
    pose = planned.robot.fk(planned.trajectory(t))
    s = planned.path.nearest(pose)
    e = se3.error(pose, planned.path.pose(s))
    return pl.DataFrame(
        {
            "solver": planned.solver,
            "law": planned.law,
            "t": t,
            "s": s,
            "x": pose[:, 0, 3],
            "y": pose[:, 1, 3],
            "z": pose[:, 2, 3],
            "distance": np.linalg.norm(e[:, :3], axis=1),
            "angle": np.linalg.norm(e[:, 3:], axis=1),
        }
    )


def _samples(planned: Plan) -> pl.DataFrame:
    """What the IK method did at every sample of the path, before the polish."""
    joints = planned.joint_path
    return pl.DataFrame(
        {
            "solver": planned.solver,
            "s": joints.knots,
            "position_error": joints.ik.position_error,
            "rotation_error": joints.ik.rotation_error,
            "iterations": joints.ik.iterations,
            "singular_value": joints.singular_values,
        }
    )


def _frames(planned: Plan) -> pl.DataFrame:
    """Points of the arm, base to tool, in pictures equally spaced in time."""
    t = np.linspace(0.0, planned.trajectory.end, PICTURES)
    points = planned.robot.frames(planned.trajectory(t))[:, :, :3, 3]
    k, m = points.shape[:2]
    return pl.DataFrame(
        {
            "law": planned.law,
            "frame": np.repeat(np.arange(k), m),
            "t": np.repeat(t, m),
            "point": np.tile(np.arange(m), k),
            "x": points[..., 0].ravel(),
            "y": points[..., 1].ravel(),
            "z": points[..., 2].ravel(),
        }
    )
