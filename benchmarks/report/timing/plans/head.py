"""The line at the head of the report: what was planned, key findings, limitations."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.report.numbers import number
from benchmarks.report.run import Run
from benchmarks.report.timing.plans.laws import broken_limits
from benchmarks.report.timing.plans.look import line_plans


def summary(run: Run) -> dict[str, Any] | None:
    """What was planned; None where the suite has no line."""
    task = next(iter(run.suite.of("plans")), None)
    if task is None:
        return None
    return {
        "length": number(1e3 * float(np.linalg.norm(task.move_m))),
        "move": ", ".join(number(1e3 * x) for x in task.move_m),
        "start": ", ".join(f"{x:g}".replace("-", "−") for x in task.start_deg),
        "samples": task.samples, "solvers": task.solvers, "laws": task.laws,
    }  # fmt: skip


def findings(run: Run) -> list[str]:
    """Durations of the laws with the limits that each breaks, for the first IK method."""
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
    """What a reader should know before quoting a motion's figures."""
    line = line_plans(run)
    if line is None or not line.solved:
        return []
    items = [
        "The tool's distance from the line is a proved bound for every instant, at most 5 % (or a nanometre) above the "
        "largest value found. Peak velocities, accelerations and jerks are exact, from the roots of "
        "the polynomials' derivatives.",
        "The velocity, acceleration and jerk limits are those of the robot file; the paper gives none. Dynamics, torque "
        "limits, the controller and a real arm are not included.",
    ]
    if any(p["law"] == "toppra" for p in line.solved):
        items.append(
            "TOPP-RA enforces its limits at grid points. Between them a ratio may exceed 1 by a few millionths, less on a "
            "finer grid. It has no jerk limit by design."
        )
    return items
