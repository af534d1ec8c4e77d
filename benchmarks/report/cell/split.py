"""Section: where the error of the executed tool comes from, by budget and by distance."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.records import slug
from benchmarks.report.board import Board, Control, Key, Plot
from benchmarks.report.cell.head import drives_of, noise_words
from benchmarks.report.cell.look import (
    PART_COLOURS,
    PART_WORDS,
    TOTAL_COLOUR,
    WHOLE,
    after_control,
    done,
    settings_of,
    shown_at,
    spots_blocks,
)
from benchmarks.report.cell.tables import spots_table
from benchmarks.report.figures import HOVER, axis, lean, line, log_axis
from benchmarks.report.run import Run
from benchmarks.statistics import quantiles

SPLIT_BINS = 8
"""Bins of equal count over the distance."""

MOST_REASONS = 4
"""Reasons that are named why trials were not executed: the most frequent ones."""

LEAST_MM = 1e-6
"""Parts below a nanometre are drawn here: no plant is that exact, and the axis must end somewhere [mm]."""

SPLIT_COLUMNS = {**{part: f"{part}_error" for part in PART_WORDS}, "total": "position_error"}
"""Columns of the lengths of the parts and of the whole."""


def split(run: Run) -> dict[str, Any] | None:
    """The parts of the error of every block of spots."""
    blocks = [b for b in spots_blocks(run) if not done(b).is_empty()]
    if not blocks:
        return None
    words = [
        f"{b.block.title}: {b.rows['problem'].n_unique()} spots, each shown {_times(b.block.repeats)}, executed on the drive "
        f"{drives_of(b)}. What varies from trial to trial: {noise_words(b.block.noise) or 'nothing'}. With a budget of "
        "iterations the arm moves in joint space to the method's best iterate. A whole line uses the planning pipeline from "
        "laser to execution."
        for b in blocks
    ]
    worst = max(float(np.nanmax(b.rows["split_rest"].to_numpy())) for b in blocks)
    words += [lost for b in blocks if (lost := _not_executed(b))]
    words.append(f"In every trial the four vectors add up to the total error within {worst:.1e} m.")
    return {"words": words, "boards": [_board(b) for b in blocks], "tables": [spots_table(b) for b in blocks]}


def _not_executed(b: BlockRows) -> str:
    """How many trials of each method were not executed, and why, the place left out."""
    lost = b.rows.filter(pl.col("known") & pl.col("position_error").is_null())
    if lost.is_empty():
        return ""
    why = lost.with_columns(why=pl.col("reason").str.split(" at s = ").list.first())
    counts = why.group_by("setting", "why", maintain_order=True).len().sort("len", descending=True)
    words = [f"{count} of {setting}: {reason}" for setting, reason, count in counts.head(MOST_REASONS).iter_rows()]
    trials = "1 trial was" if len(lost) == 1 else f"{len(lost)} trials were"
    return f"{b.block.title}: {trials} not executed. {'; '.join(words)}."


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _board(b: BlockRows) -> Board:
    rows, name = done(b), slug(b.block.id)
    labels = settings_of([b])
    low = {"range": [np.log10(LEAST_MM) - 0.3, 3.0]}
    budgets = Plot(
        f"split-budget-{name}", "Against the iteration budget",
        {"xaxis": axis("iteration budget", type="category"), "yaxis": log_axis("median length [mm]", **low)}, 400,
    )  # fmt: skip
    far = Plot(
        f"split-distance-{name}", "Against the distance of the spot",
        {"xaxis": axis("distance from the start [mm]"), "yaxis": log_axis("median length [mm]", **low)}, 400,
    )  # fmt: skip
    for label in labels:
        part = rows.filter(pl.col("setting") == label)
        _by_budget(budgets, part, label)
        for (after,), at in part.group_by("after", maintain_order=True):
            _by_distance(far, at, label, str(after))
    legend = [Key(words, PART_COLOURS[part]) for part, words in PART_WORDS.items()]
    legend.append(Key("total: executed − spot", TOTAL_COLOUR, "dashed"))
    controls = (Control.of("method", "Method", labels), after_control(b))
    return Board(
        f"split-{name}", (budgets, far), controls, tuple(legend),
        "Median lengths of the vectors over the executed trials. The vectors add up, their lengths do not. Lengths below a "
        "nanometre are shown as a nanometre: a move in joint space ends exactly at the answer, and if no iterate is better "
        "than the start, nothing is executed.",
    )  # fmt: skip


def _medians(rows: pl.DataFrame) -> dict[str, float]:
    return {
        part: max(1e3 * quantiles(rows[column].to_numpy(), (0.5,))[0], LEAST_MM)
        for part, column in SPLIT_COLUMNS.items()
    }


def _by_budget(plot: Plot, rows: pl.DataFrame, label: str) -> None:
    at = [(str(after), _medians(part)) for (after,), part in rows.group_by("after", maintain_order=True)]
    x = ["the whole line" if after == WHOLE else after for after, _ in at]
    for part in SPLIT_COLUMNS:
        plot.add(_line(part, x, [found[part] for _, found in at]), {"method": [label]})


def _by_distance(plot: Plot, rows: pl.DataFrame, label: str, after: str) -> None:
    order = np.argsort(rows["distance"].to_numpy(), kind="stable")
    parts = [rows[i.tolist()] for i in np.array_split(order, SPLIT_BINS) if len(i)]
    x = lean(1e3 * np.array([float(np.median(p["distance"].to_numpy())) for p in parts]))
    medians = [_medians(p) for p in parts]
    for part in SPLIT_COLUMNS:
        plot.add(_line(part, x, [found[part] for found in medians]), shown_at(label, after))


def _line(part: str, x: list[Any], y: list[float]) -> dict[str, Any]:
    total = part == "total"
    return line(
        x=x, y=lean(y), mode="lines+markers", marker={"size": 6},
        line={"color": TOTAL_COLOUR if total else PART_COLOURS[part], "width": 2, "dash": "dot" if total else "solid"},
        hovertemplate=f"{'all' if total else PART_WORDS[part]}<br>%{{y:.3g}} mm{HOVER}",
    )  # fmt: skip
