"""Pairs of methods on the same problems: each against the first of a block."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import polars as pl

from benchmarks.records import slug
from benchmarks.report.base import Column, Table
from benchmarks.statistics import holm, mcnemar, ratio_interval, signed_rank

if TYPE_CHECKING:
    from typing import Any

    from benchmarks.blocks.ik.calls.rows import CallRows
    from benchmarks.report.base import Cell


def paired(b: CallRows) -> Table | None:
    """Each method against the first, on the problems that both were given."""
    reference = b.block.reference
    others = [label for label in b.by_method if label != reference]
    if reference not in b.by_method or not others:
        return None
    found = [_pair(b.by_method[label], b.by_method[reference]) for label in others]
    for key in ("p_solved", "p_time"):
        for cells, p in zip(found, holm([cells[key] for cells in found]), strict=True):
            cells[key] = p
    rows: list[Mapping[str, Cell]] = [{"label": label} | cells for label, cells in zip(others, found, strict=True)]
    columns = (
        Column("label", "Method", show="text"),
        Column("both", "solved by both", show="count"),
        Column("only", "by this method only", "", "more", "count"),
        Column("only_reference", f"by {reference} only", "", "less", "count"),
        Column("neither", "by neither", show="count"),
        Column("p_solved", "p, McNemar", show="p"),
        Column("ratio", f"time ratio to {reference}, solved by both", "", "less"),
        Column("p_time", "p, Wilcoxon", show="p"),
    )
    note = (
        f"Each method against {reference} on the problems that both were given. Success: McNemar's exact test on the problems "
        "that only one of them solved. Time: ratio of medians on the problems that both solved, with its 95 % bootstrap "
        "interval (pairs resampled), and Wilcoxon's signed-rank test on the logarithms. p-values are two-sided and corrected "
        f"by Holm's procedure for the {len(others)} method{'s' if len(others) != 1 else ''} of this table."
    )
    return Table(f"speed-{slug(b.block.id)}-pairs", f"{b.block.title}: paired tests", columns, tuple(rows), note)


def _pair(part: pl.DataFrame, reference: pl.DataFrame) -> dict[str, Any]:
    pairs = part.select("problem", "solved", "ns").join(
        reference.select("problem", other="solved", other_ns="ns"), on="problem"
    )
    test = mcnemar(pairs["solved"].to_numpy(), pairs["other"].to_numpy())
    both = pairs.filter(pl.col("solved") & pl.col("other")).sort("problem")
    mine, other = both["ns"].to_numpy(), both["other_ns"].to_numpy()
    return {
        "both": test.both, "only": test.first, "only_reference": test.second, "neither": test.neither,
        "p_solved": test.p if len(pairs) else float("nan"), "ratio": ratio_interval(mine, other),
        "p_time": signed_rank(mine, other),
    }  # fmt: skip
