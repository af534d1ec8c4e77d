"""The executed cell: spots on graph paper, on a simulated drive; settings, trials and rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.util import find_spec
from typing import Annotated, Any, NamedTuple

import numpy as np
import polars as pl
from pydantic import AfterValidator, model_validator

from benchmarks.blocks.base import NUMBER, TEXT, TRUTH, WHOLE, Field, Kind, Session, Shard, Trials, chunks, fields_of
from benchmarks.blocks.block import Column, Entry, largest, mean, quantile, share
from benchmarks.blocks.contest import trial_seed
from benchmarks.blocks.entries import BudgetedMethod, ProblemBlock, arm_with, store_problems
from benchmarks.problems.base import ProblemSet
from benchmarks.settings import Budgets, Count, Entries, Flag, LawName, Settings, Three, key, naming, numbered, one_of
from optik import se3
from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.ik import IKSolver, Tolerance, make_solver
from optik.registry import short_name
from optik.types import Array
from planners.cell.cell import Cell
from planners.cell.drives import Drive, make_drive
from planners.cell.drives.base import PERIOD, Execution
from planners.cell.laser import PanTiltLaser
from planners.cell.outcome import ErrorSplit, split_configurations
from planners.cell.sighting import Spot
from planners.following.follow import PlanFailure
from planners.following.joint_path import IKRecord, JointPath
from planners.limits import MotionLimits
from planners.motion import Motion
from planners.motion.motion import stretch_analysed
from planners.paths.line import Line
from planners.plan import Plan, PlanStatus, make_law, plan

# ---------------- settings and measures of blocks of the executed cell


WITHIN_M = 2e-3
"""Accuracy on each axis that the paper claims [m]."""

AXES = ("x", "y", "z")
"""Suffixes of columns for the axes of the base frame."""


WITHIN = share((pl.max_horizontal(*(pl.col(f"error_{a}").abs() for a in AXES)) <= WITHIN_M).fill_null(value=False))
"""Percentage of trials within the paper's accuracy on each axis, with its Wilson 95 % interval."""


MEASURES = (
    Column("within_2mm", "within 2 mm on each axis", "%", show="share", of=WITHIN),
    Column("p95_error_mm", "95th percentile of the position error", "mm", of=quantile("position_error", 0.95, 1e3)),
    Column("worst_servo_mm", "largest servo error at the end", "mm", of=largest("servo_error", 1e3)),
    Column("worst_split_m", "largest |total − sum of its parts|", "m", of=largest("split_rest")),
    Column("executed", "executed to the end", "%", of=mean(pl.col("status") == "executed", 100.0)),
    Column("torque_ratio", "largest torque / certificate's bound", show="exact", of=largest("torque_ratio")),
)  # fmt: skip
"""Measures that a target can name: of spots, and of every executed motion."""

SPOTS = "spots"
"""The type of motions of a block."""

AUTO_DRIVE, DRIVES = "auto", ("auto", "ideal", "mujoco")
"""Drives of a block; ``auto`` is mujoco if it is installed, else ideal. None of them moves a real arm."""

Amount = Annotated[float, numbered("a number, 0 or more", least=0.0)]
"""A standard deviation or a half width."""


def _below_1(value: float) -> float:
    if value >= 1.0:
        raise InvalidInput("", value, "a number below 1")
    return value


Share = Annotated[Amount, AfterValidator(_below_1)]
"""Half width of a factor, below 1."""


class Noise(Settings):
    """Random quantities of a trial: standard deviations of normal distributions, half widths of uniform ones."""

    laser_angle: Amount = key("Standard deviation of pan and of tilt.", 0.0, "rad")
    laser_range: Amount = key("Standard deviation of the range.", 0.0, "m")
    laser_position: Amount = key(
        "Standard deviation of each coordinate of the laser unit's calibrated position.", 0.0, "m"
    )
    laser_rotation: Amount = key(
        "Standard deviation of each component of the laser unit's calibrated orientation.", 0.0, "rad"
    )
    friction: Share = key("Half width of the factor on the friction of each joint, uniform around 1.", 0.0, "1")
    payload: Share = key("Half width of the factor on the mass in the tool, uniform around 1.", 0.0, "1")
    encoder_counts: Annotated[float, numbered("1 or more counts per turn", least=1.0)] = key(
        "Counts of an encoder per turn.", 2.0**20, "1"
    )
    encoder_angle: Amount = key("Standard deviation of an encoder's readings.", 0.0, "rad, m")


