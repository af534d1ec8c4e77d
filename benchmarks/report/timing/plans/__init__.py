"""Sections of the report on the line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blocks.arms import JOINT_LIMITS
from benchmarks.report.base import KindReport, Run, Section, Winner
from benchmarks.report.numbers import listed, number
from benchmarks.report.tables import Table
from benchmarks.report.timing.plans.motion import motion
from benchmarks.report.timing.plans.space import line_in_space, space
from benchmarks.report.timing.plans.tables import broken_limits, law_table, laws, line_plans
from optik.registry import short_name


def summary(run: Run) -> dict[str, Any] | None:
    """Describe the planned task; None if the suite has no line."""
    task = next(iter(run.suite.of("plans")), None)
    if task is None:
        return None
    move = ", ".join(number(1e3 * x) for x in task.move_m)
    start = ", ".join(f"{x:g}".replace("-", "−") for x in task.start_deg)
    words = (
        f"The line: {number(1e3 * float(np.linalg.norm(task.move_m)))} mm by ({move}) mm in the base frame at constant "
        f"orientation, from q = ({start})°, {task.samples} samples; inverse kinematics by {', '.join(task.solvers)}; time laws "
        f"{', '.join(task.laws)}."
    )
    return {"words": [words]}


def findings(run: Run) -> list[str]:
    """Return the durations of the laws with the limits that each violates, for the first IK method."""
    line = line_plans(run)
    if line is None or not line.solved:
        return []
    solver = line.solved[0]["solver"]
    words = []
    for p in line.solved:
        if p["solver"] == solver:
            breaks = broken_limits(p["certificate"])
            kept = f"exceeds limits: {', '.join(breaks)}" if breaks else "within every limit"
            words.append(f"{p['law']} {p['duration']:.3f} s ({kept})")
    return [f"Line of {number(1e3 * line.solved[0]['length'])} mm with {solver}: " + "; ".join(words) + "."]


def limitations(run: Run) -> list[str]:
    """List the limitations of a motion's figures."""
    line = line_plans(run)
    if line is None or not line.solved:
        return []
    limits = line.solved[0]["limits"]
    given = [field.replace("_", " ") for field in JOINT_LIMITS if limits.get(field) is not None]
    items = [
        "The tool's distance from the line is a proved bound for every instant, at most 5 % (or a nanometre) above the "
        "largest value found. Peak velocities, accelerations and jerks are exact, from the roots of "
        "the polynomials' derivatives.",
        f"The limits on {listed(given)} are those of the robot file; the paper gives none. "
        + ("Torques are those of the arm's model. The" if "torque" in given else "Dynamics, torque limits, the")
        + " controller and a real arm are not included.",
    ]
    if any(p["law"] == "toppra" for p in line.solved):
        items.append(
            "TOPP-RA enforces its limits at grid points. Between them a ratio may exceed 1 by a few millionths, less on a "
            "finer grid. It has no jerk limit by design."
        )
    return items


def winners(run: Run) -> list[Winner]:
    """Return the law with the shortest motion among those that respect every limit."""
    found = line_plans(run)
    if found is None:
        return []
    solved = [p for p in found.solved if p["solver"] == found.solver]
    within = [p for p in solved if not broken_limits(p["certificate"])]
    if not within:
        return []
    entries = [(p["law"], p["duration"], p["duration"], p["duration"]) for p in within]
    out = [p["law"] for p in solved if p not in within]
    note = f"one line of {number(1e3 * within[0]['length'])} mm, exact durations"
    return [
        Winner(
            "Shortest motion along the line within every limit", "s", "less",
            tuple(sorted(entries, key=lambda entry: entry[1])), "laws",
            note + (f"; not ranked (limit exceeded): {listed(out)}" if out else ""),
        )
    ]  # fmt: skip


def tables(run: Run) -> list[Table]:
    """Return the table of the time laws."""
    found = line_plans(run)
    return [] if found is None else [law_table(found)]


REPORT = KindReport(
    (
        Section("The line", "plans", summary, order=70, place="summary"),
        Section("The line in space (Fig. 5 and 6)", "line", line_in_space, Path(__file__).with_name("arm.html.j2"), 70),
        Section("Joint and tool motion", "motion", motion, order=80),
        Section("Clearance", "clearance-line", space, order=75),
        Section("Time laws", "laws", laws, order=90),
    ),
    lambda blocks: ("inverse kinematics", "time laws along a straight line"),
    winners=winners,
    tables=tables,
    findings=findings,
    limitations=limitations,
    labels=lambda block: [short_name(law) for law in block.laws],
)
