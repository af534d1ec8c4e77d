"""Section: how fast and how sure one call is, of our methods and of peers, beside what was asked of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import polars as pl

from benchmarks.batch import batch_rows
from benchmarks.first_use import first_use_rows
from benchmarks.report.board import Board, Control, Key, Plot
from benchmarks.report.figures import HOVER, axis, lean, line, log_axis
from benchmarks.report.numbers import number
from benchmarks.report.run import Run, SpeedRows
from benchmarks.statistics import quantiles, wilson
from benchmarks.targets import WORDS, Outcome, median_ratio, speed_outcomes

LEVELS = (0.5, 0.9, 0.99, 1.0)
CURVE = np.unique(np.concatenate([np.linspace(0.0, 0.98, 99), 1.0 - np.geomspace(0.02, 1e-4, 40), [1.0]]))
"""Shares of calls at which a distribution is drawn: evenly, and finer at the slow end."""
PRECISE = {
    "success",
    "worst_ratio",
    "worst_velocity",
    "worst_acceleration",
    "worst_jerk",
    "median_optimum",
    "worst_optimum",
}
"""Measures of which the digits near a whole number say something."""
VERDICTS = {True: ("held", "good"), False: ("not held", "bad"), None: ("not measured", "none")}


def speed(run: Run) -> dict[str, Any] | None:
    """Targets, a table for each block, distributions, failures, batches and first use."""
    suite = run.suite
    if not suite.speed and not suite.batch and suite.first_use is None:
        return None
    blocks = run.speed
    return {
        "targets": [outcome_row(o) for o in speed_outcomes(suite, run.folder)],
        "tables": [_table(b, run) for b in blocks],
        "failures": [f for b in blocks if (f := _failures(b, run))],
        "boards": [_distributions(blocks, run)] if blocks else [],
        "entries": _entries(run),
        "batches": _batches(run),
        "first": _first(run),
    }


def share(solved: int, count: int) -> tuple[str, str]:
    """Share of successes and its interval [%], with as many digits as the count deserves: only 100 % where all are."""
    digits = 1 if count < 10_000 else 3
    rounded = 100.0 * solved / count
    if solved < count:
        step = 10.0**-digits
        rounded = min(math.floor(rounded / step + 1e-9) * step, 100.0 - step)
    low, high = wilson(solved, count)
    return (
        f"{rounded:.{digits}f} %" if solved < count else "100 %",
        f"[{100 * low:.{digits}f}, {100 * high:.{digits}f}]",
    )


def outcome_row(o: Outcome) -> dict[str, Any]:
    """A target as the tables show it."""
    words, look = VERDICTS[o.held]
    if o.target.goal:
        words += ", a goal"
        look = "partly" if o.held is False else look
    precise = o.target.measure in PRECISE and not math.isnan(o.value)
    return {
        "where": o.where, "what": o.what, "value": f"{o.value:.7g}" if precise else number(o.value),
        "asked": o.asked, "unit": o.unit, "words": words, "look": look, "note": o.note, "number": o.value,
    }  # fmt: skip


def _table(b: SpeedRows, run: Run) -> dict[str, Any]:
    rows = []
    for label, about in b.entries.items():
        row = {"label": label, "colour": run.speed_colour(label), "kind": about["kind"]}
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
                    **dict(zip(("p90", "p99", "max"), quantiles(us, LEVELS[1:]), strict=True)),
                },
                "iterations": _mean(part["iterations"]),
                "restarts": _mean(part["restarts"]),
                "ratio": ratio,
                "count": len(part),
                "build": number(1e3 * about["build_seconds"]),
            }
        )
    return {
        "id": b.block.id, "title": b.block.title, "robot": b.block.robot, "set": b.block.set.replace("_", " "),
        "rounds": b.block.rounds, "count": b.facts["count"], "clock": number(b.facts["clock_ns"]), "rows": rows,
        "reference": b.block.reference, "done": b.rows["problem"].n_unique(),
    }  # fmt: skip


def _entries(run: Run) -> list[dict[str, Any]]:
    """Every method and peer once, and again where its settings differ between blocks."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for b in run.speed:
        for label, about in b.entries.items():
            version = about["version"] or ("–" if about["kind"] == "peer" else "this one")
            shown = {"label": label, "kind": about["kind"], "version": version, "settings": about["settings"]}
            found.setdefault((label, about["settings"]), shown | {"colour": run.speed_colour(label)})
    return list(found.values())


def _mean(column: pl.Series) -> str:
    values = column.drop_nulls()
    return number(float(values.to_numpy().mean())) if len(values) else "–"


def _failures(b: SpeedRows, run: Run) -> dict[str, Any] | None:
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
    heads = [(label, run.speed_colour(label)) for label in labels]
    return {"title": b.block.title, "heads": heads, "rows": rows}


def _distributions(blocks: list[SpeedRows], run: Run) -> Board:
    plot = Plot(
        "call-times", "Calls that took at most so long",
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
                    x=lean(np.quantile(us, CURVE)), y=lean(100.0 * CURVE, 6), name=label,
                    line={"color": run.speed_colour(label), "width": 2, "dash": "dot" if peer else "solid"},
                    hovertemplate=f"{label}<br>%{{y:.4~g}} % within %{{x:.3g}} µs{HOVER}",
                ),
                {"block": [b.block.id]},
            )  # fmt: skip
            legend.append(Key(label, run.speed_colour(label), "dashed" if peer else "solid", {"block": [b.block.id]}))
    controls = (Control("block", "Problems", tuple((b.block.id, b.block.title) for b in blocks)),)
    return Board(
        "call-time-board", (plot,), controls, tuple(legend),
        "All calls, failures included. Solid: ours; dotted: peers. Each call's time is the median of its rounds.",
    )  # fmt: skip


def _batches(run: Run) -> list[dict[str, Any]]:
    out = []
    for block in run.suite.batch:
        rows = batch_rows(run.folder, block)
        if rows is None:
            continue
        for (threads,), part in rows.group_by("threads", maintain_order=True):
            rates = 1e-6 * part["solved"].to_numpy() / part["seconds"].to_numpy()
            extra = part["extra_memory_mb"].cast(pl.Float64).drop_nulls()
            out.append(
                {
                    "title": block.title, "robot": block.robot, "solver": block.solver, "threads": threads,
                    "count": part["count"][0], "solved": share(int(part["solved"].to_numpy().min()), part["count"][0]),
                    "seconds": number(float(np.median(part["seconds"].to_numpy()))), "repeats": len(part),
                    "rate": number(float(np.median(rates))), "iterations": number(float(part["iterations"].to_numpy().mean())),
                    "extra": number(float(extra.to_numpy().max())) if len(extra) else "–",
                }
            )  # fmt: skip
    return out


def _first(run: Run) -> list[dict[str, Any]]:
    found = first_use_rows(run.folder) if run.suite.first_use is not None else None
    return [
        {
            "what": WORDS[measure][0],
            "median": number(float(np.median(seconds))),
            "all": ", ".join(number(s) for s in seconds),
        }
        for measure, seconds in (found or {}).items()
    ]
