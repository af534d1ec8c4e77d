"""Tables of a block of single calls: success and time, equal time, tolerances, equal iterations, paired tests, groups."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.ik.calls import FIRST_ROUND_FROM, SHIFT_US, CallRows, ratio_where_solved
from benchmarks.blocks.ik.judgement import JUDGED_AT, level_name, solved_at
from benchmarks.records import slug
from benchmarks.report.numbers import listed
from benchmarks.report.tables import Cell, Column, Table
from benchmarks.statistics import (
    holm,
    is_too_few,
    mcnemar,
    percentage,
    quantiles,
    ratio_interval,
    shifted_geometric_mean,
    signed_rank,
)
from optik.ik import Tolerance
from optik.registry import short_name

TAIL = (0.5, 0.95, 0.99, 1.0)
"""Fractions of calls whose times are shown: median, p95, p99 and the longest."""

TIME_BUDGETS_US = (10.0, 30.0, 100.0, 1e3, 1e4, 1e5)
"""Times within which a call must have its answer in the table of equal time [µs]: a control cycle has 1,000."""

LABEL = Column("label", "Method", show="text")
"""First column of every table."""

PROBLEM_COUNT = Column("count", "problems", show="count")
"""Second column of every table with rates."""

GIVEN = Column("given", "given the largest number of problems", show="text", aside=True)
"""Whether a method was given the largest number of problems; no value of the others is marked as the best of its column."""

CellsOf = Callable[[str, pl.DataFrame], dict[str, Cell]]
"""Function from the label and the rows of an entry to its cells."""


def block_tables(b: CallRows) -> list[Table]:
    """Return all tables of a block."""
    found = (success_and_time(b), _within_time(b), _at_tolerances(b), _at_iterations(b), _paired(b), _by_group(b))
    return [table for table in found if table is not None]


def _table(
    b: CallRows, ending: str, title: str, columns: Iterable[Column], cells: CellsOf, note: str,
    *, parts: Mapping[str, pl.DataFrame] | None = None, absent: str = "",
) -> Table:  # fmt: skip
    """Return a table with a row for each method, or the reason for its absence; the best is marked on equal problems."""
    first, *others = (replace(column, among=GIVEN.key) if column.better else column for column in columns)
    found = b.by_method if parts is None else parts
    counts = {label: part["problem"].n_unique() for label, part in found.items()}
    most = max(counts.values(), default=0)
    rows: list[Mapping[str, Cell]] = []
    for label in b.entries:
        row: dict[str, Cell] = {"label": label, first.key: b.why_not(label)[0] or absent}
        if label in found:
            row = {"label": label, "count": counts[label], GIVEN.key: "yes" if counts[label] == most else ""}
            row |= cells(label, found[label])
        rows.append(row)
    heading = f"{b.block.title}: {title}"
    return Table(
        f"speed-{slug(b.block.id)}{ending}", heading, (LABEL, PROBLEM_COUNT, first, *others, GIVEN), tuple(rows), note
    )


def success_and_time(b: CallRows) -> Table:
    """Return the success rate, and the times of the calls that solved apart from those that did not."""
    us = "µs"
    columns = (
        Column("solved", "solved", "%", "more", "share"),
        Column("median", "median time, solved", us, "less"),
        Column("p95", "p95, solved", us, "less"),
        Column("p99", "p99, solved", us, "less"),
        Column("failed_median", "median time, not solved", us),
        Column("ratio", f"time ratio to {b.block.reference}, solved by both", "", "less"),
        Column("false_claims", "false success claims", "", "less", "count"),
        Column("max", "longest, solved", us, "less", aside=True),
        Column("failed", "not solved", show="count", aside=True),
        Column("failed_p95", "p95, not solved", us, aside=True),
        Column("failed_p99", "p99, not solved", us, aside=True),
        Column("failed_max", "longest, not solved", us, aside=True),
        Column("mean", "mean time, all", us, aside=True),
        Column("shifted", f"shifted geometric mean, all (shift {SHIFT_US:g} µs)", us, aside=True),
        Column("cpu", "CPU time / wall time, all", "", "less", aside=True),
        *(Column(key, words, show="count", aside=True) for key, words in (("none", "no answer"), ("raised", "raised"))),
        *(Column(key, key, show="count", aside=True) for key in ("crashed", "refused")),
        Column("iterations", "mean iterations", aside=True),
        Column("restarts", "mean restarts", aside=True),
        Column("noise", "spread between rounds, median", "%", aside=True),
        Column("first_round", "first call / median call, median over problems", aside=True),
        Column("changed_input", "changed input", "", "less", "count", aside=True),
        Column("varies", "varies between runs with", show="text", aside=True),
        Column("build", "building", "ms", "less", aside=True),
    )
    return _table(
        b, "", "success rate and time of a call", columns, lambda label, part: _success_cells(b, label, part), _note(b)
    )


def _success_cells(b: CallRows, label: str, part: pl.DataFrame) -> dict[str, Cell]:
    us, solved = part["ns"].to_numpy() / 1e3, part["solved"].to_numpy()
    about = b.entries[label]
    cells: dict[str, Cell] = {
        "solved": percentage(int(solved.sum()), len(part)), "failed": int((~solved).sum()),
        "ratio": ratio_where_solved(b.rows, label, b.block.reference), "mean": float(us.mean()),
        "shifted": shifted_geometric_mean(us, SHIFT_US), "varies": _varies(about),
        "build": 1e3 * about["build_seconds"] if "build_seconds" in about else None,
    }  # fmt: skip
    for prefix, times in (("", us[solved]), ("failed_", us[~solved])):
        names = (f"{prefix}{name}" for name in ("median", "p95", "p99", "max"))
        cells |= dict(zip(names, quantiles(times, TAIL), strict=True))
    for column in ("iterations", "restarts"):
        values = part[column].drop_nulls()
        cells[column] = float(values.to_numpy().mean()) if len(values) else None
    return cells | _conduct(part)


def _conduct(part: pl.DataFrame) -> dict[str, Cell]:
    """Return the reported successes, the endings and the side effects on inputs of all calls."""
    endings = {word: int((part["outcome"] == word).sum()) for word in ("none", "raised", "crashed", "refused")}
    first_round = float(part["first_round"][0])
    cells: dict[str, Cell] = endings | {"changed_input": int(part["changed_input"].sum()), "first_round": first_round}
    if not part["claimed"].is_null().all():
        cells["false_claims"] = int((part["claimed"].fill_null(value=False) & ~part["solved"]).sum())
    if not part["cpu_ns"].is_null().all():
        cells["cpu"] = float(part["cpu_ns"].sum()) / float(part["ns"].sum())
    if (part["most_ns"] != part["least_ns"]).any():
        spread = (part["most_ns"] - part["least_ns"]) / part["ns"]
        cells["noise"] = 100.0 * float(np.median(spread.to_numpy()))
    return cells


def _varies(about: Mapping[str, Any]) -> str:
    """Describe the influences on a method's answers besides its inputs."""
    return ", ".join(words for key, words in (("clocked", "the clock"), ("random", "random numbers")) if about.get(key))


