"""Section: time laws and peers on many lines, against the shortest motion known: plots first, tables after."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.timing.laws.rows import LawRows
from benchmarks.blocks.timing.laws.settings import LimitSet
from benchmarks.report.numbers import number, percent
from benchmarks.report.run import Run
from benchmarks.report.timing.laws.example import example_boards
from benchmarks.report.timing.laws.plots import against_singularity, durations, torques
from benchmarks.report.timing.laws.tables import compared, law_tables, plan_times, violations
from benchmarks.report.words import listed, quoted
from optik.registry import short_name
from planners.limits import FIELD_LIMITS


def timing(run: Run) -> dict[str, Any]:
    """For every block: plots, a table for each kind of line, limit violations, whole plans, and one line in detail."""
    return {"blocks": [_block(b, run) for b in run.of("laws")]}


def findings(run: Run) -> list[str]:
    """Durations and times of every law of ours, and of the peers that were installed, on all lines."""
    return [words for b in run.of("laws") if (words := _medians(b))]


def _medians(b: LawRows) -> str:
    words, lines = [], b.rows["line"].n_unique()
    for label in b.entries:
        rows = b.rows.filter((pl.col("law") == label) & pl.col("solved"))
        if rows.is_empty():
            continue
        kept = int(rows["keeps_all"].sum())
        keeps = "within every limit"
        if kept < len(rows):
            keeps += f" on {percent(100.0 * kept / len(rows))}"
        ratio_, ms = (float(np.median(rows[column].to_numpy())) for column in ("over_optimum", "ms_law"))
        over = int(rows["over_torque"].sum())
        if over:
            keeps += f", exceeds a torque limit on {percent(100.0 * over / len(rows))}"
        off = len(rows) - int(rows["follows"].sum())
        if off:
            keeps += f", leaves the path on {off:,} of {len(rows):,}"
        asked = b.rows.filter(pl.col("law") == label)["line"].n_unique()
        given = f" on {asked:,} motions" if asked < lines else ""
        words.append(f"{label} {number(ratio_, 4)} T*{given} ({keeps}, {number(ms)} ms)")
    if not words:
        return ""
    return (
        f"{b.block.title}, medians of {lines:,} motion{'s' if lines != 1 else ''}, unchanged: " + "; ".join(words) + "."
    )


def _block(b: LawRows, run: Run) -> dict[str, Any]:
    block, tables = b.block, law_tables(b)
    alone = len(block.kinds)
    return {
        "id": block.id, "title": block.title, "samples": block.samples, "rounds": block.rounds,
        "solver": short_name(block.solver),
        "limits": [limit_words(part) for part in block.limits], "reference": _reference(b),
        "done": b.rows["line"].n_unique(), "count": sum(part.count for part in block.lines),
        "sets": [(part.arm, part.kind.replace("_", "-"), part.count) for part in block.lines],
        "boards": [board for board in (durations(b, run), torques(b, run), against_singularity(b, run)) if board is not None],
        "tables": tables[:alone], "more": tables[alone:],
        "others": [table for table in (violations(b), plan_times(b), compared(b)) if table is not None],
        "example": example_boards(b, run),
    }  # fmt: skip


def limit_words(part: LimitSet) -> str:
    """What a set of limits is, in words."""
    own = listed([name.replace("_", " ") for name in part.own])
    words = [f"{own} of the robot"] if own else []
    for kind in FIELD_LIMITS:
        value = part.limits.value(kind.name)
        if value is not None:
            each = ", ".join(f"{x:g}" for x in np.atleast_1d(value).ravel())
            words.append(f"{kind.name.replace('_', ' ')} {each} {kind.units[0]}")
    return f"{quoted(part.label)} ({'; '.join(words)})"


def _reference(b: LawRows) -> str:
    entry = b.block.reference
    if entry is None:
        return ""
    return f"{entry.name} ({entry.words})" if entry.words else str(entry.name)
