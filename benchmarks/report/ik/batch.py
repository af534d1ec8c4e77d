"""Piece of the section on speed: batches by number of threads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.ik.batch.measures import extra_memory, solved_rate
from benchmarks.report.base import Column, KindReport, Section, Table, Winner
from benchmarks.report.ik.speed import SPEED
from benchmarks.report.run import Run
from benchmarks.statistics import wilson
from optik.registry import short_name

if TYPE_CHECKING:
    from benchmarks.report.base import Cell

BATCH_COLUMNS = (
    Column("label", "Method", show="text"),
    Column("batch", "Batch", show="text"),
    Column("threads", "threads", show="count"),
    Column("rate", "solved per second", "million", "more"),
    Column("solved", "solved", "%", "more", "share"),
    Column("seconds", "median time", "s", "less"),
    Column("count", "problems", show="count"),
    Column("extra", "peak extra memory", "MB", "less"),
    Column("false_claims", "false success claims", "", "less", "count", aside=True),
    Column("robot", "arm", show="text", aside=True),
    Column("repeats", "repeats", show="count", aside=True),
    Column("iterations", "mean iterations", aside=True),
)
"""Columns of the table."""


def batches(run: Run) -> dict[str, Any] | None:
    """The table of all batches."""
    found = tables(run)
    return {"tables": found} if found else None


def tables(run: Run) -> Sequence[Table]:
    """One row for each batch and number of threads."""
    rows = [row for b in run.of("batch") for row in _rows(b)]
    note = (
        "One call for all targets, in a separate process; medians and ranges over the repeats. The success rate is the lowest "
        "of the repeats, with Wilson's 95 % interval, by optik's forward kinematics inside the limits. Extra memory is the "
        "peak of the process during the call, without its memory before and without the answers."
    )
    return [Table("speed-batches", "Batches", BATCH_COLUMNS, tuple(rows), note)] if rows else []


def _rows(b: BlockRows) -> list[Mapping[str, Cell]]:
    found: list[Mapping[str, Cell]] = []
    for (threads,), part in b.rows.group_by("threads", maintain_order=True):
        count, least = int(part["count"][0]), int(part["solved"].to_numpy().min())
        low, high = wilson(least, count)
        rates = 1e-6 * part["solved"].to_numpy() / part["seconds"].to_numpy()
        seconds = part["seconds"].to_numpy()
        extra = extra_memory(part)
        found.append(
            {
                "label": short_name(b.block.solver), "batch": b.block.title, "robot": short_name(b.block.robot),
                "threads": int(str(threads)), "count": count, "repeats": len(part),
                "solved": (100.0 * least / count, 100.0 * low, 100.0 * high),
                "seconds": (float(np.median(seconds)), float(seconds.min()), float(seconds.max())),
                "rate": (solved_rate(part), float(rates.min()), float(rates.max())),
                "iterations": float(part["iterations"].to_numpy().mean()),
                "extra": None if np.isnan(extra) else extra,
                "false_claims": int((part["claimed"] - part["solved"]).clip(lower_bound=0).to_numpy().max()),
            }
        )  # fmt: skip
    return found


def winners(run: Run) -> Sequence[Winner]:
    """Which method solves most a second, where batches of the same problems by several methods are in the suite."""
    groups: dict[str, list[BlockRows]] = {}
    for b in run.of("batch"):
        groups.setdefault(repr((b.block.robot, b.block.set, sorted(b.block.options.items()))), []).append(b)
    found = []
    for blocks in groups.values():
        if len({b.block.solver for b in blocks}) < 2:
            continue
        best: dict[str, tuple[float, float, float]] = {}
        for b in blocks:
            for row in _rows(b):
                label, rate = str(row["label"]), row["rate"]
                assert isinstance(rate, tuple)
                best[label] = max(rate, best.get(label, rate))
        entries = tuple(sorted(((label, *rate) for label, rate in best.items()), key=lambda entry: -entry[1]))
        note = "with each method's best number of threads; median and range of the repeats"
        found.append(
            Winner(
                f"Most problems solved per second in a batch: {blocks[0].block.title}",
                "million/s",
                "more",
                entries,
                "speed",
                note,
            )
        )
    return found


SECTIONS = (
    SPEED,
    Section("Batches", "speed", batches, Path(__file__).with_name("batch.html.j2"), 12),
)
"""A table, after what it shares with single calls and first use."""

REPORT = KindReport(
    SECTIONS,
    lambda blocks: ("inverse kinematics, call by call",),
    winners=winners,
    tables=tables,
)
