"""Section on recorded answers: success at three tolerances, the distribution of the errors, and the best methods."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.ik.answers import solved_by_all
from benchmarks.blocks.ik.judgement import JUDGED_AT, level_name
from benchmarks.records import slug
from benchmarks.report.base import KindReport, Section, Winner
from benchmarks.report.boards import Board, Control
from benchmarks.report.figures import add, axis, figure, line, log_axis
from benchmarks.report.run import Run
from benchmarks.report.tables import Column, Table
from benchmarks.report.winners import most_solved, ranked
from benchmarks.statistics import percentage
from optik.registry import short_name

if TYPE_CHECKING:
    pass

ANSWER_COLUMNS = (
    Column("label", "method", show="text"),
    Column("count", "problems", show="count"),
    *(
        Column(f"at {name}", f"success within {name} m and rad", "%", "more", "share")
        for name in map(level_name, JUDGED_AT)
    ),
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


def _answers(run: Run) -> dict[str, Any] | None:
    """Show one plot, and a table of each block."""
    found = run.of("answers")
    return {"boards": [_board(run, found)], "tables": run.tables_of("answers")} if found else None


def _tables(run: Run) -> list[Table]:
    """Return a table for each block."""
    found = []
    for b in run.of("answers"):
        rows = tuple(map(_cells, b.rows.iter_rows(named=True)))
        note = (
            f"{short_name(b.block.robot)}, {short_name(b.block.set).replace('_', ' ')}. An answer succeeds at a tolerance if "
            "both its errors, by optik's forward kinematics, are within it and every joint is inside its limits. The errors "
            "include those of failed answers. Solved: within 1e-6 m and rad. Intervals: Wilson, 95 %."
        )
        found.append(Table(f"answers-{slug(b.block.id)}", b.block.title, ANSWER_COLUMNS, rows, note))
    return found


def _cells(row: dict[str, Any]) -> dict[str, Any]:
    """Return the table cells of one method."""
    rates = {at: percentage(row[at], row["count"]) for at in (f"at {level_name(level)}" for level in JUDGED_AT)}
    millimetres = {f"position {name}": 1e3 * row[f"position {name}"] for name in ("median", "p99")}
    solved_a_second = row["at 1e-6"] / max(row["seconds"], 1e-9)
    return row | rates | millimetres | {"label": row["method"], "rate": solved_a_second}


def _winners(run: Run) -> list[Winner]:
    """Return the methods that solve the most problems of each block, of those given to all methods."""
    found = []
    for b in run.of("answers"):
        who = ranked(dict(b.rows.select("method", "count").iter_rows()))
        solved = solved_by_all(b.facts["answers"], who.labels)
        note = f"the same {len(solved[who.labels[0]]):,} problems for all{who.left_out}"
        found.append(
            most_solved(f"Highest success rate within 1e−6 m and rad: {b.block.title}", "answers", solved, note)
        )
    return found


def _board(run: Run, found: list[BlockRows]) -> Board:
    """Plot the percentage of problems whose answer is inside the limits, against the distance to the target."""
    across, up = log_axis("position error [m]", range=[-16, 1], dtick=3), axis("problems [%]", range=[0, 101])
    plot = figure("answers-errors", "Problems with at most this position error", across, up)
    for b in found:
        for label, count in b.rows.select("method", "count").iter_rows():
            part = b.facts["distribution"].filter(pl.col("method") == label)
            trace = line(
                part["upper"], 100.0 * np.cumsum(part["count"].to_numpy()) / count, digits=5, name=label,
                line={"color": run.colour(label), "shape": "hv"}, hover=f"{label}<br>within %{{x:.2g}} m: %{{y:.3f}} %",
            )  # fmt: skip
            add(plot, trace, {"block": [b.block.id]})
    return Board("answers", (plot,), (Control.of_blocks(found),))


REPORT = KindReport(
    (Section("Recorded answers", "answers", _answers, order=65),),
    lambda blocks: ("inverse kinematics",),
    winners=_winners,
    tables=_tables,
)
