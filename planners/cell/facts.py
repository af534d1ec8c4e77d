"""Facts of an execution and of a task of the cell as rows of a viewer's table."""

from __future__ import annotations

import numpy as np

from optik.registry import load_method
from planners.cell.drives import drives
from planners.cell.drives.base import Execution
from planners.cell.outcome import Outcome
from planners.motion.show import payload_facts


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
