"""Tables of a block of single calls: success and time, tolerances, equal iterations, paired tests, groups."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import polars as pl

from benchmarks.blocks.block import Of, count, count_of, mean, median, quantile, share
from benchmarks.blocks.calls import FIRST_ROUND_FROM, SHIFT_US, CallRows, ratio_where_solved
from benchmarks.blocks.entries import JUDGED_AT, level_name, solved_at
from benchmarks.records import slug
from benchmarks.report.tables import Cell, Column, Group, Table, listed, table_of
from benchmarks.statistics import holm, is_too_few, mcnemar, ratio_interval, shifted_geometric_mean, signed_rank
from optik.ik import Tolerance
from optik.registry import short_name
from optik.types import Array

LABEL = Column("label", "Method", show="text")
"""First column of every table."""

PROBLEM_COUNT = Column("count", "problems", show="count")
"""Second column of every table with rates."""

GIVEN = Column("given", "given the largest number of problems", show="text", aside=True)
"""Whether a method was given the largest number of problems; no value of the others is marked as the best of its column."""

FALSE_CLAIM = pl.col("claimed").fill_null(value=False) & ~pl.col("solved")
"""Whether a method claims success for an answer that is none."""


def block_tables(b: CallRows) -> list[Table]:
    """Return all tables of a block."""
    found = (success_and_time(b), _at_tolerances(b), _at_iterations(b), _paired(b), _by_group(b))
    return [table for table in found if table is not None]


def _table(
    b: CallRows, ending: str, title: str, columns: Iterable[Column], note: str,
    *, given: Callable[[str], dict[str, Cell]] = lambda label: {}, parts: Mapping[str, pl.DataFrame] | None = None,
    absent: str = "",
) -> Table:  # fmt: skip
    """Return a table with a row for each method, or the reason for its absence; the best is marked on equal problems."""
    first, *others = (replace(column, among=GIVEN.key) if column.better else column for column in columns)
    found = b.by_method if parts is None else parts
    counts = {label: part["problem"].n_unique() for label, part in found.items()}
    most = max(counts.values(), default=0)
    groups: list[Group] = []
    for label in b.entries:
        row: dict[str, Cell] = {"label": label, first.key: b.why_not(label)[0] or absent}
        if label in found:
            row = given(label)
            row |= {"label": label, "count": counts[label], GIVEN.key: "yes" if counts[label] == most else ""}
        groups.append((row, found.get(label)))
    columns = (LABEL, PROBLEM_COUNT, first, *others, GIVEN)
    return table_of(f"calls-{slug(b.block.id)}{ending}", f"{b.block.title}: {title}", columns, groups, note)


def _us(rows: pl.DataFrame) -> Array:
    """Return the times of calls [µs]."""
    return rows["ns"].to_numpy() / 1e3


def _where_known(column: str, of: Of) -> Of:
    """Return a computation whose value is None where a method says nothing about a column."""
    return lambda part: None if part[column].is_null().all() else of(part)


def _outcome(word: str) -> Of:
    return count(pl.col("outcome") == word)


false_claims = _where_known("claimed", count(FALSE_CLAIM))
changed_input = count("changed_input")


def first_round(part: pl.DataFrame) -> float:
    """Return the first call over the median call, the median over the problems."""
    return float(part["first_round"][0])


def success_and_time(b: CallRows) -> Table:
    """Return the success rate, and the times of the calls that solved apart from those that did not."""
    us, no, reference = "µs", ~pl.col("solved"), b.block.reference
    spread = median((pl.col("most_ns") - pl.col("least_ns")) / pl.col("ns"), 100.0)
    columns = (
        Column("solved", "solved", "%", "more", "share", of=share("solved")),
        Column("median", "median time, solved", us, "less", of=quantile(_us, 0.5, among="solved")),
        Column("p95", "p95, solved", us, "less", of=quantile(_us, 0.95, among="solved")),
        Column("p99", "p99, solved", us, "less", of=quantile(_us, 0.99, among="solved")),
        Column("failed_median", "median time, not solved", us, of=quantile(_us, 0.5, among=no)),
        Column("ratio", f"time ratio to {reference}, solved by both", "", "less",
               of=lambda part: ratio_where_solved(b.rows, str(part["method"][0]), reference)),
        Column("false_claims", "false success claims", "", "less", "count", of=false_claims),
        Column("max", "longest, solved", us, "less", aside=True, of=quantile(_us, 1.0, among="solved")),
        Column("failed", "not solved", show="count", aside=True, of=count(no)),
        Column("failed_p95", "p95, not solved", us, aside=True, of=quantile(_us, 0.95, among=no)),
        Column("failed_p99", "p99, not solved", us, aside=True, of=quantile(_us, 0.99, among=no)),
        Column("failed_max", "longest, not solved", us, aside=True, of=quantile(_us, 1.0, among=no)),
        Column("mean", "mean time, all", us, aside=True, of=mean(_us)),
        Column("shifted", f"shifted geometric mean, all (shift {SHIFT_US:g} µs)", us, aside=True,
               of=lambda part: shifted_geometric_mean(_us(part), SHIFT_US)),
        Column("cpu", "CPU time / wall time, all", "", "less", aside=True,
               of=_where_known("cpu_ns", lambda part: float(part["cpu_ns"].sum()) / float(part["ns"].sum()))),
        Column("none", "no answer", show="count", aside=True, of=_outcome("none")),
        *(Column(key, key, show="count", aside=True, of=_outcome(key)) for key in ("raised", "crashed", "refused")),
        Column("iterations", "mean iterations", aside=True, of=mean("iterations")),
        Column("restarts", "mean restarts", aside=True, of=mean("restarts")),
        Column("noise", "spread between rounds, median", "%", aside=True,
               of=lambda part: spread(part) if (part["most_ns"] != part["least_ns"]).any() else None),
        Column("first_round", "first call / median call, median over problems", aside=True, of=first_round),
        Column("changed_input", "changed input", "", "less", "count", aside=True, of=changed_input),
        Column("varies", "varies between runs with", show="text", aside=True),
        Column("build", "building", "ms", "less", aside=True),
    )  # fmt: skip

    def given(label: str) -> dict[str, Cell]:
        about = b.entries[label]
        seconds = about.get("build_seconds")
        return {"varies": _varies(about), "build": None if seconds is None else 1e3 * seconds}

    return _table(b, "", "success rate and time of a call", columns, _note(b), given=given)


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
    for outcome, first in (("raised", ", first"), ("crashed", "")):
        if number := _outcome(outcome)(part):
            reasons = part.filter(pl.col("outcome") == outcome)["error"].drop_nulls()
            reason = " ".join(reasons[0].split()) if len(reasons) else "no reason recorded"
            yield f"{outcome} in {number:,} of {len(part):,} calls{first}: {reason}"
    if claimed := false_claims(part):
        far = count_of(part, pl.col("claimed").fill_null(value=False) & ~solved_at(JUDGED_AT[0]))
        beyond = f"outside the limits or more than {level_name(JUDGED_AT[0])} m or rad off"
        yield f"claimed success for {claimed:,} wrong answers, {far:,} of them {beyond}"
    if changed := changed_input(part):
        yield f"changed its input in {changed:,} calls; each call gets copies"
    if (times := first_round(part)) > FIRST_ROUND_FROM:
        yield f"took {times:.1f} times as long in its first round (median over the problems): its time is that round's"
    if varies:
        yield f"varies between runs with {varies}"


def _at_tolerances(b: CallRows) -> Table:
    """Return the success rates at several tolerances, with the settings of each method."""
    names = {level: level_name(level) for level in JUDGED_AT}
    columns = [
        *(
            Column(f"at{name}", f"within {name} m and rad", "%", "more", "share", of=share(solved_at(level)))
            for level, name in names.items()
        ),
        Column(
            "position", "median position error, solved", "m", "less", of=quantile("position_error", 0.5, among="solved")
        ),
        Column(
            "rotation",
            "median rotation error, solved",
            "rad",
            "less",
            of=quantile("rotation_error", 0.5, among="solved"),
        ),
        Column("settings", "set to", show="text"),
    ]

    def given(label: str) -> dict[str, Cell]:
        words, ours = b.entries[label]["settings"], b.entries[label]["kind"] != "peer"
        stops = f"; stops within {level_name(Tolerance().position)} m and rad"
        return {"settings": words + (stops if ours else "")}

    note = (
        "Judged by optik's forward kinematics inside the limits, not by a method's own claim. A method stops at its own "
        "tolerance: the finest column shows what it reaches with these settings."
    )
    return _table(b, "-tolerance", "tolerances", columns, note, given=given)


def _at_iterations(b: CallRows) -> Table | None:
    """Return the success rates of one attempt at each iteration limit."""
    if b.evaluations is None:
        return None
    columns = [
        Column(f"n{n}", f"{n} iterations", "%", "more", "share", of=share("solved", among=pl.col("budget") == n))
        for n in b.block.evaluation_budgets
    ]
    parts = {str(label): part for (label,), part in b.evaluations.partition_by("method", as_dict=True).items()}
    note = (
        "One attempt from the given start, without restarts, stopped after this number of iterations. For most methods an "
        "iteration is one Jacobian and one step, for some a whole quadratic programme; a closed form has none. To compare "
        "speed, use the plot of success against time."
    )
    title = "equal numbers of iterations"
    return _table(b, "-iterations", title, columns, note, parts=parts, absent="no iteration limit")


def _by_group(b: CallRows) -> Table | None:
    """Return the success rate of each method on each group of the problem set."""
    groups = [str(group) for group in b.rows["group"].unique().sort()]
    if len(groups) < 2 or b.rows["solved"].all():
        return None
    most = dict(b.rows.group_by("group", "method").len().group_by("group").agg(pl.col("len").max()).iter_rows())
    columns = [
        Column(f"g{i}", f"{g} (n = {most[g]:,})", "%", "more", "share", of=share("solved", among=pl.col("group") == g))
        for i, g in enumerate(groups)
    ]
    note = "n: problems of the methods that were given all. Intervals are Wilson's, 95 %."
    return _table(b, "-groups", "solved, by kind of problem", columns, note)


def _paired(b: CallRows) -> Table | None:
    """Return each method against the first, on the problems that both were given."""
    reference = b.block.reference
    others = [label for label in b.by_method if label != reference]
    if reference not in b.by_method or not others:
        return None
    pairs = [_pair(b.by_method[label], b.by_method[reference]) for label in others]
    few = [label for label, cells in zip(others, pairs, strict=True) if is_too_few(cells.pop("pairs"), len(others))]
    for key in ("p_solved", "p_time"):
        for cells, p in zip(pairs, holm([cells[key] for cells in pairs]), strict=True):
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
    rows = tuple({"label": label} | cells for label, cells in zip(others, pairs, strict=True))
    return Table(f"calls-{slug(b.block.id)}-pairs", f"{b.block.title}: paired tests", columns, rows, note)


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