def _note(b: CallRows) -> str:
    """Return the notes of a table: problems, intervals, and unexpected behaviour of methods."""
    block, rounds = b.block, b.block.rounds
    sentences = [
        f"{b.facts['count']:,} problems of {short_name(block.set).replace('_', ' ')} on {short_name(block.robot)}; "
        "slow methods are given a subset, and their values are never marked as the best. Rates count every failure. Intervals "
        f"are Wilson's, 95 %. A call's time is the median of its {rounds} round{'s' if rounds != 1 else ''}; the clock itself "
        f"adds {b.facts['clock_ns']:.0f} ns to each."
    ]
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
        sentences += [f"{label} {words}." for words in conspicuous(part, _varies(b.entries[label]))]
    return " ".join(sentences)


def conspicuous(part: pl.DataFrame, varies: str) -> Iterable[str]:
    """Yield unexpected behaviour of a method that its times and rates alone do not show."""
    cells = _conduct(part)
    for outcome, first in (("raised", ", first"), ("crashed", "")):
        if cells[outcome]:
            reasons = part.filter(pl.col("outcome") == outcome)["error"].drop_nulls()
            reason = " ".join(reasons[0].split()) if len(reasons) else "no reason recorded"
            yield f"{outcome} in {cells[outcome]:,} of {len(part):,} calls{first}: {reason}"
    claimed = cells.get("false_claims")
    if claimed:
        far = int((part["claimed"].fill_null(value=False) & ~part.select(solved_at(JUDGED_AT[0])).to_series()).sum())
        beyond = f"outside the limits or more than {level_name(JUDGED_AT[0])} m or rad off"
        yield f"claimed success for {claimed:,} wrong answers, {far:,} of them {beyond}"
    if cells.get("changed_input"):
        yield f"changed its input in {cells['changed_input']:,} calls; each call gets copies"
    first_round = cells.get("first_round")
    if isinstance(first_round, float) and first_round > FIRST_ROUND_FROM:
        yield f"took {first_round:.1f} times as long in its first round (median over the problems): its time is that round's"
    if varies:
        yield f"varies between runs with {varies}"


def _within_time(b: CallRows) -> Table:
    """Return the fraction of problems solved by a call within each time budget."""
    words = {t: f"{t:g} µs" if t < 1e3 else f"{t / 1e3:g} ms" for t in TIME_BUDGETS_US}

    def cells(label: str, part: pl.DataFrame) -> dict[str, Cell]:
        us, solved = part["ns"].to_numpy() / 1e3, part["solved"].to_numpy()
        return {f"us{t:g}": percentage(int((solved & (us <= t)).sum()), len(part)) for t in TIME_BUDGETS_US}

    return _table(
        b, "-time", "equal time",
        [Column(f"us{t:g}", f"within {words[t]}", "%", "more", "share") for t in TIME_BUDGETS_US], cells,
        "Percentage of all problems. All methods have default settings and do not know the time limit; later answers do not "
        "count.",
    )  # fmt: skip


