"""One straight line, planned by every IK method and time law, in detail."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated, Any, TypeVar

import numpy as np
import polars as pl

from benchmarks.blocks.arms import Payload, SceneName, arm_with, scene_named, torques_at
from benchmarks.blocks.base import Block, BlockRows, Compared, Kind, Tell
from benchmarks.blocks.timing.nearest import clearance_frame, nearest_picture
from benchmarks.problems.base import start_of
from benchmarks.records import Journal, RunFolder
from benchmarks.settings import LISTED, Joints, LawName, RobotName, SolverName, Three, counted, key, numbered
from optik import se3
from optik.arm.model import unit_factors
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.ik import make_solver
from optik.registry import short_name as short_name
from optik.scene.contact import check_scene
from optik.types import Array
from planners.certificate.checks import steps
from planners.limits import MotionLimits
from planners.limits.inputs import plain
from planners.paths.line import Line
from planners.plan import Plan, make_law, plan

Item = TypeVar("Item")


class LineTask(Block):
    """One straight line, planned by some IK methods and time laws."""

    noun = "the line"
    fixed = frozenset({"id", "title", "targets"})

    id: str = "line"
    title: str = "the line"
    robot: RobotName = key("The arm.")
    start_deg: Joints = key("Start configuration.", unit="degrees, mm")
    move_m: Three = key("From the start of the line to its end, in the base frame.", unit="m")
    solvers: Annotated[tuple[SolverName, ...], LISTED] = key("IK methods.")
    laws: Annotated[tuple[LawName, ...], LISTED] = key("Time laws.")
    samples: Annotated[int, counted(2)] = key("Samples of the path.", 151)
    payload: Payload = key("Mass in the tool, or [lightest, heaviest]; by default that of the robot file.", None, "kg")
    scene: SceneName = key("Scene: `shelf`, `table`, `plates`, or a file; by default none.", "")
    margin: Annotated[float, numbered("metres, 0 or more", least=0.0)] = key(
        "Least distance between arm and scene.", 0.0, "m"
    )


def first_of_laws(plans: Sequence[Item], law: Callable[[Item], str]) -> list[Item]:
    """Return the first plan of each law (by the first IK method), or of each of something else, in the order of the plans."""
    return list({law(p): p for p in reversed(plans)}.values())[::-1]


@dataclass(frozen=True)
class LinePlans(BlockRows):
    """The line by every IK method and law; ``facts["plans"]`` holds the summary of each plan."""

    @property
    def plans(self) -> list[dict[str, Any]]:
        """All plans."""
        return list(self.facts["plans"])

    @property
    def nearest(self) -> list[dict[str, Any]]:
        """The arm's posture at the instant of its least clearance, by law; none without a scene."""
        return list(self.facts["nearest"])

    @cached_property
    def solved(self) -> list[dict[str, Any]]:
        """Plans with a trajectory."""
        return [p for p in self.plans if p["status"] == "solved"]

    @cached_property
    def solver(self) -> str:
        """The first IK method with a trajectory; the first of all if none has one."""
        return str((self.solved or self.plans)[0]["solver"])

    @cached_property
    def of_laws(self) -> list[dict[str, Any]]:
        """The first plan of each law that has a trajectory."""
        return first_of_laws(self.solved, lambda p: str(p["law"]))


MOTION_INSTANTS = 751
"""Number of stored instants of a motion: a pixel each, five to an interval of the paper's line."""

TOOL_INSTANTS = 1501
"""Number of stored instants of the tool's deviation, which oscillates between the samples; the largest of several is drawn."""

PLAN_REPEATS = 3
"""Number of timed plans; the median is used, so the one that compiles does not count."""


def check_line(task: LineTask) -> tuple[Robot, Array, Line]:
    """Return robot, start and path of the task."""
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
    """Return the arguments of `plan` for the scene: none if the task has none."""
    return {"scene": scene_named(task.scene, task.margin)} if task.scene else {}


def _summary(planned: Plan, seconds: float) -> dict[str, Any]:
    """Return the summary of a plan for the report: `Plan.to_dict` without the polynomials, and the error at the end."""
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
    """Return the motion q, q̇, q̈, jerk of every joint, one row for each instant and joint."""
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
    """Return torques, torque rates and friction for the load with larger values at each instant; empty without masses."""
    robot, motion = planned.robot, planned.trajectory
    if robot.inertia is None:
        return {}
    found = [np.take_along_axis(x, np.abs(x).argmax(axis=0)[None], axis=0)[0] for x in torques_at(robot, motion, t)]
    friction = np.broadcast_to(robot.inertia.coulomb, found[0].shape)
    return dict(zip(("torque", "torque_rate", "coulomb"), (x.ravel() for x in (*found, friction)), strict=True))


