"""The workspace in one picture: who reaches which spots of one sheet of graph paper."""

from __future__ import annotations

from typing import Any

import polars as pl

from benchmarks.blocks.ik.budgets.measures import SUCCESS_LEVELS, succeeded
from benchmarks.report.board import Board, Key
from benchmarks.report.figures import HOVER, heatmap
from benchmarks.report.ik.budgets.pair import Pair, pairs
from benchmarks.report.ik.budgets.sheets import Sheet, Squares, laid_out, sheet_plot, sheets_of
from benchmarks.report.run import Run


def picture(run: Run) -> dict[str, Any] | None:
    """The sheet of graph paper through the tool: which spots the default and the paper's iteration reach."""
    found = [pair for pair in pairs(run) if sheets_of(pair.rows)]
    return {"lead": "", "boards": [_board(found[0], run)], "tables": [], "how": "", "prose": []} if found else None


def _board(pair: Pair, run: Run) -> Board:
    b = pair.rows
    sheet = min(sheets_of(b), key=lambda s: abs(s.offset))
    plot = sheet_plot("picture", b, sheet, run.robot(b.block.robot))
    rows, squares = laid_out(b.last.filter(pl.col("method").is_in([pair.paper, pair.attempt])), sheet)
    rows = rows.with_columns(ok=succeeded(SUCCESS_LEVELS[-1]) & pl.col("known"))
    by = {True: pair.attempt, False: pair.paper}
    solved = rows.group_by("problem", "row", "col", "known").agg(
        *((pl.col("ok") & (pl.col("method") == label)).any().alias(f"by_{first}") for first, label in by.items())
    )
    for words, colour, chosen in _categories(pair, run):
        squared = solved.filter(chosen).with_columns(one=pl.lit(1.0))
        _fill(plot, squared, squares, sheet, words, colour)
    legend = tuple(Key(words, colour, "fill") for words, colour, _ in _categories(pair, run))
    return Board(
        f"picture-{b.block.id}", (plot,), (), (*legend, Key("tool at the start", "#fff", "ring")),
        f"{sheet.plane} sheet through the tool, base frame; at most {b.budget} iterations, one attempt each.",
    )  # fmt: skip


def _categories(pair: Pair, run: Run) -> tuple[tuple[str, str, pl.Expr], ...]:
    """What may be true of a spot: in words, its colour, and which rows it holds for."""
    mine, other, known = pl.col("by_True"), pl.col("by_False"), pl.col("known")
    return (
        ("reached by both", "var(--c2)", mine & other),
        (f"by {pair.attempt} only", run.colour(pair.attempt), mine & ~other),
        (f"by {pair.paper} only", run.colour(pair.paper), other & ~mine),
        ("by neither", "var(--alarm)", known & ~mine & ~other),
        ("no known solution", "var(--unknown)", ~known),
    )


def _fill(plot: Any, rows: pl.DataFrame, squares: Squares, sheet: Sheet, words: str, colour: str) -> None:
    """Fill some squares with one colour."""
    if rows.is_empty():
        return
    plot.add(
        heatmap(
            z=squares.matrix(rows, "one"), **squares.options, colorscale=[[0, colour], [1, colour]], showscale=False,
            hovertemplate=f"{sheet.u} %{{x:.0f}} mm, {sheet.v} %{{y:.0f}} mm<br>{words}{HOVER}",
        )
    )  # fmt: skip
