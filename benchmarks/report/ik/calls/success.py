"""The table of success and time, and what a reader must know of each method to read it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from benchmarks.blocks.ik.calls.judgement import JUDGED_AT, level_name, solved_at
from benchmarks.blocks.ik.calls.measures import SHIFT_US, ratio_where_solved
from benchmarks.blocks.ik.calls.rounds import REMEMBERS_FROM
from benchmarks.records import slug
from benchmarks.report.base import Column, Table
from benchmarks.report.ik.calls.cells import LABEL, compared_columns, entry_rows, share_cell
from benchmarks.statistics import quantiles, shifted_geometric_mean
from optik.registry import short_name

if TYPE_CHECKING:
    from benchmarks.blocks.ik.calls.rows import CallRows
    from benchmarks.report.base import Cell

TAIL = (0.5, 0.95, 0.99, 1.0)
"""Shares of calls whose times are shown: median, p95, p99 and the longest."""


def success_and_time(b: CallRows) -> Table:
    """Share solved, and times of the calls that solved and of those that did not, apart."""
    us = "µs"
    columns = (
        LABEL,
        Column("solved", "solved", "%", "more", "share"),
        Column("median", "median time, solved", us, "less"),
        Column("p95", "p95, solved", us, "less"),
        Column("p99", "p99, solved", us, "less"),
        Column("failed_median", "median time, not solved", us),
        Column("ratio", f"time ratio to {b.block.reference}, solved by both", "", "less"),
        Column("false_claims", "false success claims", "", "less", "count"),
        Column("count", "problems", show="count"),
        Column("max", "longest, solved", us, "less", aside=True),
        Column("failed", "not solved", show="count", aside=True),
        Column("failed_p95", "p95, not solved", us, aside=True),
        Column("failed_p99", "p99, not solved", us, aside=True),
        Column("failed_max", "longest, not solved", us, aside=True),
        Column("mean", "mean time, all", us, aside=True),
        Column("shifted", f"shifted geometric mean, all (shift {SHIFT_US:g} µs)", us, aside=True),
        Column("cpu", "CPU time / wall time, all", "", "less", aside=True),
        Column("none", "no answer", show="count", aside=True),
        Column("raised", "raised", show="count", aside=True),
        Column("crashed", "crashed", show="count", aside=True),
        Column("refused", "refused", show="count", aside=True),
        Column("iterations", "mean iterations", aside=True),
        Column("restarts", "mean restarts", aside=True),
        Column("noise", "spread between rounds, median", "%", aside=True),
        Column("first_round", "first round / median", aside=True),
        Column("changed_input", "changed input", "", "less", "count", aside=True),
        Column("varies", "varies between runs with", show="text", aside=True),
        Column("build", "building", "ms", "less", aside=True),
    )
    rows = entry_rows(b, "solved", lambda label, part: _success_cells(b, label, part))
    title = f"{b.block.title}: success rate and time of a call"
    return Table(f"speed-{slug(b.block.id)}", title, compared_columns(columns), rows, _note(b))


def _success_cells(b: CallRows, label: str, part: pl.DataFrame) -> dict[str, Cell]:
    us = part["ns"].to_numpy() / 1e3
    solved = part["solved"].to_numpy()
    good = dict(zip(("median", "p95", "p99", "max"), quantiles(us[solved], TAIL), strict=True))
    names = ("failed_median", "failed_p95", "failed_p99", "failed_max")
    failed = dict(zip(names, quantiles(us[~solved], TAIL), strict=True))
    about = b.entries[label]
    cells: dict[str, Cell] = {
        "solved": share_cell(int(solved.sum()), len(part)), "count": len(part), "failed": int((~solved).sum()),
        "ratio": ratio_where_solved(b.rows, label, b.block.reference), "mean": float(us.mean()),
        "shifted": shifted_geometric_mean(us, SHIFT_US), "iterations": _mean(part, "iterations"),
        "restarts": _mean(part, "restarts"), "varies": varies(about),
        "build": 1e3 * about["build_seconds"] if "build_seconds" in about else None,
    }  # fmt: skip
    return cells | good | failed | _conduct(part)


def _conduct(part: pl.DataFrame) -> dict[str, Cell]:
    """What calls claimed, how they ended and what they did to their inputs, as far as a run has kept it."""
    cells: dict[str, Cell] = {}
    if "claimed" in part.columns and not part["claimed"].is_null().all():
        cells["false_claims"] = int((part["claimed"].fill_null(value=False) & ~part["solved"]).sum())
    if "outcome" in part.columns:
        cells |= {word: int((part["outcome"] == word).sum()) for word in ("none", "raised", "crashed", "refused")}
    if "cpu_ns" in part.columns and not part["cpu_ns"].is_null().all():
        cells["cpu"] = float(part["cpu_ns"].sum()) / float(part["ns"].sum())
    if "changed_input" in part.columns:
        cells["changed_input"] = int(part["changed_input"].sum())
    if "first_ns" in part.columns and (part["most_ns"] != part["least_ns"]).any():
        spread = (part["most_ns"] - part["least_ns"]) / part["ns"]
        cells["noise"] = 100.0 * float(np.median(spread.to_numpy()))
    if "first_round" in part.columns:
        cells["first_round"] = float(part["first_round"][0])
    return cells


def varies(about: Mapping[str, Any]) -> str:
    """Return what a method's answers depend on besides its inputs, in words."""
    return ", ".join(words for key, words in (("clocked", "the clock"), ("random", "random numbers")) if about.get(key))


