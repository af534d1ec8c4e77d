"""Executed spots on graph paper: the laser reads each, the tool moves there, and its error is split into four vectors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import NUMBER, TEXT, TRUTH, WHOLE, Field, Kind, Session, Shard, Trials, chunks, fields_of
from benchmarks.blocks.block import Entry
from benchmarks.blocks.cell.settings import AXES, CellBlock, budget_label
from benchmarks.blocks.cell.trials import (
    EXECUTED_TO_END,
    EXECUTION,
    Trial,
    drive_of,
    execute,
    facts_of,
    failure,
    lasers,
    trial_of,
    with_drive,
)
from benchmarks.blocks.entries import store_problems
from benchmarks.problems.base import ProblemSet
from benchmarks.settings import naming
from optik import se3
from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.ik import IKSolver, Tolerance, make_solver
from optik.registry import short_name
from optik.types import Array
from planners.cell.cell import Cell
from planners.cell.drives.base import Execution
from planners.cell.error_split import ErrorSplit, split_configurations
from planners.cell.laser import PanTiltLaser
from planners.cell.sighting import Spot
from planners.following.follow import PlanFailure
from planners.following.joint_path import IKRecord, JointPath
from planners.limits import MotionLimits
from planners.motion import Motion
from planners.motion.fit import fit_to_limits
from planners.paths.line import Line
from planners.plan import Plan, PlanStatus, make_law, plan

POSES = 151
"""Poses of the line: 3 s at intervals of 0.02 s, as in the paper."""
WIDE = Tolerance(1.0, 4.0)
"""Tolerance of the certificate [m, rad]; it is wide, because the remaining error of the iterations is measured here."""


def answers_along(line: Line, start: Array, solver: IKSolver) -> Array:
    """Return the answers (151, n) of a method that is stopped at each pose of the line, each from the previous answer."""
    q = [start]
    for pose in line.pose(np.linspace(0.0, line.end, POSES)[1:]):
        q.append(solver.solve(pose, q[-1]).q)
    return np.array(q)


def plan_through(robot: Robot, line: Line, q: Array, solver: str, law: str) -> Plan:
    """Return the motion through the answers q (151, n) at the poses of a line.

    Between the answers the joints follow quintics, with the rates J⁻¹V and zero second derivatives at the answers (eq. 17).
    The time law finds the speed within the limits of the arm.
    """
    s = np.linspace(0.0, line.end, POSES)
    derivatives = np.zeros((POSES, 3, robot.n))
    derivatives[:, 0] = (np.linalg.pinv(robot.jacobian(q)) @ line(s, 1)[..., None])[..., 0]
    e = np.linalg.norm(se3.error(robot.fk(q), line.pose(s)).reshape(POSES, 2, 3), axis=2)
    joints = JointPath(robot, line, s, q, derivatives, IKRecord(e[:, 0], e[:, 1], np.zeros(POSES, dtype=np.int64), s))
    limits, timed = MotionLimits.of(robot), make_law(law)
    try:
        enforced = timed.list_enforced(limits)
        trajectory = fit_to_limits(robot, timed.run(joints, limits), limits, enforced, line)
    except NoSolution as error:
        failure = PlanFailure.from_error(PlanStatus.TIMING_INFEASIBLE, error)
        return Plan(robot, line, limits, PlanStatus.TIMING_INFEASIBLE, solver, law, joints, failure, None, None)
    proof = Motion(robot, line, limits, trajectory, law, enforced, WIDE).certify()
    why = PlanFailure(PlanStatus.NOT_PROVED, 0.0, None, f"the certificate is not valid: {'; '.join(proof.reasons)}", "")
    status, found = (PlanStatus.SOLVED, None) if proof.is_valid else (PlanStatus.NOT_PROVED, why)
    return Plan(robot, line, limits, status, solver, law, joints, found, trajectory, proof)


SPOTS_PART = 4
"""Number of spots in one part of the work: a second or more of executions, so that workers have equal loads."""

PICTURED = 6
"""Number of spots whose planned and executed paths are stored for the picture, spread over the distance."""

PICTURE_POINTS = 41
"""Number of stored points of a path: enough for a smooth curve."""

NO_MOTION = 1e-9
"""Largest joint motion [rad, m] up to which an answer equals the start, and nothing is executed."""

SPLIT_PARTS = ("laser", "ik", "path", "servo")
"""Parts of the error, in the order in which they arise."""


@dataclass(frozen=True)
class SpotTrials(Trials):
    """Some spots of a block, shown once each: poses of the tool there (k, 4, 4) [1, m], and which methods are given them."""

    lists = ("numbers", "targets", "given")

    repeat: int = field(kw_only=True)
    targets: Array = field(kw_only=True)
    start: Array = field(kw_only=True)
    given: tuple[tuple[bool, ...], ...] = field(kw_only=True)
    pictured: tuple[int, ...] = field(kw_only=True)

    def asked(self) -> Iterator[tuple[int, Entry, int | None]]:
        """Return the executions of the shard: index of the spot, method, and budget."""
        for i in range(len(self.numbers)):
            for method, given in zip(self.block.methods, self.given[i], strict=True):
                for budget in budgets_of(self.block, method) if given and method.label in self.labels else ():
                    yield i, method, budget

    def about(self, i: int, method: Entry, budget: int | None) -> dict[str, Any]:
        """Return the fields that identify an execution."""
        return {
            "problem": self.numbers[i], "repeat": self.repeat, "method": budget_label(method.label, budget),
            "setting": method.label, "solver": short_name(method.name), "budget": budget, "along": method.along,
            "drive": self.block.drive,
        }  # fmt: skip


FIELDS = {
    "method": TEXT, **fields_of(WHOLE, "problem repeat"), **fields_of(TEXT, "solver setting"), "budget": WHOLE,
    "along": TRUTH, **EXECUTION, **fields_of(NUMBER, " ".join(f"error_{a}" for a in AXES)),
    "position_error": Field(pl.Float64, None, "position error", "mm", "less", 1e3),
    **fields_of(NUMBER, " ".join(f"{part}_{a}" for part in SPLIT_PARTS for a in (*AXES, "error"))),
    "split_rest": NUMBER, **fields_of(Field(pl.List(pl.Float32)), "planned tool beam"),
}  # fmt: skip
"""Fields of the rows: those of the spots are in the table of problems."""


class Spots(Kind):
    """Spots on graph paper, each with all methods under the same noise. Each file of rows is the work of any process."""

    name = "cell"
    title = "The executed cell"
    block = CellBlock
    fields = FIELDS
    order = 45
    alone = False

    def prepare(self, block: CellBlock, seed: int) -> tuple[Robot, ProblemSet]:
        """Check the drive and the options of every method and of the problem set, and sample the spots."""
        trial = trial_of(block, seed, 0, 0)
        drive_of(with_drive(block), trial, trial.robot.limits.clip(np.zeros(trial.robot.n)))
        with naming(f"cell {block.id!r}: options"):
            robot, problems = block.draw(seed)
        for method in block.methods:
            make_solver(robot, method.name, **method.ending_after(block.budgets[-1]).options)
        if (problems.starts != problems.starts[0]).any():
            raise InvalidInput(f"cell {block.id!r}: options", "several starts", "one start of the arm for all spots")
        with naming(f"cell {block.id!r}: robot"):
            make_law(block.law).need(MotionLimits.of(robot), robot)
        return robot, problems

    def shards(self, block: CellBlock, session: Session) -> Iterator[Shard]:
        """Write the problems, and divide the work."""
        robot, problems = session.prepared
        store_problems(session.folder, block, robot, problems)
        block, chosen, labels = with_drive(block), problems.chosen(block.count), tuple(m.label for m in block.methods)
        most = [set(problems.chosen(m.most).tolist()) & set(chosen.tolist()) for m in block.methods]
        distance = np.linalg.norm(problems.targets[:, :3, 3] - robot.fk(problems.starts[0])[:3, 3], axis=1)
        everywhere = [p for p in sorted(chosen.tolist(), key=distance.__getitem__) if all(p in given for given in most)]
        spread = np.linspace(0, len(everywhere) - 1, min(PICTURED, len(everywhere))).round().astype(int)
        pictured = tuple(everywhere[i] for i in spread)
        for repeat in range(block.repeats):
            for part, i in enumerate(chunks(chosen, SPOTS_PART)):
                given = tuple(tuple(p in of_method for of_method in most) for p in i.tolist())
                work = SpotTrials(
                    self, block, session.seed, tuple(i.tolist()), labels, repeat=repeat, targets=problems.targets[i],
                    start=problems.starts[0], given=given, pictured=pictured,
                )  # fmt: skip
                yield Shard(f"{repeat:02d}--{part:04d}", work, block.title)

    def compared_rows(self, block: CellBlock, rows: pl.DataFrame) -> pl.DataFrame:
        """Return the rows on which two runs are compared: one problem is one trial of a spot."""
        return rows.with_columns(problem=pl.format("{} {}", "problem", "repeat"))

    def keys(self, trials: SpotTrials) -> Iterator[dict[str, Any]]:  # type: ignore[override]
        """Yield the fields that identify each execution."""
        return (trials.about(*asked) for asked in trials.asked())

    def solve(self, trials: SpotTrials) -> Iterator[dict[str, Any]]:  # type: ignore[override]
        """Execute the trials."""
        made = [trial_of(trials.block, trials.seed, problem, trials.repeat) for problem in trials.numbers]
        shown = [_Shown(trials, i, trial) for i, trial in enumerate(made)]
        return (trials.about(i, method, k) | shown[i].executed(method, k) for i, method, k in trials.asked())


def budgets_of(block: CellBlock, method: Entry) -> tuple[int | None, ...]:
    """Return the budgets of a method; only None if it has default settings."""
    return (None,) if method.whole else block.budgets


class _Shown:
    """One measured spot and the executions of each method, with the same noise for all."""

    def __init__(self, work: SpotTrials, i: int, trial: Trial) -> None:
        self.work, self.trial, self.start = work, trial, work.start
        self.spot, self.robot = work.targets[i, :3, 3], trial.robot
        self.laser, self.unit = lasers(self.robot, self.start, work.block.laser_m, work.block.noise, trial.rng)
        self.reading: Spot = self.unit.read(self.spot, trial.rng)
        self.seen = self.laser.point(*self.reading)
        self.target = work.targets[i].copy()
        self.target[:3, 3] = self.seen
        self.keeps_path = work.repeat == 0 and work.numbers[i] in work.pictured
        self._before: dict[bytes, dict[str, Any]] = {}

    def executed(self, method: Entry, budget: int | None) -> dict[str, Any]:
        """Execute one method, along the whole line or in joint space to the answer after some iterations; return the facts."""
        if method.whole:
            return self._line(method)
        solver = make_solver(self.robot, method.name, **method.ending_after(budget).options)
        if method.along:
            return self._along(solver)
        result = solver.solve(self.target, self.start)
        key = result.q.tobytes()  # an iteration that has stopped gives the same answer, and the same execution
        if key not in self._before:
            self._before[key] = self._move(result.q)
        return self._before[key]

    def _drive(self) -> Any:
        return drive_of(self.work.block, self.trial, self.start)

    def _line(self, method: Entry) -> dict[str, Any]:
        solver = make_solver(self.robot, method.name, **method.options)
        cell = Cell(self.robot, self.laser, self._drive(), unit=self.unit)
        out = cell.move_to_spot(self.reading, true_spot=self.spot, timing=self.work.block.law, solver=solver)
        if out.error is None or not out.executions:
            step = "" if out.failed is None else f"{out.failed.name}: "
            return failure(self.work.block.drive, str(out.status), f"{step}{out.reason}")
        return facts_of(out.executions[-1]) | errors_of(out.error) | self._paths(out.executions[-1])

    def _along(self, solver: IKSolver) -> dict[str, Any]:
        """Execute the line through the answers after some iterations at each of its poses."""
        line = Line(self.robot.fk(self.start), self.target)
        if line.end <= NO_MOTION:
            return self._move(self.start)
        q = answers_along(line, self.start, solver)
        key = q.tobytes()
        if key not in self._before:
            planned = plan_through(self.robot, line, q, solver.name, self.work.block.law)
            self._before[key] = self._executed(planned, q[-1])
        return self._before[key]

    def _move(self, q: Array) -> dict[str, Any]:
        if np.abs(q - self.start).max() <= NO_MOTION:
            split = split_configurations(self.robot, self.spot, self.seen, q, self.start, self.start)
            return failure(self.work.block.drive, EXECUTED_TO_END, "the answer is the start: no motion") | errors_of(
                split
            )
        return self._executed(plan(self.robot, q, self.start, timing=self.work.block.law), q)

    def _executed(self, planned: Plan, q: Array) -> dict[str, Any]:
        """Execute a motion to a method's answer q (n,), and return its facts."""
        facts, execution = execute(self.work.block, planned, self._drive)
        if execution is None or not execution:
            return facts
        end = execution.plan.trajectory
        split = split_configurations(self.robot, self.spot, self.seen, q, end(end.end), execution.q[-1])
        return facts | errors_of(split) | self._paths(execution)

    def _paths(self, execution: Execution) -> dict[str, Any]:
        """Return the paths of the tool, planned and executed, and the beam, as flat lists of points."""
        if not self.keeps_path or execution.motion is None:
            return {}
        which = np.linspace(0, len(execution.t) - 1, PICTURE_POINTS).round().astype(int)
        planned = execution.motion(np.minimum(execution.t[which], execution.motion.end))
        tools = {"planned": self.robot.fk(planned), "tool": self.robot.fk(execution.q[which])}
        found = {name: T[:, :3, 3].ravel().tolist() for name, T in tools.items()}
        return found | {"beam": [*_origin(self.laser), *self.seen.tolist()]}


def _origin(laser: PanTiltLaser) -> list[float]:
    return [float(x) for x in laser.pose[:3, 3]]


def errors_of(split: ErrorSplit) -> dict[str, Any]:
    """Return the columns of an error and its parts."""
    parts = {part: getattr(split, part) for part in SPLIT_PARTS}
    found: dict[str, Any] = {f"error_{a}": float(x) for a, x in zip(AXES, split.total, strict=True)}
    found["position_error"] = float(np.linalg.norm(split.total))
    for part, vector in parts.items():
        found |= {f"{part}_{a}": float(x) for a, x in zip(AXES, vector, strict=True)}
        found[f"{part}_error"] = float(np.linalg.norm(vector))
    rest = split.total - sum(parts.values())
    return found | {"split_rest": float(np.abs(rest).max())}
