"""What is taken out of a report of recorded answers: a table for each block, and who solves most."""

from __future__ import annotations

from typing import Any

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.ik.answers.measures import TOLERANCE_LABELS, solved_by_all
from benchmarks.records import slug
from benchmarks.report.base import Column, Table, Winner
from benchmarks.report.ranked import ranked
from benchmarks.report.run import Run
from benchmarks.statistics import mcnemar, not_told_apart, wilson

ANSWER_COLUMNS = (
    Column("label", "method", show="text"),
    Column("count", "problems", show="count"),
    *(Column(f"at {name}", f"success within {name} m and rad", "%", "more", "share") for name in TOLERANCE_LABELS),
    Column("position median", "median position error", "mm", "less"),
    Column("position p99", "p99 position error", "mm", "less"),
    Column("rotation median", "median rotation error", "rad", "less"),
    Column("rotation p99", "p99 rotation error", "rad", "less"),
    Column("iterations", "mean iterations", aside=True),
    Column("restarts", "mean restarts", aside=True),
    Column("rate", "solved per second and core", "1/s", "more"),
    Column("crashed", "crashed", show="count", aside=True),
)
"""Columns of the table of a block."""


def tables(run: Run) -> list[Table]:
    """A table for each block."""
    note = "Every answer is judged by optik's forward kinematics, inside the joint limits. Intervals: Wilson, 95 %."
    found = []
    for b in run.of("answers"):
        rows = tuple(map(_cells, b.rows.iter_rows(named=True)))
        found.append(Table(f"answers-{slug(b.block.id)}", b.block.title, ANSWER_COLUMNS, rows, note))
    return found


def winners(run: Run) -> list[Winner]:
    """Who solves the most problems of each block."""
    return [_winner(b) for b in run.of("answers")]


def _winner(b: BlockRows) -> Winner:
    """Methods on the problems that all of them were given."""
    who = ranked({str(label): int(count) for label, count in b.rows.select("method", "count").iter_rows()})
    solved = solved_by_all(b.facts["answers"], who.labels)
    count = len(next(iter(solved.values())))
    entries = [(label, *_of(int(x.sum()), count)) for label, x in solved.items()]
    entries.sort(key=lambda entry: -entry[1])
    best = entries[0][0]
    level = not_told_apart(best, {label: mcnemar(solved[best], x).p for label, x in solved.items() if label != best})
    note = f"the same {count:,} problems for all{who.left_out}"
    question = f"Highest success rate within 1e−6 m and rad: {b.block.title}"
    return Winner(
        question,
        "%",
        "more",
        tuple(entries),
        "answers",
        note,
        "Wilson 95 % intervals; differences by McNemar's test",
        level,
        count,
    )


def _of(solved: int, count: int) -> tuple[float, float, float]:
    """A share and its interval [%]; NaN where there are no problems."""
    low, high = wilson(solved, count)
    return (100.0 * solved / count if count else float("nan")), 100.0 * low, 100.0 * high


def _share(row: dict[str, Any], key: str) -> tuple[float, float, float]:
    """A share of the problems and its interval [%]."""
    return _of(row[key], row["count"])


def _cells(row: dict[str, Any]) -> dict[str, Any]:
    """Values of one method."""
    shares = {f"at {name}": _share(row, f"at {name}") for name in TOLERANCE_LABELS}
    millimetres = {f"position {name}": 1e3 * row[f"position {name}"] for name in ("median", "p99")}
    rate = row["at 1e-6"] / max(row["seconds"], 1e-9)
    return row | shares | millimetres | {"label": row["method"], "rate": rate}
