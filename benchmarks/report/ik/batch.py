"""Piece of the section on speed: batches by number of threads."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.ik.batch import extra_memory, solved_rate
from benchmarks.report.base import KindReport, Section, Winner
from benchmarks.report.ik.calls import SPEED
from benchmarks.report.run import Run
from benchmarks.report.tables import Column, Table
from benchmarks.statistics import percentage
from optik.registry import short_name

BATCH_COLUMNS = (
    Column("label", "Method", show="text"),
    Column("batch", "Batch", show="text"),
    Column("threads", "threads", show="count"),
    Column("rate", "solved per second", "million", "more"),
    Column("count", "problems", show="count"),
    Column("solved", "solved", "%", "more", "share"),
    Column("seconds", "median time", "s", "less"),
    Column("extra", "peak extra memory", "MB", "less"),
    Column("false_claims", "false success claims", "", "less", "count", aside=True),
    Column("robot", "arm", show="text", aside=True),
    Column("repeats", "repeats", show="count", aside=True),
    Column("iterations", "mean iterations", aside=True),
)
"""Columns of the table."""


def _batches(run: Run) -> dict[str, Any] | None:
    found = _tables(run)
    return {"tables": found} if found else None


def _tables(run: Run) -> list[Table]:
    """Return one row for each batch and number of threads."""
    rows = [row for b in run.of("batch") for row in _rows(b)]
    note = (
        "One call for all targets, in a separate process; medians and ranges over the repeats. The success rate is the lowest "
        "of the repeats, with Wilson's 95 % interval, by optik's forward kinematics inside the limits. Extra memory is the "
        "peak of the process during the call, without its memory before and without the answers."
    )
    return [Table("speed-batches", "Batches", BATCH_COLUMNS, tuple(rows), note)] if rows else []


def _rows(b: BlockRows) -> list[dict[str, Any]]:
    found = []
    for (threads,), part in b.rows.group_by("threads", maintain_order=True):
        count, solved, seconds = int(part["count"][0]), part["solved"].to_numpy(), part["seconds"].to_numpy()
        rates, extra = 1e-6 * solved / seconds, extra_memory(part)
        found.append(
            {
                "label": short_name(b.block.solver), "batch": b.block.title, "robot": short_name(b.block.robot),
                "threads": threads, "count": count, "repeats": len(part), "solved": percentage(int(solved.min()), count),
                "seconds": (float(np.median(seconds)), float(seconds.min()), float(seconds.max())),
                "rate": (solved_rate(part), float(rates.min()), float(rates.max())),
                "iterations": float(part["iterations"].to_numpy().mean()),
                "extra": None if np.isnan(extra) else extra,
                "false_claims": int((part["claimed"] - part["solved"]).clip(lower_bound=0).to_numpy().max()),
            }
        )  # fmt: skip
    return found


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
        for row in (row for b in blocks for row in _rows(b)):
            best[row["label"]] = max(row["rate"], best.get(row["label"], row["rate"]))
        entries = tuple(sorted(((label, *rate) for label, rate in best.items()), key=lambda entry: -entry[1]))
        question = f"Most problems solved per second in a batch: {blocks[0].block.title}"
        note = "with each method's best number of threads; median and range of the repeats"
        found.append(Winner(question, "million/s", "more", entries, "speed", note))
    return found


REPORT = KindReport(
    (SPEED, Section("Batches", "speed", _batches, order=12)),
    lambda blocks: ("inverse kinematics, call by call",),
    winners=_winners,
    tables=_tables,
)
