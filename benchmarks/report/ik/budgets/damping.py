"""Section: which damping to choose, by the distance of the target from a singularity; all text is computed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.ik.budgets.measures import success
from benchmarks.blocks.ik.budgets.rows import BudgetRows
from benchmarks.report.base import Cell, Column, Table
from benchmarks.report.board import Board, Key, Plot
from benchmarks.report.figures import HOVER, axis, iterations, lean, line, log_axis, shades
from benchmarks.report.ik.budgets.look import budget_blocks
from benchmarks.report.numbers import number, percent
from benchmarks.report.run import Run
from benchmarks.report.words import listed

DAMPING_BLOCK = "damping"
"""Id of the block that this section is about."""


Figures = dict[tuple[str, str], dict[str, Any]]


def damping(run: Run) -> dict[str, Any] | None:
    """Success, iterations and error of each damping in each stratum, and the recommended dampings."""
    b = _block(run)
    if b is None:
        return None
    constants, strata = _constants(b), _strata(b)
    table = {(g, m): _figures(b, g, m) for g in strata for m in b.methods}
    others = [m for m in b.methods if m not in constants]
    return {
        "advice": [_advice(g, constants, others, table) for g in strata]
        + _everywhere(strata, constants, others, table),
        "boards": [_board(b, strata, constants, table)] if len(constants) > 1 else [],
        "table": _table(b, strata, table),
    }


def damping_table(run: Run) -> Table | None:
    """Each damping in each stratum."""
    b = _block(run)
    if b is None:
        return None
    strata = _strata(b)
    return _table(b, strata, {(g, m): _figures(b, g, m) for g in strata for m in b.methods})


def _block(run: Run) -> BudgetRows | None:
    """The block that varies the damping."""
    return next((b for b in budget_blocks(run) if b.block.id == DAMPING_BLOCK and _constants(b)), None)


def _constants(b: BudgetRows) -> dict[str, float]:
    """Damping of each method that has a constant one."""
    return {m.label: float(m.options["damping"]) for m in b.block.methods if "damping" in m.options}


def _strata(b: BudgetRows) -> list[str]:
    """Strata of the smallest singular value, the nearest to a singularity first."""
    found: list[str] = b.rows.group_by("group").agg(pl.col("sigma").median()).sort("sigma")["group"].to_list()
    return found


def _table(b: BudgetRows, strata: list[str], table: Figures) -> Table:
    """Share solved in each stratum; iterations and errors on request."""
    columns = [Column("label", "Damping", show="text")]
    columns += [Column(f"share {g}", f"solved, {g}", "%", "more", "share") for g in strata]
    for g in strata:
        columns += [
            Column(f"iterations {g}", f"iterations of the solved, median, {g}", show="count", aside=True),
            Column(f"median {g}", f"position error, median, {g}", "mm", "less", aside=True),
            Column(f"p95 {g}", f"position error, p95, {g}", "mm", "less", aside=True),
        ]
    rows: list[dict[str, Cell]] = []
    for m in b.methods:
        row: dict[str, Cell] = {"label": m}
        for g in strata:
            f = table[g, m]
            row |= {f"share {g}": (f["share"], f["low"], f["high"]), f"iterations {g}": f["iterations"]}
            row |= {f"median {g}": f["median_mm"], f"p95 {g}": f["p95_mm"]}
        rows.append(row)
    counts = "; ".join(f"{g}: {b.last.filter(pl.col('group') == g)['problem'].n_unique():,} targets" for g in strata)
    title = f"Damping by distance to a singularity, at most {b.budget} iterations, one attempt"
    return Table("damping", title, tuple(columns), tuple(rows), f"{counts}. Intervals are Wilson's, 95 %.")


def _figures(b: BudgetRows, group: str, method: str) -> dict[str, Any]:
    """Share solved, iterations of the solved, and the error left, of one method in one stratum at the largest budget."""
    part = b.last.filter((pl.col("group") == group) & (pl.col("method") == method))
    share, low, high = success(part, 1e-6)
    took = part.filter(pl.col("status") == "solved")["iterations"].to_numpy()
    left = 1e3 * part["position_error"].to_numpy()
    median, p95 = (float(np.quantile(left, level)) if len(left) else math.nan for level in (0.5, 0.95))
    middle = float(np.median(took)) if len(took) else math.nan
    return {
        "share": share, "low": low, "high": high, "iterations": middle, "median_mm": median, "p95_mm": p95,
    }  # fmt: skip


def _count(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:g}"


def choose(constants: dict[str, float], figures: dict[str, dict[str, Any]]) -> list[str]:
    """The dampings that no other is significantly better than, best first.

    Those whose interval of success reaches that of the surest; among them by median iterations, then by share.
    """
    best = max(figures[m]["low"] for m in constants)
    level = [m for m in constants if figures[m]["high"] >= best and not math.isnan(figures[m]["iterations"])]
    return sorted(level, key=lambda m: (figures[m]["iterations"], -figures[m]["share"]))


def _advice(group: str, constants: dict[str, float], others: list[str], table: Figures) -> dict[str, str]:
    figures = {m: table[group, m] for m in (*constants, *others)}
    level = choose(constants, figures)
    if not level:
        return {"group": group, "text": "none of these dampings solves any target here."}
    first, rest = level[0], level[1:]
    text = f"{first}: {_words(figures[first])}"
    if rest:
        text += f"; {listed(rest)} not significantly less successful, but no faster"
    worst = min(constants, key=lambda m: figures[m]["share"])
    if worst not in level:
        text += f"; lowest: {worst} with {percent(figures[worst]['share'])}"
    calm = min(constants, key=lambda m: figures[m]["p95_mm"])
    if figures[calm]["p95_mm"] < 0.1 * figures[first]["p95_mm"]:
        text += (
            f". Its failures diverge: the 95th percentile of its position error is {number(figures[first]['p95_mm'])} mm, "
            f"against {number(figures[calm]['p95_mm'])} mm with {calm}"
        )
    text += "".join(f". {m}: {_words(figures[m])}" for m in others)
    return {"group": group, "text": f"{text}."}


def _words(figures: dict[str, Any]) -> str:
    took = figures["iterations"]
    after = f" after a median of {iterations(round(took)) if took == round(took) else _count(took) + ' iterations'}"
    return f"{percent(figures['share'])} solved{'' if math.isnan(took) else after}"


def _everywhere(
    strata: list[str],
    constants: dict[str, float],
    others: list[str],
    table: Figures,
) -> list[dict[str, str]]:
    """The best single damping: that whose worst stratum is best; and whether an adaptive method is better there."""
    lowest = {m: min(table[g, m]["share"] for g in strata) for m in (*constants, *others)}
    best = max(constants, key=lambda m: (lowest[m], -sum(table[g, m]["iterations"] for g in strata)))
    text = f"{best} has the highest success rate in its worst stratum, {percent(lowest[best])}"
    for m in others:
        text += f"; {m}: {percent(lowest[m])}"
    return [{"group": "one damping for all strata", "text": f"{text}."}]


def _board(b: BudgetRows, strata: list[str], constants: dict[str, float], table: Figures) -> Board:
    ordered = sorted(constants, key=lambda m: constants[m])
    x = [constants[m] for m in ordered]
    solved = Plot("damping-success", "Solved at 1e−6 m and rad", {"yaxis": axis("targets solved [%]", range=[-2, 102])})
    took = Plot("damping-iterations", "Median iterations, solved targets", {"yaxis": log_axis("iterations", dtick=1)})
    left = Plot("damping-error", "Position error, 95th percentile", {"yaxis": log_axis("error [mm]")})
    for plot, key in ((solved, "share"), (took, "iterations"), (left, "p95_mm")):
        plot.layout["xaxis"] = log_axis("damping λ", dtick=1)
        for group, shade in zip(strata, shades(len(strata)), strict=True):
            y = [max(table[group, m][key], 1e-9) if key == "p95_mm" else table[group, m][key] for m in ordered]
            plot.add(
                line(
                    x=x, y=lean(y), mode="lines+markers", name=group, line={"color": shade, "width": 2},
                    marker={"size": 6}, hovertemplate=f"{group}<br>λ = %{{x}}: %{{y:.4~g}}{HOVER}",
                )
            )  # fmt: skip
    legend = tuple(Key(group, shade, "solid") for group, shade in zip(strata, shades(len(strata)), strict=True))
    return Board(
        "damping-board", (solved, took, left), (), legend,
        f"One attempt of at most {b.budget} iterations from starts 0.1 rad (standard deviation) away. σ is the smallest "
        "singular value of the Jacobian at the solution. Errors below 10⁻⁹ mm are shown as 10⁻⁹ mm.",
    )  # fmt: skip
