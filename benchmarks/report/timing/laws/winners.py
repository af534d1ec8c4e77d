"""Which law wins: the shortest motions once every motion keeps all limits, and the shortest time to compute them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import polars as pl

from benchmarks.blocks.timing.laws.rows import LawRows, in_group
from benchmarks.report.base import Winner
from benchmarks.report.ranked import ranked
from benchmarks.report.run import Run
from benchmarks.report.timing.laws.tables import or_infinite
from benchmarks.report.words import listed
from benchmarks.statistics import median_interval, not_longer
from optik.types import Array

DECIDED_BY = (
    "bootstrap 95 % intervals; differences by Wilcoxon's signed-rank test, for which fewer than six motions are too few"
)
"""How laws are ranked, in words."""

FEWEST_SHARED = 5
"""Motions that all ranked laws were asked for, from which they are ranked: of fewer a median says nothing."""


def winners(run: Run) -> Sequence[Winner]:
    """Two questions for each kind of line of each block."""
    return [winner for b in run.of("laws") for kind in b.block.kinds for winner in kind_winners(b, kind)]


def kind_winners(b: LawRows, kind: str) -> list[Winner]:
    """Which law has the shortest motions on a kind of line, and which of these laws is computed fastest.

    Ranked are laws whose jerk is bounded, so that any motion can be slowed until it keeps the limits, and which stay on the
    path. All are compared on the motions that all of them were asked for.
    """
    rows = in_group(b.rows, kind).filter(pl.col("law").is_in(list(b.entries)))
    able, unable = _rankable(b, rows)
    who = ranked({label: rows.filter(pl.col("law") == label).height for label in able})
    rows = rows.filter(pl.col("law").is_in(who.labels))
    rows = rows.filter(pl.len().over("line", "limits") == len(who.labels)).sort("line", "limits")
    count = len(rows) // max(len(who.labels), 1)
    if len(who.labels) < 2 or count < FEWEST_SHARED:
        return []
    parts = {label: rows.filter(pl.col("law") == label) for label in who.labels}
    note = f"medians of the same {count:,} motions for all"
    where, note = f"{b.block.title}, {kind.replace('_', '-')}", note + unable + who.left_out
    lengths = {label: or_infinite(part["kept_over_optimum"]) for label, part in parts.items()}
    times = {label: or_infinite(part["ms_law"]) for label, part in parts.items()}
    return [
        _winner(f"Shortest motions, all stretched to meet the limits: {where}", "× T*", lengths, note),
        _winner(f"Shortest computing time: {where}", "ms", times, note),
    ]


def _rankable(b: LawRows, rows: pl.DataFrame) -> tuple[list[str], str]:
    """Labels of the laws that can be ranked, and why the others cannot, in words that go on."""
    unbounded = [
        label
        for label in b.entries
        if np.isinf(rows.filter(pl.col("law") == label)["least_duration"].drop_nulls().to_numpy()).any()
    ]
    asked = set(rows["law"])
    on_path = set(rows.filter(pl.col("solved") & pl.col("follows"))["law"])
    off = [label for label in b.entries if label in asked - on_path]
    reasons = (("jerk unbounded", unbounded), ("no motion on its path", off))
    unable = "".join(f"; {why}, not ranked: {listed(labels)}" for why, labels in reasons if labels)
    return [label for label in b.entries if label in on_path and label not in unbounded], unable


def _winner(question: str, unit: str, values: Mapping[str, Array], note: str) -> Winner:
    """The least median of paired values, and those that Wilcoxon's test does not show to be longer."""
    entries = sorted(((label, *median_interval(x)) for label, x in values.items()), key=lambda entry: entry[1])
    level, count = not_longer(entries[0][0], values), len(values[entries[0][0]])
    return Winner(question, unit, "less", tuple(entries), "timing", note, DECIDED_BY, level, count)
