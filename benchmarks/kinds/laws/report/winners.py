"""Which law wins: the shortest motions once every motion keeps all limits, and the shortest time to compute them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import polars as pl

from benchmarks.kinds.base import Winner
from benchmarks.kinds.laws.measures import in_group
from benchmarks.kinds.laws.report.tables import or_infinite
from benchmarks.kinds.laws.rows import LawRows
from benchmarks.report.run import Run
from benchmarks.statistics import median_interval

FEWEST_SHARED = 5
"""Motions that all ranked laws were asked for, from which they are ranked: of fewer a median says nothing."""


def winners(run: Run) -> Sequence[Winner]:
    """Two questions for each kind of line of each block.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    sequence of Winner
        In the order of the suite.
    """
    return [winner for b in run.of("laws") for kind in b.block.kinds for winner in kind_winners(b, kind)]


def kind_winners(b: LawRows, kind: str) -> list[Winner]:
    """Which law has the shortest motions on a kind of line, and which of these laws is computed fastest.

    Ranked are laws whose jerk is bounded, so that any motion can be slowed until it keeps the limits, and which stay on the
    path. All are compared on the lines that all of them were asked for.

    Parameters
    ----------
    b : LawRows
        The block.
    kind : str
        The kind of line.

    Returns
    -------
    list of Winner
        Empty where fewer than two laws can be ranked.
    """
    rows = in_group(b.rows, kind).filter(pl.col("law").is_in(list(b.entries)))
    unbounded = [
        label
        for label in b.entries
        if np.isinf(rows.filter(pl.col("law") == label)["least_duration"].drop_nulls().to_numpy()).any()
    ]
    asked = set(rows["law"])
    on_path = set(rows.filter(pl.col("solved") & pl.col("follows"))["law"])
    off = [label for label in b.entries if label in asked - on_path]
    ranked = [label for label in b.entries if label in on_path and label not in unbounded]
    rows = rows.filter(pl.col("law").is_in(ranked))
    rows = rows.filter(pl.len().over("line", "limits") == len(ranked))
    parts = {label: rows.filter(pl.col("law") == label) for label in ranked}
    if len(ranked) < 2 or len(parts[ranked[0]]) < FEWEST_SHARED:
        return []
    words, count = kind.replace("_", "-"), len(parts[ranked[0]])
    note = f"median of {count:,} motions that all were asked for, bootstrap intervals"
    for why, labels in (("jerk unbounded", unbounded), ("no motion on its path", off)):
        note += f"; {why}, not ranked: {', '.join(labels)}" if labels else ""
    lengths = [(label, *median_interval(or_infinite(part["kept_over_optimum"]))) for label, part in parts.items()]
    times = [(label, *median_interval(part["ms_law"].to_numpy())) for label, part in parts.items()]
    return [
        Winner(
            f"Shortest motions, all slowed to the limits: {b.block.title}, {words}", "× T*", "less",
            tuple(sorted(lengths, key=lambda entry: entry[1])), "timing", note,
        ),
        Winner(
            f"Computed fastest: {b.block.title}, {words}", "ms", "less",
            tuple(sorted(times, key=lambda entry: entry[1])), "timing", note,
        ),
    ]  # fmt: skip
