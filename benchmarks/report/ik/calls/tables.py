"""Tables of a block of single calls: equal time, tolerances, equal iterations, and failures by group."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import polars as pl

from benchmarks.blocks.ik.calls.judgement import JUDGED_AT, level_name, solved_at
from benchmarks.records import slug
from benchmarks.report.base import Column, Table
from benchmarks.report.ik.calls.cells import GIVEN, LABEL, compared_columns, entry_rows, share_cell
from benchmarks.report.ik.calls.pairs import paired
from benchmarks.report.ik.calls.success import success_and_time
from benchmarks.statistics import quantiles
from optik.ik import Tolerance

if TYPE_CHECKING:
    from benchmarks.blocks.ik.calls.rows import CallRows
    from benchmarks.report.base import Cell

TIME_BUDGETS_US = (10.0, 30.0, 100.0, 1e3, 1e4, 1e5)
"""Times within which a call must have its answer in the table of equal time [µs]: a control cycle has 1,000."""


def block_tables(b: CallRows) -> tuple[Table, ...]:
    """All tables of a block."""
    found = (success_and_time(b), within_time(b), at_tolerances(b), at_iterations(b), paired(b), by_group(b))
    return tuple(table for table in found if table is not None)


def within_time(b: CallRows) -> Table:
    """Return the fraction of problems solved by a call within each time budget."""
    columns = [
        Column(f"us{budget:g}", f"within {_time_words(budget)}", "%", "more", "share") for budget in TIME_BUDGETS_US
    ]

    def cells(label: str, part: pl.DataFrame) -> dict[str, Cell]:
        us, solved = part["ns"].to_numpy() / 1e3, part["solved"].to_numpy()
        return {f"us{t:g}": share_cell(int((solved & (us <= t)).sum()), len(part)) for t in TIME_BUDGETS_US}

    rows = entry_rows(b, columns[0].key, cells)
    note = (
        "Percentage of all problems. All methods have default settings and do not know the time limit; later answers do not "
        "count."
    )
    return Table(
        f"speed-{slug(b.block.id)}-time",
        f"{b.block.title}: equal time",
        compared_columns((LABEL, *columns)),
        rows,
        note,
    )


def _time_words(us: float) -> str:
    return f"{us:g} µs" if us < 1e3 else f"{us / 1e3:g} ms"


def at_tolerances(b: CallRows) -> Table:
    """Return the success rates at several tolerances, with the settings of each method."""
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
        "Judged by optik's forward kinematics inside the limits, not by a method's own claim. A method stops at its own "
        "tolerance: the finest column shows what it reaches with these settings."
    )
    rows = entry_rows(b, f"at{level_name(JUDGED_AT[0])}", cells)
    return Table(
        f"speed-{slug(b.block.id)}-tolerance", f"{b.block.title}: tolerances", compared_columns(columns), rows, note
    )


def at_iterations(b: CallRows) -> Table | None:
    """Return the success rates of one attempt at each iteration limit."""
    answers = b.evaluations
    if answers is None:
        return None
    budgets = b.block.evaluation_budgets
    columns = [Column(f"n{n}", f"{n} iterations", "%", "more", "share") for n in budgets]
    rows: list[Mapping[str, Cell]] = []
    most = int(answers.group_by("method", "budget").len()["len"].max() or 0)  # type: ignore[arg-type]
    for label in b.entries:
        mine = answers.filter(pl.col("method") == label)
        count = len(mine) // len(budgets)
        row: dict[str, Cell] = {"label": label, GIVEN.key: "yes" if count == most else ""}
        if mine.is_empty():
            row[columns[0].key] = b.why_not(label)[0] or "no iteration limit"
        for (n,), part in mine.group_by("budget"):
            row[f"n{n}"] = share_cell(int(part["solved"].sum()), len(part))
        rows.append(row)
    note = (
        "One attempt from the given start, without restarts, stopped after this number of iterations. For most methods an "
        "iteration is one Jacobian and one step, for some a whole quadratic programme; a closed form has none. To compare "
        "speed, use the table of equal time."
    )
    title = f"{b.block.title}: equal numbers of iterations"
    return Table(f"speed-{slug(b.block.id)}-iterations", title, compared_columns((LABEL, *columns)), tuple(rows), note)


# ---------------------------------------------------------------- failures by group


def by_group(b: CallRows) -> Table | None:
    """Problems that each method did not solve, by the groups of the problem set."""
    groups = [str(group) for group in b.rows["group"].unique().sort()]
    if len(groups) < 2 or b.rows["solved"].all():
        return None
    columns = [Column(f"g{i}", group, "%", "more", "share") for i, group in enumerate(groups)]

    def cells(label: str, part: pl.DataFrame) -> dict[str, Cell]:
        counts = {
            str(g): (s, n) for g, s, n in part.group_by("group").agg(pl.col("solved").sum(), pl.len()).iter_rows()
        }
        return {f"g{i}": share_cell(*counts[group]) if group in counts else None for i, group in enumerate(groups)}

    rows = entry_rows(b, columns[0].key, cells)
    title = f"{b.block.title}: solved, by kind of problem"
    return Table(
        f"speed-{slug(b.block.id)}-groups",
        title,
        compared_columns((LABEL, *columns)),
        rows,
        "Intervals are Wilson's, 95 %.",
    )
