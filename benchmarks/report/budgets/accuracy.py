"""Sections on the error of each axis against distance, and on the damping near a singularity."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import polars as pl

from benchmarks.blocks.block import quantile, share
from benchmarks.blocks.budgets import SUCCESS_LEVELS, BudgetRows, succeeded, success
from benchmarks.report import boards
from benchmarks.report.base import Run
from benchmarks.report.boards import Board, Control, add, entry, figure, iterations, line, log_axis, shades
from benchmarks.report.budgets.default import comparisons
from benchmarks.report.tables import Column, Table, listed, number, percent, table_of
from benchmarks.statistics import binned, quantiles

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ERROR_AXES = {"error_x": "X", "error_y": "Y", "error_z": "Z"}
"""Columns of the errors, and the axes of the base frame that they belong to."""

FLOOR_MM = 1e-9
"""Errors up to this, 10⁻¹² m, are rounding: they are drawn here, as no smaller ones are results."""

MOST_LINES = 5
"""Budgets that one plot shows: more lines cannot be told apart."""

DECADES = (-9.4, 3.4)
"""Range of all error axes, as powers of ten: the same for every axis, method and set of problems."""

DRAWN_QUANTILES = {"median": (0.5, "solid"), "95th percentile": (0.95, "dot")}
"""Quantiles of the errors that are drawn, with their dashes."""

DAMPING_BLOCK = "damping"
"""Id of the block that the section on damping is about."""


def chosen(budgets: tuple[int, ...], count: int = MOST_LINES) -> list[int]:
    """Return a limited number of budgets, spread evenly through the list, with the first and the last."""
    if len(budgets) <= count:
        return list(budgets)
    return [budgets[round(i * (len(budgets) - 1) / (count - 1))] for i in range(count)]


# ---------------------------------------------------------------- error against distance


def accuracy(run: Run) -> dict[str, Any] | None:
    """Show error against distance by budget."""
    blocks = [b for b in comparisons(run) if not b.known.is_empty()]
    if not blocks:
        return None
    counts = []
    for b in blocks:
        total, known = b.problems()
        others = f", {total - known:,} more without one are omitted here" if total > known else ""
        counts.append(f"{b.block.title}: {known:,} targets{others}")
    lead = (
        "Absolute error on each axis of the base frame, target minus tool, at the last iterate within the budget; the signed "
        f"errors are in the run's files. Targets with a known solution: {'; '.join(counts)}."
    )
    return {"lead": lead, "boards": [_distance_board(blocks)]}


def _distance_board(blocks: list[BudgetRows]) -> Board:
    plots = []
    for column, name in ERROR_AXES.items():
        vertical = log_axis(f"|error in {name}| [mm]", range=DECADES)
        plot = figure(f"distance-{column}", f"{name} axis", "distance from the start [mm]", vertical)
        for b in blocks:
            _add_distance_lines(plot, b, column)
        for words, (_, dash) in DRAWN_QUANTILES.items():
            add(plot, entry(words, boards.INK_COLOUR, dash))
        plots.append(plot)
    methods = dict.fromkeys(m for b in blocks for m in b.budgeted)
    return Board(
        "by-distance", tuple(plots), (Control.of_blocks(blocks), Control.of("method", "Method", list(methods))),
        "Bins of 50 mm with at least 10 targets. All targets with a known solution are counted, also those where the method "
        "fails: they make the 95th percentile. Errors up to 10⁻⁹ mm (10⁻¹² m) are rounding: all are drawn there, as ≤ 10⁻⁹.",
    )  # fmt: skip


def _add_distance_lines(plot: Figure, b: BudgetRows, column: str) -> None:
    """Draw the median with markers, and the 95th percentile dotted, for each method and budget."""
    budgets = chosen(b.block.budgets)
    error = (pl.col(column).abs() * 1e3).clip(FLOOR_MM).alias("mm")
    rows = b.known.with_columns(error, far=pl.col("distance") * 1e3)
    for label in b.budgeted:
        for budget, shade in zip(budgets, shades(len(budgets)), strict=True):
            part = rows.filter((pl.col("method") == label) & (pl.col("budget") == budget))
            table = binned(part, "far", "mm", width=50.0)
            for words, (level, dash) in DRAWN_QUANTILES.items():
                strong: boards.Json = {"name": iterations(budget), "mode": "lines+markers"} if dash == "solid" else {}
                add(plot, line(
                    table["middle"], table[f"q{level}"], marker={"size": 4}, customdata=table["count"].to_numpy(),
                    line={"color": shade, "dash": dash, "width": 2 if strong else 1.3}, **strong,
                    hover=f"{iterations(budget)}, {words}<br>%{{x:.0f}} mm away: %{{y:.3g}} mm (%{{customdata}} targets)",
                ), {"block": [b.block.id], "method": [label]})  # fmt: skip


# ---------------------------------------------------------------- damping

Figures = dict[tuple[str, str], dict[str, float]]
"""Success, iterations and errors by stratum and method."""


def damping(run: Run) -> dict[str, Any] | None:
    """Show success, iterations and error of each damping in each stratum, and the recommended dampings."""
    b = _damping_block(run)
    if b is None:
        return None
    constants, strata, table = _constants(b), _strata(b), _figures(b)
    others = [m for m in b.methods if m not in constants]
    return {
        "lead": "The best damping depends on how near the target is to a singular configuration. For each stratum of the "
        "smallest singular value σ of the Jacobian at the solution, the list names the damping with the fewest iterations "
        "among those whose success rate is not significantly below the highest (overlapping 95 % intervals).",
        "points": [
            *((g, _advice(constants, others, {m: table[g, m] for m in b.methods})) for g in strata),
            ("one damping for all strata", _best_everywhere(strata, constants, others, table)),
        ],
        "boards": [_damping_board(b, strata, constants, table)] if len(constants) > 1 else [],
        "tables": [_damping_table(b, strata)],
    }


def damping_table(run: Run) -> Table | None:
    """Return each damping in each stratum."""
    b = _damping_block(run)
    return None if b is None else _damping_table(b, _strata(b))


def _damping_block(run: Run) -> BudgetRows | None:
    """Return the block that varies the damping."""
    return next((b for b in run.of("budgets") if b.block.id == DAMPING_BLOCK and _constants(b)), None)


def _constants(b: BudgetRows) -> dict[str, float]:
    """Return the damping of each method that has a constant one."""
    return {m.label: float(m.options["damping"]) for m in b.block.methods if "damping" in m.options}


def _strata(b: BudgetRows) -> list[str]:
    """Return the strata of the smallest singular value, the nearest to a singularity first."""
    found: list[str] = b.rows.group_by("group").agg(pl.col("sigma").median()).sort("sigma")["group"].to_list()
    return found


def _figures(b: BudgetRows) -> Figures:
    """Return success, iterations of solved targets, and remaining error [mm] by stratum and method at the largest budget."""
    found = {}
    for g in _strata(b):
        for m in b.methods:
            part = b.last.filter((pl.col("group") == g) & (pl.col("method") == m))
            share, low, high = success(part, 1e-6)
            median, p95 = quantiles(1e3 * part["position_error"].to_numpy(), (0.5, 0.95))
            (took,) = quantiles(part.filter(pl.col("status") == "solved")["iterations"].to_numpy(), (0.5,))
            found[g, m] = {"count": len(part), "share": share, "low": low, "high": high}
            found[g, m] |= {"iterations": took, "median": median, "p95": p95}
    return found


def _damping_table(b: BudgetRows, strata: list[str]) -> Table:
    """Return the success rate in each stratum; iterations and errors on request."""
    columns = [Column("label", "Damping", show="text")]
    aside, mm = [], pl.col("position_error") * 1e3
    for g in strata:
        here, count = pl.col("group") == g, len(b.last.filter(pl.col("group") == g, pl.col("method") == b.methods[0]))
        rate = share(succeeded(SUCCESS_LEVELS[-1]), among=here)
        columns.append(Column(f"share {g}", f"solved, {g} (n = {count:,})", "%", "more", "share", of=rate))
        took = quantile("iterations", 0.5, among=here & (pl.col("status") == "solved"))
        aside += [
            Column(f"iterations {g}", f"iterations of the solved, median, {g}", show="count", aside=True, of=took),
            Column(
                f"median {g}",
                f"position error, median, {g}",
                "mm",
                "less",
                aside=True,
                of=quantile(mm, 0.5, among=here),
            ),
            Column(
                f"p95 {g}", f"position error, p95, {g}", "mm", "less", aside=True, of=quantile(mm, 0.95, among=here)
            ),
        ]
    groups = [({"label": m}, b.last.filter(pl.col("method") == m)) for m in b.methods]
    title = f"Damping by distance to a singularity, at most {b.budget} iterations, one attempt"
    return table_of("damping", title, [*columns, *aside], groups, "n: targets. Intervals are Wilson's, 95 %.")


def choose_dampings(constants: dict[str, float], figures: dict[str, dict[str, Any]]) -> list[str]:
    """Return the dampings that no other is significantly better than, best first.

    Those whose interval of success reaches that of the surest; among them by median iterations, then by success rate.
    """
    best = max(figures[m]["low"] for m in constants)
    level = [m for m in constants if figures[m]["high"] >= best and not math.isnan(figures[m]["iterations"])]
    return sorted(level, key=lambda m: (figures[m]["iterations"], -figures[m]["share"]))


def _advice(constants: dict[str, float], others: list[str], figures: dict[str, dict[str, float]]) -> str:
    """Name the best damping of a stratum, those as good, the lowest, and the methods without a constant damping."""
    level = choose_dampings(constants, figures)
    if not level:
        return "none of these dampings solves any target here."
    first, rest = level[0], level[1:]
    text = f"{first}: {_words(figures[first])}"
    if rest:
        text += f"; {listed(rest)} not significantly less successful, but no faster"
    worst = min(constants, key=lambda m: figures[m]["share"])
    if worst not in level:
        text += f"; lowest: {worst} with {_rate(figures[worst])}"
    calm = min(constants, key=lambda m: figures[m]["p95"])
    if figures[calm]["p95"] < 0.1 * figures[first]["p95"]:
        text += (
            f". Its failures diverge: the 95th percentile of its position error is {number(figures[first]['p95'])} mm, "
            f"against {number(figures[calm]['p95'])} mm with {calm}"
        )
    return text + "".join(f". {m}: {_words(figures[m])}" for m in others) + "."


def _words(figures: dict[str, float]) -> str:
    took = figures["iterations"]
    after = f" after a median of {iterations(round(took)) if took % 1 == 0 else f'{took:g} iterations'}"
    return f"{_rate(figures)} solved{'' if math.isnan(took) else after}"


def _rate(figures: dict[str, float]) -> str:
    return f"{percent(figures['share'])} of {figures['count']:,}"


def _best_everywhere(strata: list[str], constants: dict[str, float], others: list[str], table: Figures) -> str:
    """Name the damping with the best success rate in its worst stratum, and the same rate of the other methods."""
    lowest = {m: min((table[g, m] for g in strata), key=lambda f: f["share"]) for m in (*constants, *others)}
    best = max(constants, key=lambda m: (lowest[m]["share"], -sum(table[g, m]["iterations"] for g in strata)))
    text = f"{best} has the highest success rate in its worst stratum, {_rate(lowest[best])}"
    return text + "".join(f"; {m}: {_rate(lowest[m])}" for m in others) + "."


def _damping_board(b: BudgetRows, strata: list[str], constants: dict[str, float], table: Figures) -> Board:
    ordered = sorted(constants, key=lambda m: constants[m])
    across, shares = log_axis("damping λ", dtick=1), boards.percent_axis("targets solved")
    took, errors = log_axis("iterations", dtick=1), log_axis("error [mm]")
    plots = {
        "share": figure("damping-success", "Solved at 1e−6 m and rad", across, shares),
        "iterations": figure("damping-iterations", "Median iterations, solved targets", across, took),
        "p95": figure("damping-error", "Position error, 95th percentile", across, errors),
    }
    for key, plot in plots.items():
        for group, shade in zip(strata, shades(len(strata)), strict=True):
            y = [max(table[group, m][key], FLOOR_MM) if key == "p95" else table[group, m][key] for m in ordered]
            add(plot, line(
                [constants[m] for m in ordered], y, mode="lines+markers", name=group, line={"color": shade, "width": 2},
                marker={"size": 6}, hover=f"{group}<br>λ = %{{x}}: %{{y:.4~g}}",
            ))  # fmt: skip
    return Board(
        "damping-board", tuple(plots.values()), (),
        f"One attempt of at most {b.budget} iterations from starts 0.1 rad (standard deviation) away. σ is the smallest "
        "singular value of the Jacobian at the solution. Errors below 10⁻⁹ mm are shown as 10⁻⁹ mm.",
    )  # fmt: skip