def _at_tolerances(b: CallRows) -> Table:
    """Return the success rates at several tolerances, with the settings of each method."""
    levels = {f"at{level_name(level)}": level for level in JUDGED_AT}
    columns = [
        *(Column(key, f"within {key.removeprefix('at')} m and rad", "%", "more", "share") for key in levels),
        Column("position", "median position error, solved", "m", "less"),
        Column("rotation", "median rotation error, solved", "rad", "less"),
        Column("settings", "set to", show="text"),
    ]

    def cells(label: str, part: pl.DataFrame) -> dict[str, Cell]:
        solved, words = part.filter("solved"), b.entries[label]["settings"]
        if b.entries[label]["kind"] != "peer":
            words = f"{words}; stops within {level_name(Tolerance().position)} m and rad"
        within = {key: int(part.select(solved_at(level).sum()).item()) for key, level in levels.items()}
        return {
            **{key: percentage(count, len(part)) for key, count in within.items()},
            "position": quantiles(solved["position_error"].to_numpy(), (0.5,))[0],
            "rotation": quantiles(solved["rotation_error"].to_numpy(), (0.5,))[0],
            "settings": words,
        }

    return _table(
        b, "-tolerance", "tolerances", columns, cells,
        "Judged by optik's forward kinematics inside the limits, not by a method's own claim. A method stops at its own "
        "tolerance: the finest column shows what it reaches with these settings.",
    )  # fmt: skip


def _at_iterations(b: CallRows) -> Table | None:
    """Return the success rates of one attempt at each iteration limit."""
    if b.evaluations is None:
        return None
    columns = [Column(f"n{n}", f"{n} iterations", "%", "more", "share") for n in b.block.evaluation_budgets]
    parts = {str(label): part for (label,), part in b.evaluations.partition_by("method", as_dict=True).items()}

    def cells(label: str, rows: pl.DataFrame) -> dict[str, Cell]:
        return {f"n{n}": percentage(int(part["solved"].sum()), len(part)) for (n,), part in rows.group_by("budget")}

    note = (
        "One attempt from the given start, without restarts, stopped after this number of iterations. For most methods an "
        "iteration is one Jacobian and one step, for some a whole quadratic programme; a closed form has none. To compare "
        "speed, use the table of equal time."
    )
    return _table(
        b, "-iterations", "equal numbers of iterations", columns, cells, note, parts=parts, absent="no iteration limit"
    )


def _by_group(b: CallRows) -> Table | None:
    """Return the success rate of each method on each group of the problem set."""
    groups = [str(group) for group in b.rows["group"].unique().sort()]
    if len(groups) < 2 or b.rows["solved"].all():
        return None

    def cells(label: str, part: pl.DataFrame) -> dict[str, Cell]:
        counts = {
            str(g): (s, n) for g, s, n in part.group_by("group").agg(pl.col("solved").sum(), pl.len()).iter_rows()
        }
        return {f"g{i}": percentage(*counts[group]) if group in counts else None for i, group in enumerate(groups)}

    most = dict(b.rows.group_by("group", "method").len().group_by("group").agg(pl.col("len").max()).iter_rows())
    columns = [Column(f"g{i}", f"{g} (n = {most[g]:,})", "%", "more", "share") for i, g in enumerate(groups)]
    note = "n: problems of the methods that were given all. Intervals are Wilson's, 95 %."
    return _table(b, "-groups", "solved, by kind of problem", columns, cells, note)


def _paired(b: CallRows) -> Table | None:
    """Return each method against the first, on the problems that both were given."""
    reference = b.block.reference
    others = [label for label in b.by_method if label != reference]
    if reference not in b.by_method or not others:
        return None
    found = [_pair(b.by_method[label], b.by_method[reference]) for label in others]
    few = [label for label, cells in zip(others, found, strict=True) if is_too_few(cells.pop("pairs"), len(others))]
    for key in ("p_solved", "p_time"):
        for cells, p in zip(found, holm([cells[key] for cells in found]), strict=True):
            cells[key] = p
    columns = (
        LABEL,
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
        + (f" Too few problems for a test: {listed(few)}." if few else "")
    )
    rows = tuple({"label": label} | cells for label, cells in zip(others, found, strict=True))
    return Table(f"speed-{slug(b.block.id)}-pairs", f"{b.block.title}: paired tests", columns, rows, note)


def _pair(part: pl.DataFrame, reference: pl.DataFrame) -> dict[str, Any]:
    pairs = part.select("problem", "solved", "ns").join(
        reference.select("problem", other="solved", other_ns="ns"), on="problem"
    )
    test = mcnemar(pairs["solved"].to_numpy(), pairs["other"].to_numpy())
    both = pairs.filter(pl.col("solved") & pl.col("other")).sort("problem")
    mine, other = both["ns"].to_numpy(), both["other_ns"].to_numpy()
    return {
        "pairs": len(pairs), "both": test.both, "only": test.first, "only_reference": test.second, "neither": test.neither,
        "p_solved": test.p if len(pairs) else float("nan"), "ratio": ratio_interval(mine, other),
        "p_time": signed_rank(mine, other),
    }  # fmt: skip
