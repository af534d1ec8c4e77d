"""Piece of the section on speed: batches by number of threads."""

from __future__ import annotations

from typing import Any

import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.batch import solved_rate
from benchmarks.blocks.block import mean, median_with_range
from benchmarks.report.base import KindReport, Run, Section, Winner
from benchmarks.report.tables import Cell, Column, Table, table_of
from benchmarks.statistics import percentage
from optik.registry import short_name


def _rate(part: pl.DataFrame) -> tuple[float, float, float]:
    """Return the problems solved per second [million], with the range of the repeats."""
    rates = 1e-6 * part["solved"].to_numpy() / part["seconds"].to_numpy()
    return solved_rate(part), float(rates.min()), float(rates.max())


BATCH_COLUMNS = (
    Column("label", "Method", show="text"),
    Column("batch", "Batch", show="text"),
    Column("threads", "threads", show="count"),
    Column("rate", "solved per second", "million", "more", of=_rate),
    Column("count", "problems", show="count", of=lambda part: int(part["count"][0])),
    Column("solved", "solved", "%", "more", "share",
           of=lambda part: percentage(int(part["solved"].to_numpy().min()), int(part["count"][0]))),
    Column("seconds", "median time", "s", "less", of=median_with_range("seconds")),
    Column("false_claims", "false success claims", "", "less", "count", aside=True,
           of=lambda part: int((part["claimed"] - part["solved"]).clip(lower_bound=0).to_numpy().max())),
    Column("robot", "arm", show="text", aside=True),
    Column("repeats", "repeats", show="count", aside=True, of=len),
    Column("iterations", "mean iterations", aside=True, of=mean("iterations")),
)  # fmt: skip
"""Columns of the table."""


def _batches(run: Run) -> dict[str, Any] | None:
    found = _tables(run)
    return {"tables": found} if found else None


def _tables(run: Run) -> list[Table]:
    """Return one row for each batch and number of threads."""
    groups = [group for b in run.of("batch") for group in _groups(b)]
    note = (
        "One call for all targets, in a separate process; medians and ranges over the repeats. The success rate is the lowest "
        "of the repeats, with Wilson's 95 % interval, by optik's forward kinematics inside the limits."
    )
    return [table_of("batch", "Batches", BATCH_COLUMNS, groups, note)] if groups else []


def _groups(b: BlockRows) -> list[tuple[dict[str, Cell], pl.DataFrame]]:
    given: dict[str, Cell] = {
        "label": short_name(b.block.solver), "batch": b.block.title, "robot": short_name(b.block.robot)
    }  # fmt: skip
    return [
        (given | {"threads": int(str(threads))}, part)
        for (threads,), part in b.rows.group_by("threads", maintain_order=True)
    ]


def _winners(run: Run) -> list[Winner]:
    """Return the methods that solve most problems per second, for batches of the same problems by several methods."""
    groups: dict[str, list[BlockRows]] = {}
    for b in run.of("batch"):
        groups.setdefault(repr((b.block.robot, b.block.set, sorted(b.block.options.items()))), []).append(b)
    found = []
    for blocks in groups.values():
        if len({b.block.solver for b in blocks}) < 2:
            continue
        best: dict[str, tuple[float, float, float]] = {}
        for given, part in (group for b in blocks for group in _groups(b)):
            rate, label = _rate(part), str(given["label"])
            best[label] = max(rate, best.get(label, rate))
        entries = tuple(sorted(((label, *rate) for label, rate in best.items()), key=lambda entry: -entry[1]))
        question = f"Most problems solved per second in a batch: {blocks[0].block.title}"
        note = "with each method's best number of threads; median and range of the repeats"
        found.append(Winner(question, "million/s", "more", entries, "batch", note))
    return found


REPORT = KindReport(
    (Section("Batches", "batch", _batches, order=12),),
    lambda blocks: ("inverse kinematics, call by call",),
    winners=_winners,
    tables=_tables,
)
