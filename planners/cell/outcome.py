"""Outcome: the result of a task of the cell, with its steps, the error of each round and the sources of the error."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.scene import Scene
from optik.types import Array
from planners.cell.drives.base import Execution
from planners.cell.error_split import ErrorSplit, PathSplit
from planners.plan import Plan

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