class CellMethod(BudgetedMethod):
    """A method with budgets, from the start or (``along``) at each pose; or with ``whole`` and its default settings."""

    along: Flag = key(
        "Whether the method iterates at each of 151 poses of the line, starting from its previous solution.", False
    )

    def entry(self) -> Entry:
        """Return the method as an entry of the block."""
        if self.whole and self.along:
            raise InvalidInput("", "both `whole` and `along`", "only one of them (`along` has budgets)")
        found = super().entry()
        named = f"{found.label}, at each pose" if self.along and "label" not in self.model_fields_set else found.label
        return Entry(named, found.name, found.options, found.most, whole=self.whole, along=self.along)


class CellBlock(ProblemBlock):
    """Spots on graph paper: iterations of an IK method move the tool to each spot, directly and along the line.

    A simulated drive executes the motions. A method that is ``whole`` takes the tool along the straight line. The others move
    it at each budget, in joint space to their own answer, or with ``along`` through their answers at each pose of the line.
    """

    noun = "cell"
    measures = MEASURES

    what: Annotated[str, one_of(SPOTS)] = key("What is executed: `spots` on graph paper.", SPOTS)
    drive: Annotated[str, one_of(*DRIVES)] = key(
        "`mujoco` or `ideal`; `auto` is `mujoco` if it is installed.", AUTO_DRIVE
    )
    period: Annotated[float, numbered("seconds above 0", above=0.0)] = key("Period of the servo.", PERIOD, "s")
    payload: Annotated[float | None, numbered("kilograms, 0 or more", least=0.0)] = key(
        "Mass in the tool; by default that of the robot file.", None, "kg"
    )
    noise: Noise = key("Variation from trial to trial.", Noise())
    methods: Annotated[tuple[Entry, ...], Entries(CellMethod)] = key("The IK methods.")
    budgets: Budgets = key("Iterations at which the methods are stopped, increasing.", (1, 2, 3, 5, 8, 12, 20))
    law: LawName = key("Time law of all motions.", "optimal")
    count: Count = key("Number of spots, those with a known solution first.", 60)
    repeats: Count = key("Trials of each spot, each with other noise.", 1)
    laser_m: Three = key("Position of the laser unit in the base frame.", (-0.6, 0.3, 0.3), "m")

    @model_validator(mode="after")
    def _payload_varies(self) -> CellBlock:
        if self.payload is None and "payload" in self.noise.model_fields_set:
            raise InvalidInput("noise: payload", "no `payload` of the block", "a mass in the tool that can vary")
        return self

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Every method at every budget, in the order of the suite."""
        return tuple(
            Entry(
                budget_label(m.label, k),
                m.name,
                m.options | ({"max_iterations": k} if k else {}),
                whole=m.whole,
                along=m.along,
            )
            for m in self.methods
            for k in (self.budgets if not m.whole else (None,))
        )


def budget_label(label: str, budget: int | None) -> str:
    """Return the name of a method at one budget in reports and targets."""
    return label if budget is None else f"{label}, {budget} iteration{'s' if budget > 1 else ''}"


# ---------------- one trial of the cell


EXECUTION = {
    "drive": TEXT, "status": Field(pl.String, "crashed"),
    "reason": Field(pl.String, "the process ended, or an error was raised"),
    "duration": Field(pl.Float64, None, "duration", "s", "less"),
    "tracking_m": Field(pl.Float64, None, "tracking error of the tool", "mm", "less", 1e3), "tracking_rad": NUMBER,
    "tracking_joint": TEXT, "torque_ratio": NUMBER, "torque_joint": TEXT,
    "energy": Field(pl.Float64, None, "energy", "J", "less"), "late": WHOLE,
}  # fmt: skip
"""Fields of every execution."""

EXECUTED_TO_END = "executed"
"""Status of a completely executed motion; other statuses are those of the plan, the drive or the cell."""


def trial_facts(execution: Execution) -> dict[str, Any]:
    """Return the facts on an execution."""
    facts = failure(execution.drive, EXECUTED_TO_END if execution else str(execution.status), execution.reason)
    if execution.motion is None or len(execution.t) < 2:
        return facts
    motion, names = execution.motion, execution.robot.joint_names
    planned = motion(np.minimum(execution.t, motion.end))
    off = np.abs(execution.q - planned)
    joint = int(off.max(axis=0).argmax())
    tools = execution.robot.fk(execution.q)[:, :3, 3] - execution.robot.fk(planned)[:, :3, 3]
    facts |= {
        "duration": float(execution.plan.trajectory.duration), "tracking_rad": float(off.max()),
        "tracking_joint": names[joint], "tracking_m": float(np.linalg.norm(tools, axis=1).max()), "late": execution.late,
    }  # fmt: skip
    if execution.torque is not None:
        facts["energy"] = float(np.trapezoid(np.maximum(execution.torque * execution.dq, 0.0).sum(axis=1), execution.t))
        peak = np.abs(execution.torque).max(axis=0)
        bound = np.abs(np.asarray(execution.plan.certificate.torque.value, dtype=float))
        if np.isfinite(bound).all() and (bound > 0.0).all():
            worst = int(np.argmax(peak / bound))
            facts |= {"torque_ratio": float(peak[worst] / bound[worst]), "torque_joint": names[worst]}
    return facts


def failure(drive: str, status: str, reason: str) -> dict[str, Any]:
    """Return the facts on a motion that was not executed."""
    return dict.fromkeys(EXECUTION) | {"drive": drive, "status": status, "reason": reason}


def execute(block: CellBlock, planned: Plan, drive: Callable[[], Drive]) -> tuple[dict[str, Any], Execution | None]:
    """Execute a motion; return the facts on it, and the execution if there is a motion."""
    if not planned:
        why = str(planned.status) if planned.failure is None else planned.failure.reason
        return failure(block.drive, str(planned.status), why), None
    execution = drive().execute(planned)
    return trial_facts(execution), execution


class Trial(NamedTuple):
    """Objects of one trial."""

    robot: Robot  # the arm as it is planned for
    plant: Robot  # the arm as it truly is: other friction and another payload
    seed: int  # of the encoders' noise
    rng: np.random.Generator  # for the laser's noise


def with_drive(block: Any) -> Any:
    """Return a block with the drive that it has on this machine."""
    if block.drive != AUTO_DRIVE:
        return block
    return block.model_copy(update={"drive": "mujoco" if find_spec("mujoco") is not None else "ideal"})


def trial_of(block: CellBlock, seed: int, number: int, repeat: int) -> Trial:
    """Sample the random quantities of a trial. They depend only on the arguments, not on the process or on other work."""
    robot = _arm(block.robot, block.payload)
    drawn = trial_seed(seed, number, "cell spot", repeat)
    rng = np.random.default_rng(drawn)
    return Trial(robot, plant_of(robot, block.noise, rng), drawn % 2**31, rng)


@lru_cache(maxsize=8)
def _arm(robot: str, payload: float | None) -> Robot:
    """Load an arm with its payload; reading its file takes as long as planning a motion."""
    return arm_with(robot, payload)


def plant_of(robot: Robot, noise: Noise, rng: np.random.Generator) -> Robot:
    """Return the true arm."""
    friction, payload = (
        1.0 + noise.friction * rng.uniform(-1.0, 1.0, robot.n),
        1.0 + noise.payload * rng.uniform(-1.0, 1.0),
    )
    if robot.inertia is None:
        return robot
    plant = robot.with_inertia(viscous=robot.inertia.viscous * friction, coulomb=robot.inertia.coulomb * friction)
    if robot.payload is None:
        return plant
    held = robot.payload
    return plant.with_payload(held.masses[-1] * payload, held.com, held.inertia * payload)


def drive_of(block: CellBlock, trial: Trial, q: Array) -> Drive:
    """Return a drive whose arm is at rest."""
    options = {"plant": trial.plant} if block.drive == "mujoco" else {}
    return make_drive(
        block.drive, trial.robot, q=q, period=block.period, seed=trial.seed, encoder=block.noise.encoder_counts,
        encoder_noise=block.noise.encoder_angle, **options,
    )  # fmt: skip


def lasers(
    robot: Robot, q: Array, position: tuple[float, ...], noise: Noise, rng: np.random.Generator
) -> tuple[PanTiltLaser, PanTiltLaser]:
    """Return the calibrated and the true pose of the laser unit."""
    pose = _looking(np.array(position), robot.fk(q)[:3, 3], -robot.gravity)
    spread = np.repeat([noise.laser_position, noise.laser_rotation], 3)
    laser = PanTiltLaser(
        pose, angle_noise=noise.laser_angle, range_noise=noise.laser_range, pose_covariance=np.diag(spread**2)
    )
    twist = spread * rng.normal(size=6)
    true = pose.copy()
    true[:3, 3] += twist[:3]
    true[:3, :3] = se3.exp_so3(twist[3:]) @ pose[:3, :3]
    return laser, laser.with_pose(true)


def _looking(position: Array, at: Array, up: Array) -> Array:
    """Return a pose whose x axis points to a point, and whose z axis is as close to vertical as possible."""
    x = at - position
    x /= np.linalg.norm(x)
    z = up - (up @ x) * x
    z /= np.linalg.norm(z)
    return se3.pose(np.stack([x, np.cross(z, x), z], axis=1), position)


# ---------------- executed spots on graph paper


POSES = 151
"""Poses of the line: 3 s at intervals of 0.02 s, as in the paper."""
WIDE = Tolerance(1.0, np.pi)
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
        trajectory = stretch_analysed(timed.run_with_analysis(joints, limits), limits, enforced).trajectory
    except NoSolution as error:
        failure = PlanFailure.from_error(PlanStatus.TIMING_INFEASIBLE, error)
        return Plan(robot, line, limits, PlanStatus.TIMING_INFEASIBLE, solver, law, joints, failure, None, None)
    proof = Motion(robot, line, limits, trajectory, law, enforced, WIDE).certify()
    why = PlanFailure(PlanStatus.NOT_PROVED, 0.0, None, f"the certificate is not valid: {'; '.join(proof.reasons)}", "")
    status, refusal = (PlanStatus.SOLVED, None) if proof.is_valid else (PlanStatus.NOT_PROVED, why)
    return Plan(robot, line, limits, status, solver, law, joints, refusal, trajectory, proof)


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

    def executions(self) -> Iterator[tuple[int, Entry, int | None]]:
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
        return (trials.about(*asked) for asked in trials.executions())

    def solve(self, trials: SpotTrials) -> Iterator[dict[str, Any]]:  # type: ignore[override]
        """Execute the trials."""
        made = [trial_of(trials.block, trials.seed, problem, trials.repeat) for problem in trials.numbers]
        shown = [_SpotExecutions(trials, i, trial) for i, trial in enumerate(made)]
        return (trials.about(i, method, k) | shown[i].executed(method, k) for i, method, k in trials.executions())


def budgets_of(block: CellBlock, method: Entry) -> tuple[int | None, ...]:
    """Return the budgets of a method; only None if it has default settings."""
    return (None,) if method.whole else block.budgets


class _SpotExecutions:
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
        return trial_facts(out.executions[-1]) | errors_of(out.error) | self._paths(out.executions[-1])

    def _along(self, solver: IKSolver) -> dict[str, Any]:
        """Execute the line through the answers after some iterations at each of its poses."""
        line = Line(self.robot.fk(self.start), self.target)
        if line.end <= NO_MOTION:
            return self._move(self.start)
        q = answers_along(line, self.start, solver)
        key = q.tobytes()
        if key not in self._before:
            planned = plan_through(self.robot, line, q, solver.name, self.work.block.law)
            self._before[key] = self._execute(planned, q[-1])
        return self._before[key]

    def _move(self, q: Array) -> dict[str, Any]:
        if np.abs(q - self.start).max() <= NO_MOTION:
            split = split_configurations(self.robot, self.spot, self.seen, q, self.start, self.start)
            return failure(self.work.block.drive, EXECUTED_TO_END, "the answer is the start: no motion") | errors_of(
                split
            )
        return self._execute(plan(self.robot, q, self.start, timing=self.work.block.law), q)

    def _execute(self, planned: Plan, q: Array) -> dict[str, Any]:
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


# ---------------- the executed cell


METHOD = Spots
