"""Section: motions around obstacles by our plan and by rounded polylines: proofs, contacts, durations, computing times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.motion import COUNTED, MEASURES, OURS
from benchmarks.records import slug
from benchmarks.report.base import KindReport, Run, Section
from benchmarks.report.boards import Board, Control, Sample, axis, fraction_plot
from benchmarks.report.tables import Column, Group, Table, number, table_of

HOW_PLANNED = (
    f"Every method gets the same problems: obstacles, a start and a goal in joint space, and limits. “{OURS}” searches a "
    "polyline with proved edges, then chooses path and timing together. The others round the corners of a search's polyline "
    "and time it; pyroboplan times its own. TOPP-RA and pyroboplan do not limit the jerk at every instant, and are judged "
    "without it. All motions are certified at every instant. A motion in contact or over a "
    "limit is counted and has no duration. Stops are straight joint motions that rest at each vertex of our "
    "search's polyline. Times are CPU times of one process."
)
"""Description of the methods."""
OF_OTHERS = (
    "Published for MotionBenchMaker's problems, on other machines: VAMP, Panda, joint goals, a path without timing, AMD Ryzen "
    "9 7950X: 699 of 699 problems, medians 35 µs for the search and 57 µs for the simplification, mean length 4.90 rad."
)
"""Figures that are quoted."""


MOTION_COLUMNS = (Column("label", "Method", show="text"), *MEASURES)
"""Columns of a table: what targets can name."""
UNSOLVED_COLUMNS = tuple(
    Column(key, words, show="text")
    for key, words in (("problem", "Problem"), ("method", "method"), ("status", "status"), ("reason", "reason"))
)
"""Columns of the list of problems without a proved motion."""


def _by_method(b: BlockRows) -> list[tuple[str, pl.DataFrame]]:
    found = [(label, rows.filter(COUNTED)) for label, rows in b.by_method.items()]
    return [(label, rows) for label, rows in found if not rows.is_empty()]


def tables(run: Run) -> Sequence[Table]:
    """Return two tables for each block: the methods, and our problems without a proved motion."""
    return [table for b in run.of("motion") for table in (_table(b), unsolved_of(b)) if table.rows]


def _table(b: BlockRows) -> Table:
    touched = b.rows.filter(pl.col("method") == OURS, ~COUNTED).height
    kinds = b.rows["kind"].unique(maintain_order=True).to_list()
    note = f"Problems with {b.block.robot}: {', '.join(kinds)}. Rates have Wilson's 95 % intervals." + (
        f" {touched} further problems are left out, because their start or goal is not free." if touched else ""
    )
    moved = b.rows.filter(pl.col("method") == OURS)["moved"].sum() if "moved" in b.rows.columns else 0
    note += (
        f" In {moved}, start or goal exceeds a rounded joint limit by less than its rounding error, and is moved onto it."
        if moved
        else ""
    )
    absent = [label for label in b.block.labels if label not in b.rows["method"].unique().to_list()]
    note += f" Not run: {', '.join(absent)}; see docs/obstacles.md." if absent else ""
    groups: list[Group] = [({"label": label}, rows) for label, rows in _by_method(b)]
    return table_of(f"motion-{slug(b.block.id)}", b.block.title, MOTION_COLUMNS, groups, note)


def unsolved_of(b: BlockRows) -> Table:
    """Return the list of our problems without a proved motion, with their reasons."""
    rows = b.rows.filter(pl.col("method") == OURS, ~pl.col("solved").fill_null(value=False))
    named = rows.with_columns(problem=pl.format("{} {}", "kind", "number")).select(
        "problem", "method", "status", "reason"
    )
    title = f"Problems without a proved motion: {b.block.title}"
    return Table(f"motion-unsolved-{slug(b.block.id)}", title, UNSOLVED_COLUMNS, tuple(named.to_dicts()))


def findings(run: Run) -> Sequence[str]:
    """Return the rate of proved motions and the medians of ours, for each block."""
    found = []
    for b in run.of("motion"):
        rows = b.rows.filter(COUNTED, pl.col("method") == OURS)
        if rows.is_empty():
            continue
        solved = rows.filter("solved")
        over, ms = solved["over_stops"].drop_nulls(), rows["ms"].median()
        words = (
            f"{len(solved)} of {len(rows)} motions are proved to be collision-free, in {number(ms)} ms of CPU (median)"
        )
        bent = f"; their duration is {number(over.median())} of that with stops (median, n = {len(over)})"
        found.append(f"{b.block.title}: {words}{bent if len(over) else ''}.")
    return found


def section(run: Run) -> dict[str, Any] | None:
    """Show the times and the durations of all methods, the tables, and published figures."""
    blocks = run.of("motion")
    if not blocks:
        return None
    return {"boards": [_board(blocks, run)], "tables": run.tables_of("motion"), "after": [HOW_PLANNED, OF_OTHERS]}


def _board(blocks: Sequence[BlockRows], run: Run) -> Board:
    """Plot the distributions of the CPU times, and of the durations over those with stops."""

    def samples(column: str, among: pl.Expr) -> list[Sample]:
        value = pl.when("solved").then(column).otherwise(math.inf)
        return [
            Sample(label, rows.filter(among).select(value).to_series(), run.look(label), {"block": [b.block.id]})
            for b in blocks
            for label, rows in _by_method(b)
        ]

    times = fraction_plot(
        "motion-times", "Proved within this time", axis("CPU time [ms]", type="log"), "problems",
        "%{y:.3~g} % within %{x:.3g} ms", samples("ms", pl.lit(value=True)),
    )  # fmt: skip
    ratios = fraction_plot(
        "motion-ratios", "Proved, up to this duration over stops", "duration / duration with stops", "problems",
        "%{y:.3~g} % up to %{x:.3g}", samples("over_stops", pl.col("before").is_not_null()),
    )  # fmt: skip
    return Board(
        "motion-board", (times, ratios), (Control.of_blocks(blocks),),
        "Percentages are of all problems whose ends are free; on the right, of those whose polyline has a vertex.",
    )  # fmt: skip


SECTIONS = (Section("Motions around obstacles", "motion", section, order=24),)
"""Plots and tables."""

REPORT = KindReport(
    SECTIONS,
    lambda blocks: (f"{sum(block.count for block in blocks):,} motion problems among obstacles",),
    tables=tables,
    findings=findings,
)
