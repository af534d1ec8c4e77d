"""Who is fastest along the line within every limit, and the tables that leave the report."""

from __future__ import annotations

from benchmarks.report.base import Table, Winner
from benchmarks.report.numbers import number
from benchmarks.report.run import Run
from benchmarks.report.timing.plans.laws import broken_limits, law_table
from benchmarks.report.timing.plans.look import line_plans
from benchmarks.report.words import listed


def winners(run: Run) -> list[Winner]:
    """The law with the shortest motion, out of those that keep every limit."""
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
    """The time laws side by side."""
    found = line_plans(run)
    return [] if found is None else [law_table(found)]
