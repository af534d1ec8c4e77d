"""Outcome: the result of a task of the cell, with its steps, the sources of its error, and its facts as rows of a table."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.check import finite_array
from optik.errors import InvalidInput
from optik.ik import IKSolver
from optik.registry import load_method
from optik.scene import Scene
from optik.types import Array
from planners.cell.drives import drives
from planners.cell.drives.base import Execution
from planners.motion.show import payload_facts
from planners.plan import Plan

# ---------------- the tool's error as the sum of the errors of laser


class ErrorSplit(NamedTuple):
    """Executed tool minus true spot, e = e_laser + e_ik + e_path + e_servo, at one or several instants, in the base frame.

    Attributes
    ----------
    laser : (3,) or (k, 3) array
        Target minus true spot: noise and calibration of the laser unit [m].
    ik : (3,) or (k, 3) array
        Tool at the IK method's own answer, before Newton polishing, minus target [m].
    path : (3,) or (k, 3) array
        Tool at the planned configuration minus tool at the IK method's answer [m].
    servo : (3,) or (k, 3) array
        Tool at the executed configuration minus tool at the planned one [m].
    total : (3,) or (k, 3) array
        Executed tool minus true spot [m]: the sum, to rounding.
    """

    laser: Array
    ik: Array
    path: Array
    servo: Array
    total: Array

    @property
    def norms(self) -> dict[str, Array]:
        """Lengths of the five vectors by name [m]."""
        return {name: np.linalg.norm(part, axis=-1) for name, part in self._asdict().items()}

    def at(self, k: int) -> Self:
        """Return the split at one instant.

        Parameters
        ----------
        k : int
            Number of the instant.

        Returns
        -------
        ErrorSplit
            Its vectors (3,) [m].
        """
        return type(self)(*(part[k] for part in self))

    def to_dict(self) -> dict[str, list[float]]:
        """Return the vectors by name as plain data [m]."""
        return {name: part.tolist() for name, part in self._asdict().items()}


class PathSplit(NamedTuple):
    """The error split along the path: instants t (k,) [s], path parameters s (k,) [m, or rad], and vectors (k, 3)."""

    t: Array
    s: Array
    error: ErrorSplit


def split_errors(
    spot: ArrayLike, target: ArrayLike, answer: ArrayLike, planned: ArrayLike, executed: ArrayLike
) -> ErrorSplit:
    """Split the tool's error by points, at one or several instants.

    Parameters
    ----------
    spot : (3,) or (k, 3) array
        The true spot, or the point of the line to it at each instant [m].
    target : (3,) or (k, 3) array
        The spot by the laser unit [m].
    answer : (3,) or (k, 3) array
        Tool at the configuration that the IK method returned [m].
    planned : (3,) or (k, 3) array
        Tool at the planned configuration [m].
    executed : (3,) or (k, 3) array
        Tool at the true configuration of the arm [m].

    Returns
    -------
    ErrorSplit
        Its parts, in the shape to which the points broadcast.

    Raises
    ------
    InvalidInput
        No points, or NaN or infinity in them.
    """
    values = {"spot": spot, "target": target, "answer": answer, "planned": planned, "executed": executed}
    expected = "a point (3,) or points (k, 3)"
    points = [finite_array(value, name, expected, (..., 3)) for name, value in values.items()]
    try:
        a, b, c, d, e = np.broadcast_arrays(*points)
    except ValueError:
        got = ", ".join(f"{name} {p.shape}" for name, p in zip(values, points, strict=True))
        raise InvalidInput(
            "spot, target, answer, planned, executed", f"shapes {got}", "shapes that broadcast"
        ) from None
    return ErrorSplit(b - a, c - b, d - c, e - d, e - a)


def split_configurations(
    robot: Robot, spot: ArrayLike, target: ArrayLike, answer: ArrayLike, planned: ArrayLike, executed: ArrayLike
) -> ErrorSplit:
    """Split the tool's error by configurations: `split_errors` of the tool's positions at them.

    Parameters
    ----------
    robot : Robot
        The arm.
    spot, target : (3,) or (k, 3) array
        The true spot, and the spot by the laser unit [m].
    answer, planned, executed : (n,) or (k, n) array
        The IK method's own answer, the planned and the executed configuration [rad, m].

    Returns
    -------
    ErrorSplit
        Its parts.

    Raises
    ------
    InvalidInput
        Wrong shapes, NaN or infinity.
    """
    tools = (robot.fk(q)[..., :3, 3] for q in (answer, planned, executed))
    return split_errors(spot, target, *tools)


def solve_poses(solver: IKSolver, poses: Array, q: Array) -> Array:
    """Return the answers to poses in order, each solved from the previous answer, as in the paper."""
    limits = solver.robot.limits
    answers = np.empty((len(poses), solver.robot.n))
    for k, pose in enumerate(poses):
        q = answers[k] = solver.solve(pose, np.clip(q, limits.lower, limits.upper)).q
    return answers


def split_along(execution: Execution, solver: IKSolver, true_spot: Array, samples: int) -> PathSplit:
    """Split the tool's error at the steps of the plant that are nearest to the samples of the path.

    The path parameter of each instant is that of the path point nearest to the planned tool. The desired point of the executed
    tool is at the same fraction of the line to the true spot.
    """
    robot, path, t = execution.robot, execution.plan.path, execution.t
    motion = execution.plan.trajectory if execution.motion is None else execution.motion
    proof = execution.plan.certificate
    wanted = np.interp(np.linspace(0.0, path.end, samples), proof.s, proof.t)
    chosen = np.unique(np.append(np.clip(np.searchsorted(t, wanted), 0, t.size - 1), t.size - 1))
    # without a motion of its own, the arm stood at the end of the plan already
    planned = motion(
        np.minimum(t[chosen], motion.end) if execution.motion is not None else motion.end * np.ones(chosen.size)
    )
    s = path.nearest(robot.fk(planned))
    s[-1] = path.end  # an execution ends where its motion does, and that is the end of the path
    poses = path.pose(s)
    answers = solve_poses(solver, poses, planned[0])
    off = true_spot - path.pose(path.end)[:3, 3]
    desired = poses[:, :3, 3] + (s / path.end)[:, None] * off
    split = split_configurations(robot, desired, poses[:, :3, 3], answers, planned, execution.q[chosen])
    return PathSplit(t[chosen], s, split)


# ---------------- outcome


MEASURED = ("tool", "residual", "error")
"""The vectors of a `Round` in `Outcome.to_dict`."""


class CellStatus(StrEnum):
    """The status of a task. Only ARRIVED is success; the arm is at rest in all of them as far as the drive knows.

    NO_SPOT: the laser unit gives no point. NO_PLAN: no motion with a valid certificate was found. REFUSED: the drive or
    the gripper refused, and nothing was sent. STOPPED: the drive was stopped on request. FAULT: a fault of the drive
    stopped it. NOT_MEASURED: the tool could not be measured for a correction. SPOT_MOVES: the spot moved more often than
    allowed. DRY_RUN: the drive checked the motion and sent nothing.
    """

    ARRIVED = "arrived"
    NO_SPOT = "no_spot"
    NO_PLAN = "no_plan"
    REFUSED = "refused"
    STOPPED = "stopped"
    FAULT = "fault"
    NOT_MEASURED = "not_measured"
    SPOT_MOVES = "spot_moves"
    DRY_RUN = "dry_run"


class Step(NamedTuple):
    """One step of a task.

    Attributes
    ----------
    name : str
        ``laser``, ``target``, ``line``, ``joints``, ``timing``, ``certificate``, ``execution``, ``tool``, ``open``,
        ``close``, ``stop`` or ``replan``.
    ok : bool
        Whether it succeeded.
    reason : str
        A description of its result, or why it failed.
    advice : str
        What to try if it failed.
    result : object
        Its result, in the order of the names: Sighting, target pose (4, 4), Line, JointPath, Trajectory, Certificate,
        Execution, true tool pose (4, 4), Robot, Robot, Execution, pose (4, 4) of the new target; None if it has none.
    seconds : float
        Its computation time [s].
    """

    name: str
    ok: bool
    reason: str
    advice: str
    result: Any
    seconds: float


class Round(NamedTuple):
    """One execution to the spot with its measurement; the first is the motion itself, the others are corrections.

    Attributes
    ----------
    plan : Plan
        The plan.
    execution : Execution
        The execution of the plan.
    tool : (3,) array
        True position of the tool at the end, in the base frame [m].
    residual : (3,) array or None
        Measured spot minus measured tool, both by the laser unit [m]; None if it was not measured.
    error : (3,) array
        Executed tool minus true spot [m].
    """

    plan: Plan
    execution: Execution
    tool: Array
    residual: Array | None
    error: Array


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result of a task of the cell. ``bool(outcome)`` is success; everything is in the arm's base frame.

    Attributes
    ----------
    robot : Robot
        The arm with its load; its tool is the grasp point.
    status : CellStatus
        ARRIVED, or another status.
    steps : tuple of Step
        All steps in order; if the task failed, the last step failed.
    rounds : tuple of Round
        The motion and its corrections.
    error : ErrorSplit or None
        Error split at the end of the last round; None without a round.
    path_split : PathSplit or None
        Error split along the path of the first round.
    target : (4, 4) array or None
        The last target pose of the tool [1, m].
    spot : (3,) array or None
        Position of the spot by the laser unit [m].
    true_spot : (3,) array or None
        True position of the spot in a simulation [m].
    beam : ((3,), (3,)) tuple of arrays, or None
        The laser's origin and the spot, for drawings [m].
    floor : float or None
        Root mean square of the error that the noise of the readings leaves after a correction [m]; None without a correction.
    base : (4, 4) array
        T_world_platform, the pose of the base frame in the world [1, m].
    scene : Scene or None
        The obstacles.
    notes : tuple of str
        Remarks for the reader, including those of the drive.
    """

    robot: Robot
    status: CellStatus
    steps: tuple[Step, ...]
    rounds: tuple[Round, ...] = ()
    error: ErrorSplit | None = None
    path_split: PathSplit | None = None
    target: Array | None = None
    spot: Array | None = None
    true_spot: Array | None = None
    beam: tuple[Array, Array] | None = None
    floor: float | None = None
    base: Array | None = None
    scene: Scene | None = None
    notes: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return self.status is CellStatus.ARRIVED

    @property
    def failed(self) -> Step | None:
        """The step that failed, or None."""
        return next((step for step in reversed(self.steps) if not step.ok), None) if not self else None

    @property
    def reason(self) -> str:
        """Reason of a failed task; otherwise empty."""
        return self.failed.reason if self.failed is not None else ""

    @property
    def advice(self) -> str:
        """Advice for a failed task; otherwise empty."""
        return self.failed.advice if self.failed is not None else ""

    @property
    def executions(self) -> tuple[Execution, ...]:
        """All executions in order, stops for a moving spot included."""
        return tuple(step.result for step in self.steps if isinstance(step.result, Execution))

    @property
    def tool(self) -> Array | None:
        """True final position of the tool (3,) [m]; None if nothing was executed."""
        q = self.executions[-1].q[-1:] if self.executions else np.empty((0, self.robot.n))
        return self.robot.fk(q[0])[:3, 3] if len(q) and np.isfinite(q).all() else None

    def __str__(self) -> str:
        lines = [f"{self.status}" + (f" at step {self.failed.name}" if self.failed is not None else "")]
        for step in self.steps:
            mark = "ok" if step.ok else "FAILED"
            lines.append(f"  {step.name:<12}{1e3 * step.seconds:9.1f} ms  {mark:<6}  {step.reason}")
        if self.advice:
            lines.append(f"  advice: {self.advice}")
        if self.error is not None:
            rows = self.error.to_dict().items()
            lines.append("  error [mm]" + "".join(f"{axis:>11}" for axis in ("x", "y", "z", "length")))
            for name, part in rows:
                numbers = "".join(f"{round(1e3 * x, 4) + 0.0:11.4f}" for x in (*part, float(np.linalg.norm(part))))
                lines.append(f"    {name:<8}{numbers}")
        if len(self.rounds) > 1:
            off = ", ".join(f"{1e3 * np.linalg.norm(each.error):.4f}" for each in self.rounds)
            lines.append(
                f"  errors of the rounds: {off} mm; the noise of the readings alone: {1e3 * (self.floor or 0.0):.3g} mm (RMS)"
            )
        return "\n".join(lines + [f"  note: {note}" for note in self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Return the outcome as plain data [m, s], without the plans and executions."""
        failed = (
            {} if self.failed is None else {"failed": self.failed.name, "reason": self.reason, "advice": self.advice}
        )
        points = {name: getattr(self, name) for name in ("spot", "true_spot", "tool", "target", "base")}
        along = None
        if self.path_split is not None:
            along = {
                "t": self.path_split.t.tolist(),
                "s": self.path_split.s.tolist(),
                "error": self.path_split.error.to_dict(),
            }
        return {
            "format": "optik-cell/1", "robot": self.robot.name, "robot_fingerprint": self.robot.fingerprint,
            "status": str(self.status), **failed,
            "steps": [step._asdict() | {"result": type(step.result).__name__} for step in self.steps],
            **{name: None if point is None else point.tolist() for name, point in points.items()},
            "error": None if self.error is None else self.error.to_dict(), "path_split": along,
            "rounds": [
                {name: None if value is None else value.tolist() for name, value in each._asdict().items() if name in MEASURED}
                for each in self.rounds
            ],
            "floor": self.floor, "notes": list(self.notes),
        }  # fmt: skip

    def in_world(self, points: Array) -> Array:
        """Return points of the arm's base frame in the world.

        Parameters
        ----------
        points : (..., 3) array
            In the base frame [m].

        Returns
        -------
        (..., 3) array
            In the world [m].
        """
        if self.base is None:
            return np.array(points)
        moved: Array = points @ self.base[:3, :3].T + self.base[:3, 3]
        return moved


# ---------------- facts of an execution and of a task of the cell


def execution_facts(execution: Execution, unread: int) -> tuple[tuple[str, str], ...]:
    """Return the end of an execution as rows."""
    rows = [("Drive", drive_words(execution.drive)), ("Execution", str(execution.status).replace("_", " "))]
    if execution.reason:
        rows.append(("Reason", execution.reason))
    if execution.advice:
        rows.append(("Advice", execution.advice))
    if execution.late:
        rows.append(("Late set-points", str(execution.late)))
    rows += [*unread_facts(unread), *(("Note", note) for note in execution.notes)]
    return tuple(rows)


def drive_words(name: str) -> str:
    """Return the name of a drive, marked if it is simulated."""
    kind = load_method("planners.cell.drives", name, "drive") if name in drives() else None
    return f"{name} (simulated)" if getattr(kind, "simulated", False) else name


def outcome_facts(outcome: Outcome) -> tuple[tuple[str, str], ...]:
    """Return a task of the cell as rows: status, error and its parts, rounds, steps and notes."""
    rows = [("Task", str(outcome.status).replace("_", " "))]
    if outcome.failed is not None:
        rows += [("Failed step", outcome.failed.name), ("Reason", outcome.reason), ("Advice", outcome.advice)]
    if outcome.error is not None:
        norms = {name: _millimetres(float(size)) for name, size in outcome.error.norms.items()}
        rows.append(("Error at the end", norms.pop("total")))
        rows.append(("Parts of the error", ", ".join(f"{name} {size}" for name, size in norms.items())))
    for k, each in enumerate(outcome.rounds):
        what = f"Correction {k}" if k else "First motion"
        rows.append((what, f"{_millimetres(float(np.linalg.norm(each.error)))} from the spot"))
    if outcome.executions:
        rows.append(("Drive", drive_words(outcome.executions[0].drive)))
    rows += payload_facts(outcome.robot)
    rows.append(("Steps", ", ".join(f"{step.name} {'done' if step.ok else 'failed'}" for step in outcome.steps)))
    return (*rows, *(("Note", note) for note in outcome.notes))


def _millimetres(length: float) -> str:
    """Return a length [m] as text; below a nanometre it is rounding."""
    return f"{1e3 * length:.3g} mm" if length >= 1e-9 else "below 1 nm"


def unread_facts(unread: int) -> tuple[tuple[str, str], ...]:
    """Return the number of instants that are not drawn as rows."""
    words = f"{unread} instants without an encoder reading of every joint"
    return (("Not drawn", words),) if unread else ()
