"""Section on recorded answers: success at three tolerances, and the distribution of the errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.report.base import KindReport, Section
from benchmarks.report.board import Board, Control, Key, Plot
from benchmarks.report.figures import HOVER, axis, lean, line, log_axis
from benchmarks.report.ik.answers_tables import tables, winners
from benchmarks.report.numbers import number
from benchmarks.report.run import Run
from benchmarks.report.tables import share
from optik.registry import short_name


def answers(run: Run) -> dict[str, Any] | None:
    """A table for each block, and one plot."""
    found = run.of("answers")
    if not found:
        return None
    return {
        "tables": [_table(run, b) for b in found],
        "board": _board(run, found),
    }


def _table(run: Run, b: BlockRows) -> dict[str, Any]:
    rows = []
    for row in b.rows.iter_rows(named=True):
        count = row["count"]
        rows.append(
            {
                "label": row["method"], "colour": run.colour(row["method"]), "count": f"{count:,}",
                "success": [share(row[f"at {name}"], count) for name in ("1e-3", "1e-6", "1e-9")],
                "position": [number(1e3 * row[f"position {name}"]) for name in ("median", "p99")],
                "rotation": [number(row[f"rotation {name}"]) for name in ("median", "p99")],
                "iterations": number(row["iterations"]), "restarts": number(row["restarts"]),
                "rate": number(row["at 1e-6"] / max(row["seconds"], 1e-9)), "crashed": f"{row['crashed']:,}",
            }
        )  # fmt: skip
    block = b.block
    return {"title": block.title, "robot": short_name(block.robot), "set": short_name(block.set), "rows": rows}


def _board(run: Run, found: list[BlockRows]) -> Board:
    """Share of the problems whose answer is inside the limits and nearer than a distance."""
    layout = {
        "xaxis": log_axis("position error [m]", range=[-16, 1], dtick=3),
        "yaxis": axis("problems [%]", range=[0, 101]),
    }
    plot = Plot("answers-errors", "Problems with at most this position error", layout)
    for b in found:
        spread = b.facts["distribution"]
        for row in b.rows.iter_rows(named=True):
            label = row["method"]
            part = spread.filter(pl.col("method") == label)
            shares = 100.0 * np.cumsum(part["count"].to_numpy()) / row["count"]
            trace = line(
                x=lean(part["upper"].to_list()), y=lean(shares.tolist(), 5), name=label,
                line={"color": run.colour(label), "shape": "hv"},
                hovertemplate=f"{label}<br>within %{{x:.2g}} m: %{{y:.3f}} %{HOVER}",
            )  # fmt: skip
            plot.add(trace, {"block": [b.block.id]})
    labels = dict.fromkeys(label for b in found for label in b.rows["method"])
    legend = tuple(
        Key(label, run.colour(label), when={"block": [b.block.id for b in found if label in set(b.rows["method"])]})
        for label in labels
    )  # fmt: skip
    blocks = Control("block", "Problems", tuple((b.block.id, b.block.title) for b in found))
    return Board("answers", (plot,), (blocks,), legend)


SECTIONS = (
    Section("Recorded answers", "answers", answers, Path(__file__).with_name("answers.html.j2"), 65),
)  # fmt: skip
"""After the iteration budgets, before the line."""

REPORT = KindReport(
    SECTIONS,
    lambda blocks: ("inverse kinematics",),
    winners=winners,
    tables=tables,
)
