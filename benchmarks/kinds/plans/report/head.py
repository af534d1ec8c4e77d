"""The line at the head of the report: what was planned, key findings, limitations."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.kinds.plans.report.laws import broken_limits
from benchmarks.kinds.plans.report.look import line_plans
from benchmarks.report.numbers import number
from benchmarks.report.run import Run


def summary(run: Run) -> dict[str, Any] | None:
    """What was planned; None where the suite has no line."""
    task = next(iter(run.suite.of("plans")), None)
    if task is None:
        return None
    return {
        "length": number(1e3 * float(np.linalg.norm(task.move_m))),
        "move": ", ".join(number(1e3 * x) for x in task.move_m),
        "start": ", ".join(f"{x:g}".replace("-", "−") for x in task.start_deg),
        "samples": task.samples, "ik": task.ik, "laws": task.laws,
    }  # fmt: skip


def findings(run: Run) -> list[str]:
    """Durations of the laws with the limits that each breaks, for the first IK method."""
    line = line_plans(run)
    if line is None or not line.solved:
        return []
    ik = line.solved[0]["ik"]
    words = []
    for p in line.solved:
        if p["ik"] == ik:
            breaks = broken_limits(p["certificate"])
            kept = f"breaks limits: {', '.join(breaks)}" if breaks else "keeps every limit"
            words.append(f"{p['law']} {p['duration']:.3f} s ({kept})")
    return [f"The line of {number(1e3 * line.solved[0]['length'])} mm by {ik}: " + "; ".join(words) + "."]


def limitations(run: Run) -> list[str]:
    """What a reader should know before quoting a motion's figures."""
    line = line_plans(run)
    if line is None or not line.solved:
        return []
    items = [
        "The tool's distance from the line is a bound that holds at every instant, at most 5 % (or a nanometre) above the "
        "largest value found. Worst velocities, accelerations and jerks are exact, from the roots of "
        "the polynomials' derivatives.",
        "The joints' velocity, acceleration and jerk limits are the robot file's; the paper gives none. No dynamics, no "
        "torque limits, no controller, no measured arm.",
    ]
    if any(p["law"] == "toppra" for p in line.solved):
        items.append(
            "TOPP-RA sets its limits at the points of its grid: between them a ratio may be a few millionths above 1, less on "
            "a finer grid. It has no jerk limit by design."
        )
    return items
