"""Tables of a block of single calls: success and time, tolerances, equal time, equal iterations, pairs, failures by group."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from benchmarks.kinds.base import Column, Table
from benchmarks.kinds.calls.judgement import JUDGED_AT, level_name, solved_at
from benchmarks.kinds.calls.measures import SHIFT_US, median_ratio
from benchmarks.kinds.calls.report.pairs import paired
from benchmarks.records import slug
from benchmarks.statistics import quantiles, shifted_geometric_mean, wilson
from optik.ik import Tolerance
from optik.registry import short_name

if TYPE_CHECKING:
    from benchmarks.kinds._shown import Cell
    from benchmarks.kinds.calls.rows import CallRows

TIME_BUDGETS_US = (10.0, 30.0, 100.0, 1e3, 1e4, 1e5)
"""Times within which a call must have its answer in the table of equal time [µs]: a control cycle has 1,000."""

REMEMBERS_FROM = 2.0
"""A first round this many times as slow as the median of all rounds is named: the method may remember answers."""

TAIL = (0.5, 0.95, 0.99, 1.0)
"""Shares of calls whose times are shown: median, p95, p99 and the longest."""

LABEL = Column("label", "Method", show="text")
"""First column of every table."""


def block_tables(b: CallRows) -> tuple[Table, ...]:
    """All tables of a block.

    Parameters
    ----------
    b : CallRows
        The block.

    Returns
    -------
    tuple of Table
        In the order of the page.
    """
    found = (success_and_time(b), within_time(b), at_tolerances(b), at_iterations(b), paired(b), by_group(b))
    return tuple(table for table in found if table is not None)


def share_cell(count: int, trials: int) -> tuple[float, float, float]:
    """A share with Wilson's 95 % interval.

    Parameters
    ----------
    count, trials : int
        How many of how many, at least one.

    Returns
    -------
    tuple of float
        Share, lower and upper end [%].
    """
    low, high = wilson(count, trials)
    return 100.0 * count / trials, 100.0 * low, 100.0 * high


def _rows(
    b: CallRows, first: str, cells: Callable[[str, pl.DataFrame], dict[str, Cell]]
) -> tuple[Mapping[str, Cell], ...]:
    """One row for each entry; of one that has no rows, the word for why in place of a rate."""
    rows: list[Mapping[str, Cell]] = []
    for label in b.entries:
        part = b.by_method.get(label)
        rows.append({"label": label} | ({first: b.why_not(label)[0]} if part is None else cells(label, part)))
    return tuple(rows)


# ---------------------------------------------------------------- success and time


def success_and_time(b: CallRows) -> Table:
    """Share solved, and times of the calls that solved and of those that did not, apart.

    Parameters
    ----------
    b : CallRows
        The block.

    Returns
    -------
    Table
        One row for each entry.
    """
    us = "µs"
    columns = (
        LABEL,
        Column("solved", "solved", "%", "more", "share"),
        Column("median", "median time, solved", us, "less"),
        Column("p95", "p95, solved", us, "less"),
        Column("p99", "p99, solved", us, "less"),
        Column("failed_median", "median time, not solved", us, "less"),
        Column("ratio", f"median over that of {b.block.reference}"),
        Column("false_claims", "claimed, not solved", "", "less", "count"),
        Column("count", "problems", show="count"),
        Column("max", "longest, solved", us, "less", aside=True),
        Column("failed", "not solved", show="count", aside=True),
        Column("failed_p95", "p95, not solved", us, "less", aside=True),
        Column("failed_p99", "p99, not solved", us, "less", aside=True),
        Column("failed_max", "longest, not solved", us, "less", aside=True),
        Column("mean", "mean time, all", us, "less", aside=True),
        Column("shifted", f"shifted geometric mean, all (shift {SHIFT_US:g} µs)", us, "less", aside=True),
        Column("cpu", "processor time over wall time, all", "", "less", aside=True),
        Column("none", "no answer", show="count", aside=True),
        Column("raised", "raised", show="count", aside=True),
        Column("crashed", "crashed", show="count", aside=True),
        Column("iterations", "mean iterations", aside=True),
        Column("restarts", "mean restarts", aside=True),
        Column("noise", "spread between rounds, median", "%", aside=True),
        Column("first_round", "first round over median", aside=True),
        Column("mutated", "changed its input", "", "less", "count", aside=True),
        Column("varies", "differs between runs by", show="text", aside=True),
        Column("build", "building", "ms", "less", aside=True),
    )
    rows = _rows(b, "solved", lambda label, part: _success_cells(b, label, part))
    title = f"{b.block.title}: solved, and time of a call"
    return Table(f"speed-{slug(b.block.id)}", title, columns, rows, _note(b))


def _success_cells(b: CallRows, label: str, part: pl.DataFrame) -> dict[str, Cell]:
    us = part["ns"].to_numpy() / 1e3
    solved = part["solved"].to_numpy()
    good = dict(zip(("median", "p95", "p99", "max"), quantiles(us[solved], TAIL), strict=True))
    names = ("failed_median", "failed_p95", "failed_p99", "failed_max")
    failed = dict(zip(names, quantiles(us[~solved], TAIL), strict=True))
    about = b.entries[label]
    cells: dict[str, Cell] = {
        "solved": share_cell(int(solved.sum()), len(part)), "count": len(part), "failed": int((~solved).sum()),
        "ratio": median_ratio(b.rows, label, b.block.reference), "mean": float(us.mean()),
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
        cells |= {word: int((part["outcome"] == word).sum()) for word in ("none", "raised", "crashed")}
    if "cpu_ns" in part.columns and not part["cpu_ns"].is_null().all():
        cells["cpu"] = float(part["cpu_ns"].sum()) / float(part["ns"].sum())
    if "mutated" in part.columns:
        cells["mutated"] = int(part["mutated"].sum())
    if "ns_first" in part.columns and (part["ns_max"] != part["ns_min"]).any():
        spread = (part["ns_max"] - part["ns_min"]) / part["ns"]
        cells["noise"] = 100.0 * float(np.median(spread.to_numpy()))
        cells["first_round"] = float(np.median(part["ns_first"].to_numpy()) / np.median(part["ns"].to_numpy()))
    return cells


def varies(about: Mapping[str, Any]) -> str:
    """By what a method's answers differ between runs, beside its inputs.

    Parameters
    ----------
    about : dict
        Facts on the entry.

    Returns
    -------
    str
        ``the clock``, ``random numbers``, both, or nothing.
    """
    return ", ".join(words for key, words in (("clocked", "the clock"), ("random", "random numbers")) if about.get(key))


def _mean(part: pl.DataFrame, column: str) -> float | None:
    values = part[column].drop_nulls()
    return float(values.to_numpy().mean()) if len(values) else None


def _note(b: CallRows) -> str:
    """What a reader must know: problems, intervals, and what methods did that a reader would not expect."""
    block, sentences = b.block, []
    sentences.append(
        f"{b.facts['count']:,} problems of {short_name(block.set).replace('_', ' ')} on {short_name(block.robot)}; slow "
        "methods are given fewer, the same ones for all. A failure counts as one wherever a share is shown; intervals are "
        "Wilson's, 95 %. A call's time is the median of its "
        f"{block.rounds} round{'s' if block.rounds != 1 else ''}; timing itself adds {b.facts['clock_ns']:.0f} ns to all."
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
    claimed = cells.get("false_claims")
    if claimed:
        far = int((part["claimed"].fill_null(value=False) & ~part.select(solved_at(JUDGED_AT[0])).to_series()).sum())
        beyond = f"outside the limits or more than {level_name(JUDGED_AT[0])} m or rad off"
        yield f"claimed {claimed:,} answers that do not solve, {far:,} of them {beyond}"
    if cells.get("mutated"):
        yield f"changed its input in {cells['mutated']:,} calls; every call has copies of its own"
    first = cells.get("first_round")
    if isinstance(first, float) and first > REMEMBERS_FROM:
        yield f"took {first:.1f} times as long in its first round: it may remember answers, and be timed on repeated calls"
    if by:
        yield f"differs between runs by {by}"


# ---------------------------------------------------------------- equal time, tolerances, equal iterations


def within_time(b: CallRows) -> Table:
    """Share of problems solved by a call that took at most a time.

    Parameters
    ----------
    b : CallRows
        The block.

    Returns
    -------
    Table
        One column for each time.
    """
    columns = [
        Column(f"us{budget:g}", f"within {_time_words(budget)}", "%", "more", "share") for budget in TIME_BUDGETS_US
    ]

    def cells(label: str, part: pl.DataFrame) -> dict[str, Cell]:
        us, solved = part["ns"].to_numpy() / 1e3, part["solved"].to_numpy()
        return {f"us{t:g}": share_cell(int((solved & (us <= t)).sum()), len(part)) for t in TIME_BUDGETS_US}

    rows = _rows(b, columns[0].key, cells)
    note = "All methods as they come, none told of the time: an answer that came later does not count. Share of all problems."
    return Table(f"speed-{slug(b.block.id)}-time", f"{b.block.title}: equal time", (LABEL, *columns), rows, note)


def _time_words(us: float) -> str:
    return f"{us:g} µs" if us < 1e3 else f"{us / 1e3:g} ms"


def at_tolerances(b: CallRows) -> Table:
    """Share solved at several tolerances, with what each method is set to.

    Parameters
    ----------
    b : CallRows
        The block.

    Returns
    -------
    Table
        One column for each tolerance.
    """
    columns = [
        LABEL,
        *(
            Column(f"at{level_name(level)}", f"within {level_name(level)} m and rad", "%", "more", "share")
            for level in JUDGED_AT
        ),
        Column("position", "median position error, solved", "m", "less"),
        Column("rotation", "median rotation error, solved", "rad", "less"),
        Column("settings", "set to", show="text"),
    ]

    def cells(label: str, part: pl.DataFrame) -> dict[str, Cell]:
        solved = part.filter("solved")
        words = b.entries[label]["settings"]
        ours = b.entries[label]["kind"] != "peer"
        return {
            **{
                f"at{level_name(level)}": share_cell(int(part.select(solved_at(level).sum()).item()), len(part))
                for level in JUDGED_AT
            },
            "position": quantiles(solved["position_error"].to_numpy(), (0.5,))[0],
            "rotation": quantiles(solved["rotation_error"].to_numpy(), (0.5,))[0],
            "settings": f"{words}; stops within {level_name(Tolerance().position)} m and rad" if ours else words,
        }

    note = (
        "Judged by our forward kinematics inside the limits, whatever a method claims. A method that stops at its own "
        "tolerance is not asked for more: the finest column says what each reaches as it is set."
    )
    rows = _rows(b, f"at{level_name(JUDGED_AT[0])}", cells)
    return Table(f"speed-{slug(b.block.id)}-tolerance", f"{b.block.title}: tolerances", tuple(columns), rows, note)


def at_iterations(b: CallRows) -> Table | None:
    """Share solved by one attempt that ends after a number of iterations.

    Parameters
    ----------
    b : CallRows
        The block.

    Returns
    -------
    Table or None
        None where no numbers were asked for.
    """
    answers = b.evaluations
    if answers is None:
        return None
    budgets = b.block.evaluation_budgets
    columns = [Column(f"n{n}", f"{n} iterations", "%", "more", "share") for n in budgets]
    rows: list[Mapping[str, Cell]] = []
    for label in b.entries:
        row: dict[str, Cell] = {"label": label}
        mine = answers.filter(pl.col("method") == label)
        if mine.is_empty():
            row[columns[0].key] = b.why_not(label)[0] or "cannot be told"
        for (n,), part in mine.group_by("budget"):
            row[f"n{n}"] = share_cell(int(part["solved"].sum()), len(part))
        rows.append(row)
    note = (
        "One attempt from the given start, without restarts, stopped after so many iterations. What an iteration is differs: "
        "one evaluation of the Jacobian and one step for most, a whole quadratic programme or factorisation for some; a "
        "closed form has none. Compare times in the table of equal time."
    )
    title = f"{b.block.title}: equal numbers of iterations"
    return Table(f"speed-{slug(b.block.id)}-iterations", title, (LABEL, *columns), tuple(rows), note)


# ---------------------------------------------------------------- failures by group


def by_group(b: CallRows) -> Table | None:
    """Problems that each method did not solve, by the groups of the problem set.

    Parameters
    ----------
    b : CallRows
        The block.

    Returns
    -------
    Table or None
        None where there is one group, or nothing failed.
    """
    groups = [str(group) for group in b.rows["group"].unique().sort()]
    if len(groups) < 2 or b.rows["solved"].all():
        return None
    columns = [Column(f"g{i}", group, "%", "more", "share") for i, group in enumerate(groups)]

    def cells(label: str, part: pl.DataFrame) -> dict[str, Cell]:
        counts = {
            str(g): (s, n) for g, s, n in part.group_by("group").agg(pl.col("solved").sum(), pl.len()).iter_rows()
        }
        return {f"g{i}": share_cell(*counts[group]) if group in counts else None for i, group in enumerate(groups)}

    rows = _rows(b, columns[0].key, cells)
    title = f"{b.block.title}: solved, by kind of problem"
    return Table(f"speed-{slug(b.block.id)}-groups", title, (LABEL, *columns), rows, "Intervals are Wilson's, 95 %.")
