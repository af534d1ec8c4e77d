"""What is taken out of a report of recorded answers: a table for each block, and who solves most."""

from __future__ import annotations

from typing import Any

from benchmarks.kinds._shown import Column, Table, Winner
from benchmarks.kinds.answers.measures import TOLERANCE_LABELS
from benchmarks.kinds.base import BlockRows
from benchmarks.records import slug
from benchmarks.report.run import Run
from benchmarks.statistics import wilson

ANSWER_COLUMNS = (
    Column("label", "method", show="text"),
    Column("count", "problems", show="count"),
    *(Column(f"at {name}", f"success within {name} m and rad", "%", "more", "share") for name in TOLERANCE_LABELS),
    Column("position median", "position error, median", "mm", "less"),
    Column("position p99", "position error, p99", "mm", "less"),
    Column("rotation median", "rotation error, median", "rad", "less"),
    Column("rotation p99", "rotation error, p99", "rad", "less"),
    Column("iterations", "mean iterations", aside=True),
    Column("restarts", "mean restarts", aside=True),
    Column("rate", "solved a second and core", "1/s", "more"),
    Column("crashed", "crashed", show="count", aside=True),
)
"""Columns of the table of a block."""


def tables(run: Run) -> list[Table]:
    """A table for each block.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    list of Table
        In the order of the suite.
    """
    note = "Every answer judged by our own forward kinematics, inside the joint limits; intervals: Wilson, 95 %."
    found = []
    for b in run.of("answers"):
        rows = tuple(map(_cells, b.rows.iter_rows(named=True)))
        found.append(Table(f"answers-{slug(b.block.id)}", b.block.title, ANSWER_COLUMNS, rows, note))
    return found


def winners(run: Run) -> list[Winner]:
    """Who solves the most problems of each block.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    list of Winner
        One for each block.
    """
    return [_winner(b) for b in run.of("answers")]


def _winner(b: BlockRows) -> Winner:
    entries = [(str(row["method"]), *_share(row, "at 1e-6")) for row in b.rows.iter_rows(named=True)]
    best_first = tuple(sorted(entries, key=lambda entry: -entry[1]))
    count = f"{int(b.rows['count'].max()):,} problems; Wilson, 95 %"  # type: ignore[arg-type]
    return Winner(f"Solves the most, {b.block.title}, within 1e−6 m and rad", "%", "more", best_first, "answers", count)


def _share(row: dict[str, Any], key: str) -> tuple[float, float, float]:
    """A share of the problems and its interval [%]."""
    low, high = wilson(row[key], row["count"])
    return 100.0 * row[key] / row["count"], 100.0 * low, 100.0 * high


def _cells(row: dict[str, Any]) -> dict[str, Any]:
    """Values of one method."""
    shares = {f"at {name}": _share(row, f"at {name}") for name in TOLERANCE_LABELS}
    millimetres = {f"position {name}": 1e3 * row[f"position {name}"] for name in ("median", "p99")}
    rate = row["at 1e-6"] / max(row["seconds"], 1e-9)
    return row | shares | millimetres | {"label": row["method"], "rate": rate}
