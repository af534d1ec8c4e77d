"""Section on recorded answers: success at three tolerances, the distribution of the errors, and the best methods."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.columns import largest, mean
from benchmarks.blocks.ik.answers import solved_a_second, solved_by_all, success_within
from benchmarks.blocks.ik.judgement import JUDGED_AT, level_name
from benchmarks.records import slug
from benchmarks.report.base import KindReport, Run, Section, Winner
from benchmarks.report.boards import Board, Control
from benchmarks.report.figures import add, axis, figure, line, log_axis
from benchmarks.report.tables import Column, Table, table_of
from benchmarks.report.winners import most_solved, ranked
from optik.registry import short_name

ANSWER_COLUMNS = (
    Column("label", "method", show="text"),
    Column("count", "problems", show="count", of=lambda row: int(row["count"][0])),
    *(
        Column(f"at {name}", f"success within {name} m and rad", "%", "more", "share", of=success_within(level))
        for level, name in zip(JUDGED_AT, map(level_name, JUDGED_AT), strict=True)
    ),
    *(
        Column(f"{kind} {name}", f"{name} {kind} error", unit, "less", of=largest(f"{kind} {name}", scale))
        for kind, unit, scale in (("position", "mm", 1e3), ("rotation", "rad", 1.0))
        for name in ("median", "p99")
    ),
    Column("iterations", "mean iterations", aside=True, of=mean("iterations")),
    Column("restarts", "mean restarts", aside=True, of=mean("restarts")),
    Column("rate", "solved per second and core", "1/s", "more", of=solved_a_second),
    Column("crashed", "crashed", show="count", aside=True, of=lambda row: int(row["crashed"][0])),
)
"""Columns of the table of a block, each of the sums over the answers of a method."""


def _answers(run: Run) -> dict[str, Any] | None:
    """Show one plot, and a table of each block."""
    found = run.of("answers")
    return {"boards": [_board(run, found)], "tables": run.tables_of("answers")} if found else None


def _tables(run: Run) -> list[Table]:
    """Return a table for each block."""
    found = []
    for b in run.of("answers"):
        groups = [({"label": str(label)}, row) for (label,), row in b.rows.group_by("method", maintain_order=True)]
        note = (
            f"{short_name(b.block.robot)}, {short_name(b.block.set).replace('_', ' ')}. An answer succeeds at a tolerance if "
            "both its errors, by optik's forward kinematics, are within it and every joint is inside its limits. The errors "
            "include those of failed answers. Solved: within 1e-6 m and rad. Intervals: Wilson, 95 %."
        )
        found.append(table_of(f"answers-{slug(b.block.id)}", b.block.title, ANSWER_COLUMNS, groups, note))
    return found


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