def _mean(part: pl.DataFrame, column: str) -> float | None:
    values = part[column].drop_nulls()
    return float(values.to_numpy().mean()) if len(values) else None


def _note(b: CallRows) -> str:
    """What a reader must know: problems, intervals, and what methods did that a reader would not expect."""
    block, sentences = b.block, []
    sentences.append(
        f"{b.facts['count']:,} problems of {short_name(block.set).replace('_', ' ')} on {short_name(block.robot)}; "
        "slow methods are given a subset, and their values are never marked as the best. Rates count every failure. Intervals "
        "are Wilson's, 95 %. A call's time is the median of its "
        f"{block.rounds} round{'s' if block.rounds != 1 else ''}; the clock itself adds {b.facts['clock_ns']:.0f} ns to each."
    )
    if b.unreachable:
        sentences.append(
            "No target of this block has a solution, which is proved. The figures of merit are the number of false success "
            "claims and the time until a method gives up."
        )
    for label in b.entries:
        word, reason = b.why_not(label)
        if word:
            sentences.append(f"{label}: {word}{f' ({reason})' if reason else ''}.")
    for label, part in b.by_method.items():
        sentences += [f"{label} {words}." for words in _conspicuous(part, varies(b.entries[label]))]
    return " ".join(sentences)


def _conspicuous(part: pl.DataFrame, by: str) -> Iterable[str]:
    """What a method did that its times or rates alone do not show."""
    cells = _conduct(part)
    if cells.get("raised") and "error" in part.columns:
        reasons = part.filter(pl.col("outcome") == "raised")["error"].drop_nulls()
        reason = " ".join(reasons[0].split()) if len(reasons) else "no reason recorded"
        yield f"raised in {cells['raised']:,} of {len(part):,} calls, first: {reason}"
    if cells.get("crashed") and "error" in part.columns:
        reasons = part.filter(pl.col("outcome") == "crashed")["error"].drop_nulls()
        yield f"crashed in {cells['crashed']:,} of {len(part):,} calls: {reasons[0] if len(reasons) else 'no reason recorded'}"
    claimed = cells.get("false_claims")
    if claimed:
        far = int((part["claimed"].fill_null(value=False) & ~part.select(solved_at(JUDGED_AT[0])).to_series()).sum())
        beyond = f"outside the limits or more than {level_name(JUDGED_AT[0])} m or rad off"
        yield f"claimed success for {claimed:,} wrong answers, {far:,} of them {beyond}"
    if cells.get("changed_input"):
        yield f"changed its input in {cells['changed_input']:,} calls; each call gets copies"
    first = cells.get("first_round")
    if isinstance(first, float) and first > REMEMBERS_FROM:
        yield f"took {first:.1f} times as long in its first round: it may cache answers, so the first round is its time"
    if by:
        yield f"varies between runs with {by}"