def _tool(planned: Plan) -> pl.DataFrame:
    """Return the tool's position and its distance from the path, one row per instant."""
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
    """Return the results of the IK method at every sample of the path, before polishing."""
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


class _Plans(Kind):
    """The line of a suite: its table ``[line]``."""

    name = "plans"
    title = "The line"
    block = LineTask
    read_as = LinePlans
    has_facts = True
    single = True
    order = 40
    on_paper = True
    warms = True
    compared = (
        Compared("motion found", "%", "more", "solved", exact=True),
        Compared("duration", "s", "less", "duration", exact=True),
        Compared("time of a whole plan", "ms", "less", "seconds", 1e3, clock=True),
    )

    def compared_rows(self, block: LineTask, rows: pl.DataFrame) -> pl.DataFrame:
        """Return each plan separately; times of all plans together, because each was made once."""
        solved = pl.col("status") == "solved"
        each = rows.with_columns(duration=pl.when(solved).then("duration"), seconds=pl.lit(None, pl.Float64))
        together = rows.with_columns(
            method=pl.lit("all plans"), problem=pl.col("method"), status=pl.lit(None, pl.String),
            duration=pl.lit(None, pl.Float64),
        )  # fmt: skip
        return pl.concat([each, together]).with_columns(solved=solved)

    def prepare(self, block: LineTask, seed: int) -> None:
        check_line(block)

    def warm(self, block: LineTask) -> None:
        """Plan the line once by every law and with the first IK method, which compiles all kernels of planning."""
        robot, q, path = check_line(block)
        for law in block.laws:
            solver = make_solver(robot, block.solvers[0])
            plan(robot, path, q, solver=solver, timing=law, samples=block.samples, **_around(block))

    def timed(
        self, block: LineTask, seed: int, folder: RunFolder, tell: Tell, journal: Journal
    ) -> Iterator[tuple[str, Callable[[], pl.DataFrame]]]:
        """Yield the plans by every method and law as one part."""
        yield "0000", partial(self._plan, block, folder, tell, journal)

    def _plan(self, block: LineTask, folder: RunFolder, tell: Tell, journal: Journal) -> pl.DataFrame:
        """Plan the line by every method and law, write the data of the report, and return the rows."""
        tell(block.title)
        robot, q, path = check_line(block)
        good: list[Plan] = []
        summaries: list[dict[str, Any]] = []
        lost: list[dict[str, Any]] = []
        for name in block.solvers:
            solver = make_solver(robot, name)
            for law in block.laws:
                seconds, about = [], {"solver": short_name(name), "law": short_name(law)}
                label = f"{about['law']} with {about['solver']}"
                if label in journal.crashed:
                    lost.append(about | {"method": label, "problem": block.title, "status": "crashed"})
                    continue
                with journal.at_work(label):
                    for _ in range(PLAN_REPEATS):
                        begin = time.perf_counter()
                        planned = plan(
                            robot, path, q, solver=solver, timing=law, samples=block.samples, **_around(block)
                        )
                        seconds.append(time.perf_counter() - begin)
                good += [planned] if planned else []
                summaries.append(_summary(planned, float(np.median(seconds))))
        shown, pictures = first_of_laws(good, lambda p: p.law), []
        tables = {"motion": (_motion, shown), "tool": (_tool, shown)}
        tables["samples"] = _samples, first_of_laws(good, lambda p: p.solver)
        if block.scene:
            tables["clearance"] = clearance_frame, shown
            pictures = [picture for p in shown if (picture := nearest_picture(p)) is not None]
        for table, (frame_of, plans) in tables.items() if good else ():
            folder.write(self.file(block, f"{table}.parquet"), pl.concat([frame_of(p) for p in plans]))
        folder.write_json(self.file(block, "json"), {"plans": summaries, "nearest": pictures})
        rows = [
            {
                "method": f"{p['law']} with {p['solver']}", "problem": block.title, "duration": p.get("duration"),
                **{key: p[key] for key in ("solver", "law", "status", "seconds")},
            }
            for p in summaries
        ]  # fmt: skip
        types = {"duration": pl.Float64, "seconds": pl.Float64}
        return pl.DataFrame(rows + lost, schema_overrides=types, infer_schema_length=None)


METHOD = _Plans
