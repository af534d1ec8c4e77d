"""Section: how fast and how sure one call is, of our methods and of peers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.kinds._speed import SPEED
from benchmarks.kinds.base import BlockRows, Section
from benchmarks.kinds.calls.measures import median_ratio
from benchmarks.report.board import Board, Control, Key, Plot
from benchmarks.report.figures import HOVER, axis, lean, line, log_axis
from benchmarks.report.numbers import number
from benchmarks.report.run import Run
from benchmarks.report.tables import share
from benchmarks.statistics import quantiles
from optik.registry import short_name

TAIL = (0.9, 0.99, 1.0)
"""Shares of calls whose times the table shows: p90, p99 and the longest."""

CALL_SHARES = np.unique(np.concatenate([np.linspace(0.0, 0.98, 99), 1.0 - np.geomspace(0.02, 1e-4, 40), [1.0]]))
"""Shares of calls at which a distribution is drawn: evenly, and finer at the slow end."""


def calls(run: Run) -> dict[str, Any] | None:
    """A table for each block, distributions, and failures.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    dict or None
        What the template shows; None where no block has rows.
    """
    blocks = run.of("calls")
    if not blocks:
        return None
    return {
        "tables": [_table(b, run) for b in blocks],
        "failures": [f for b in blocks if (f := _failures(b, run))],
        "boards": [_distributions(blocks, run)],
        "entries": _entries(run),
    }


def _table(b: BlockRows, run: Run) -> dict[str, Any]:
    rows = []
    for label, about in b.entries.items():
        row = {"label": label, "colour": run.colour(label), "kind": about["kind"]}
        part = b.rows.filter(pl.col("method") == label)
        if "absent" in about or part.is_empty():
            rows.append(row | {"absent": about.get("absent", "no rows yet")})
            continue
        us = part["ns"].to_numpy() / 1e3
        ratio = median_ratio(b.rows, label, b.block.reference)
        rows.append(
            row
            | {
                "absent": "",
                "solved": share(int(part["solved"].sum()), len(part)),
                "numbers": {
                    "median": float(np.median(us)),
                    "mean": float(us.mean()),
                    **dict(zip(("p90", "p99", "max"), quantiles(us, TAIL), strict=True)),
                },
                "iterations": _mean(part["iterations"]),
                "restarts": _mean(part["restarts"]),
                "ratio": ratio,
                "count": len(part),
                "build": number(1e3 * about["build_seconds"]),
            }
        )
    return {
        "id": b.block.id, "title": b.block.title, "robot": short_name(b.block.robot),
        "set": short_name(b.block.set).replace("_", " "),
        "rounds": b.block.rounds, "count": b.facts["count"], "clock": number(b.facts["clock_ns"]), "rows": rows,
        "reference": b.block.reference, "done": b.rows["problem"].n_unique(),
    }  # fmt: skip


def _entries(run: Run) -> list[dict[str, Any]]:
    """Every method and peer once, and again where its settings differ between blocks."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for b in run.of("calls"):
        for label, about in b.entries.items():
            version = about["version"] or ("–" if about["kind"] == "peer" else "this one")
            shown = {"label": label, "kind": about["kind"], "version": version, "settings": about["settings"]}
            found.setdefault((label, about["settings"]), shown | {"colour": run.colour(label)})
    return list(found.values())


def _mean(column: pl.Series) -> str:
    values = column.drop_nulls()
    return number(float(values.to_numpy().mean())) if len(values) else "–"


def _failures(b: BlockRows, run: Run) -> dict[str, Any] | None:
    """Unsolved problems by stratum; None where there is one stratum, or nothing failed."""
    groups = b.rows["group"].unique().sort().to_list()
    if len(groups) < 2 or b.rows["solved"].all():
        return None
    labels = [label for label in b.entries if label in set(b.rows["method"])]
    count = b.rows.group_by("group", "method").agg(failed=(~pl.col("solved")).sum(), all=pl.len())
    cells = {(r["group"], r["method"]): r for r in count.iter_rows(named=True)}
    rows = []
    for group in groups:
        found = [cells.get((group, label)) for label in labels]
        rows.append((group, [f"{c['failed']:,} of {c['all']:,}" if c else "–" for c in found]))
    heads = [(label, run.colour(label)) for label in labels]
    return {"title": b.block.title, "heads": heads, "rows": rows}


def _distributions(blocks: list[BlockRows], run: Run) -> Board:
    plot = Plot(
        "call-times", "Share of calls that took at most this time",
        {"xaxis": log_axis("time of a call [µs]", dtick=1), "yaxis": axis("calls [%]", range=[-2, 102])}, 420,
    )  # fmt: skip
    legend = []
    for b in blocks:
        for label, about in b.entries.items():
            us = b.rows.filter(pl.col("method") == label)["ns"].to_numpy() / 1e3
            if not len(us):
                continue
            peer = about["kind"] == "peer"
            plot.add(
                line(
                    x=lean(np.quantile(us, CALL_SHARES)), y=lean(100.0 * CALL_SHARES, 6), name=label,
                    line={"color": run.colour(label), "width": 2, "dash": "dot" if peer else "solid"},
                    hovertemplate=f"{label}<br>%{{y:.4~g}} % within %{{x:.3g}} µs{HOVER}",
                ),
                {"block": [b.block.id]},
            )  # fmt: skip
            legend.append(Key(label, run.colour(label), "dashed" if peer else "solid", {"block": [b.block.id]}))
    controls = (Control("block", "Problems", tuple((b.block.id, b.block.title) for b in blocks)),)
    return Board(
        "call-time-board", (plot,), controls, tuple(legend),
        "All calls, failures included. Solid: ours; dotted: peers. Each call's time is the median of its rounds.",
    )  # fmt: skip


SECTIONS = (
    SPEED,
    Section("Speed of one call", "speed", calls, Path(__file__).with_name("report.html.j2"), 11),
)
"""The section, after what it shares with batches and first use."""
