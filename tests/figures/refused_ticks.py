"""A set-point that is refused at every tick of a motion, and of the motion that resumes it: each gives an execution.

Three drives: an ideal arm with interpolated set-points, one with held set-points, and an arm with masses in MuJoCo. A case is
one tick of one drive, in the first motion or in the resumed one. The oracle is the record of the simulated arm: the execution
ends with the fault and at rest, on the joint line of the plan, and a drive without a fault resumes it to the goal.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

import optik
from planners import JointLine, MotionLimits, Plan, plan
from planners.cell import Execution, ExecutionStatus
from planners.cell.drives._simulated import SimulatedDrive
from planners.cell.drives.ideal import IdealDrive
from planners.cell.drives.mujoco import MujocoDrive
from planners.cell.drives.options import WrongSetpoint
from tests.figures.figure import Row, Value, main

START, MOVE = np.array([0.2, -1.2, 1.0, -0.6, 0.4, 0.1]), np.array([0.9, 0.3, -0.2, 0.2, 0.5, 1.1])
DRIVES = (("ideal", IdealDrive, {}), ("held", IdealDrive, {"hold": True}), ("mujoco", MujocoDrive, {}))
STOPPED_AT, OFF_LINE, AT_REST = 0.2, {"ideal": 1e-9, "held": 1e-9, "mujoco": 5e-3}, 1e-3
"""Time of the stop on request before the resumed motion [s]; largest distance from the joint line [rad] at the end, and
largest speed [rad/s] there."""


@lru_cache(maxsize=1)
def running() -> Plan:
    """A plan of about 1 s."""
    robot = optik.load("ur5e")
    made = plan(robot, JointLine(robot, START, START + MOVE), START, limits=MotionLimits(2.0, 10.0, 100.0))
    assert made
    return made


def drive_of(kind: int, q: np.ndarray, tick: int | None = None) -> SimulatedDrive:
    """A drive whose set-point for a tick is no number."""
    _, drive, options = DRIVES[kind]
    period = 0.004
    wrong = () if tick is None else (WrongSetpoint((tick - 0.5) * period, tick % 6, np.nan),)
    return drive(running().robot, q, period=period, disturbances=wrong, **options)


@lru_cache(maxsize=len(DRIVES))
def stopped(kind: int) -> Execution:
    """An execution that was stopped on request."""
    return drive_of(kind, START).execute(running(), stop=STOPPED_AT)


@lru_cache(maxsize=1)
def cases() -> list[tuple[int, bool, int]]:
    """The drive, whether the motion is the resumed one, and the tick of every case."""
    out: list[tuple[int, bool, int]] = []
    for kind in range(len(DRIVES)):
        whole = drive_of(kind, START).execute(running())
        rest = drive_of(kind, stopped(kind).q[-1]).resume(stopped(kind))
        for resumed, execution in ((False, whole), (True, rest)):
            assert execution and execution.plan.trajectory is not None
            ticks = round(execution.plan.trajectory.end / 0.004)
            out += [(kind, resumed, tick) for tick in range(1, ticks + 1)]
    return out


def measure(case: int) -> Row:
    """One refused set-point."""
    kind, resumed, tick = cases()[case]
    row: Row = {"drive": DRIVES[kind][0], "resumed": resumed, "tick": tick}
    try:
        if resumed:
            found = drive_of(kind, stopped(kind).q[-1], tick).resume(stopped(kind))
        else:
            found = drive_of(kind, START, tick).execute(running())
        again = drive_of(kind, found.q[-1]).resume(found)
    except Exception as error:  # the figure counts any of them
        return row | {"error": f"{type(error).__name__}: {error}"}
    along = float((found.q[-1] - START) @ MOVE / (MOVE @ MOVE))
    return row | {
        "error": "", "status": str(found.status), "speed": float(np.abs(found.dq[-1]).max()),
        "off": float(np.abs(found.q[-1] - START - along * MOVE).max()),
        "again": str(again.status), "goal": float(np.abs(again.q[-1] - START - MOVE).max()),
    }  # fmt: skip


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    raised = [row["error"] for row in rows if row["error"]]
    done = [row for row in rows if not row["error"]]
    fault = sum(row["status"] == ExecutionStatus.FAULT for row in done)
    fast = max((row["speed"] for row in done), default=np.nan)
    off = sum(row["off"] > OFF_LINE[row["drive"]] for row in done)
    again = sum(row["again"] == ExecutionStatus.DONE and row["goal"] <= 5e-3 for row in done)
    return [
        Value("exceptions", "0", f"{len(raised)} of {len(rows)} {sorted(set(raised))[:2]}", not raised),
        Value("status fault", "all", f"{fault} of {len(rows)}", fault == len(rows)),
        Value("largest speed at the end [rad/s]", f"≤ {AT_REST}", f"{fast:.3g}", fast <= AT_REST),
        Value("off the joint line at the end", "0", str(off), off == 0),
        Value("resumed to the goal", "all", f"{again} of {len(rows)}", again == len(rows)),
    ]


if __name__ == "__main__":
    main("refused_ticks", measure, len(cases()), judge)
