"""Sections on iteration budgets: comparison of methods, definition of success, summary, and counterparts of the paper."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from benchmarks.blocks.block import quantile, share
from benchmarks.blocks.budgets import PER_RADIAN, SUCCESS_LEVELS, BudgetRows, succeeded, success
from benchmarks.blocks.entries import level_words
from benchmarks.experiments.base import COUNTERPARTS, PAPER_TITLE, UNTESTED
from benchmarks.report import boards
from benchmarks.report.base import KindReport, Run, Section, Winner
from benchmarks.report.boards import Board, Control, add, axis, colour, figure, interval, line, percent_axis, vary
from benchmarks.report.budgets.accuracy import DAMPING_BLOCK, accuracy, damping, damping_table
from benchmarks.report.budgets.default import COMPARED_PROBLEMS, compared_rows, comparisons, default
from benchmarks.report.budgets.maps import maps, picture, sheets_of
from benchmarks.report.page import most_solved
from benchmarks.report.tables import Column, Group, Table, listed, table_of
from optik.registry import short_name

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ENDINGS = {
    "solved": ("solved", colour(2)),
    "max_iterations": ("iteration limit", colour(4)),
    "stalled": ("stalled", colour(1)),
    "time_limit": ("time limit", colour(5)),
    "outside_limits": ("outside joint limits", colour(3)),
    "unreachable": ("proved unreachable", colour(6)),
    "rejected": ("wrong claim of success", colour(7)),
    "too_few_joints": ("fewer joints than task components", colour(0)),
}
"""Ways in which a solve ends: in words, and the colour of each."""

_MM, _DEGREES = pl.col("position_error") * 1e3, pl.col("rotation_error") * PER_RADIAN
"""Errors [mm, °]."""

_SOLVED = pl.col("status") == "solved"
"""Whether a method ended with an answer within its tolerance."""

METHOD_COLUMNS = (
    Column("label", "Method", show="text"),
    Column("count", "targets", show="count"),
    *(
        Column(key, f"{words} {level_words(at)}", "%", "more", "share", among="ranked", of=share(succeeded(at)))
        for key, words, at in (("fine", "solved at", SUCCESS_LEVELS[-1]), ("coarse", "within", SUCCESS_LEVELS[0]))
    ),
    Column("position", "median position error", "mm", "less", among="ranked", of=quantile(_MM, 0.5)),
    Column("position_95", "p95 position error", "mm", "less", among="ranked", of=quantile(_MM, 0.95)),
    Column("iterations", "median iterations, solved", show="count", of=quantile("iterations", 0.5, among=_SOLVED)),
    Column("rotation", "median rotation error", "°", "less", aside=True, among="ranked", of=quantile(_DEGREES, 0.5)),
    Column("rotation_95", "p95 rotation error", "°", "less", aside=True, among="ranked", of=quantile(_DEGREES, 0.95)),
    Column(
        "iterations_95",
        "p95 iterations, solved",
        show="count",
        aside=True,
        of=quantile("iterations", 0.95, among=_SOLVED),
    ),
    Column("ranked", "ranked", show="text", aside=True),
)
"""Columns of a table of methods."""

# ---------------------------------------------------------------- methods


def methods(run: Run) -> dict[str, Any] | None:
    """Show success against budget, how the solves ended, and tables of all blocks."""
    blocks: list[BudgetRows] = run.of("budgets")
    if not blocks:
        return None
    open_ones = {b.block.id for b in comparisons(run)}
    return {
        "boards": [_success_board(blocks, run), _status_board(blocks)],
        "folded": [(method_table(b), b.block.id in open_ones) for b in blocks],
    }


def method_table(b: BudgetRows) -> Table:
    """Return all methods of a block at the largest budget; the best is marked among those that are ranked."""
    compared, who = compared_rows(b)
    last = compared.filter(pl.col("budget") == b.budget)
    groups: list[Group] = []
    for label in b.methods:
        part = last.filter(pl.col("method") == label)
        groups.append(({"label": label, "count": len(part), "ranked": "yes" if label in who.labels else ""}, part))
    total, total_known = b.problems()
    whole = f" {listed(b.whole)}: default settings, with restarts." if b.whole else ""
    return table_of(
        f"budgets-{b.block.id}", b.block.title, METHOD_COLUMNS, groups,
        f"{COMPARED_PROBLEMS} {total_known:,} of {total:,} targets have a known solution. At most {b.budget} iterations from "
        f"the given start.{whole} Errors include failures. Intervals are Wilson's, 95 %.",
    )  # fmt: skip


def _success_board(blocks: list[BudgetRows], run: Run) -> Board:
    budget = axis("iteration budget", type="log", tickvals=[1, 2, 5, 10, 20, 50, 100, 200, 500])
    plots = []
    for level in SUCCESS_LEVELS:
        title, solved = f"Success at {level_words(level)} m and rad", percent_axis("problems solved")
        plot = figure(f"success-{level:.0e}", title, budget, solved)
        for b in blocks:
            _add_success(plot, b, run, level)
        plots.append(plot)
    return Board(
        "success", tuple(plots), (Control.of_blocks(blocks),),
        f"{COMPARED_PROBLEMS} Bars are Wilson 95 % intervals. A run that its budget stops is judged at its last iterate. Level "
        "line: a method with default settings, which has no budget.",
    )  # fmt: skip


def _add_success(plot: Figure, b: BudgetRows, run: Run, level: float) -> None:
    """Draw the success of all methods against the budget, with intervals; a level line where a method has no budget."""
    rows, budgets = compared_rows(b)[0], b.block.budgets
    for label in b.methods:
        part, whole = rows.filter(pl.col("method") == label), label in b.whole
        if part.is_empty():
            continue
        rates = [success(part.filter(pl.col("budget") == n), level) for n in (budgets[-1:] if whole else budgets)]
        rates *= 2 if whole else 1
        words = "default settings" if whole else "budget %{x}"
        trace = line(
            [budgets[0], budgets[-1]] if whole else list(budgets), [r[0] for r in rates], name=label,
            mode="lines" if whole else "lines+markers", marker={"symbol": run.symbol(label), "size": 7},
            line=run.look(label),
            error_y=interval(rates, width=3), hover=f"{label}<br>{words}: %{{y:.1f}} %",
        )  # fmt: skip
        add(plot, trace, {"block": [b.block.id]})


def _status_board(blocks: list[BudgetRows]) -> Board:
    plot = figure(
        "status", "Final status at the largest budget", axis("targets [%]", range=[0, 100]),
        axis("", autorange="reversed", ticks="", type="category"), barmode="stack", bargap=0.35,
    )  # fmt: skip
    colours = dict(ENDINGS.values())
    for b in blocks:
        here = {"block": [b.block.id]}
        vary(plot, here, {"height": 64 + 36 * len(b.methods)})
        for words, counts in _endings(b):
            trace = boards.bars(
                y=b.methods, x=boards.lean([100.0 * n / max(total, 1) for n, total in counts]), customdata=counts, name=words,
                marker={"color": colours.get(words, colour(7))},
                hover=f"%{{y}}<br>{words}: %{{customdata[0]}} of %{{customdata[1]}} targets, %{{x:.1f}} %",
            )  # fmt: skip
            add(plot, trace, here)
    return Board("statuses", (plot,), (Control.of_blocks(blocks),), COMPARED_PROBLEMS)


def _endings(b: BudgetRows) -> list[tuple[str, list[list[int]]]]:
    """Return every ending in words, with its count and the number of targets of each method."""
    last = compared_rows(b)[0].filter(pl.col("budget") == b.budget)
    parts = [last.filter(pl.col("method") == m) for m in b.methods]
    found = []
    for status in dict.fromkeys((*ENDINGS, *sorted(set(last["status"])))):
        counts = [[part.filter(pl.col("status") == status).height, len(part)] for part in parts]
        if any(count for count, _ in counts):
            found.append((ENDINGS.get(status, (status,))[0], counts))
    return found


# ---------------------------------------------------------------- the head of the report


def _terms(run: Run) -> dict[str, Any] | None:
    """Show the tolerances of a solved problem."""
    return {"levels": [level_words(level) for level in SUCCESS_LEVELS]} if run.of("budgets") else None


def _summary(run: Run) -> dict[str, Any] | None:
    """Show problems, robot and methods of every block."""
    blocks = run.of("budgets")
    return {"blocks": [_about(b, run) for b in blocks]} if blocks else None


def _about(b: BudgetRows, run: Run) -> dict[str, Any]:
    total, known = b.problems()
    found = []
    for m in b.block.methods:
        given = b.last.filter(pl.col("method") == m.label).height
        part = "" if given == total else f"; {given:,} of the problems"
        part += "; default settings" if m.whole else ""
        what = f"{short_name(m.name)}, {m.words or 'no options'}{part}"
        found.append({"label": m.label, "colour": run.colour(m.label), "what": what})
    return {
        "id": b.block.id, "title": b.block.title, "set": short_name(b.block.set).replace("_", " "),
        "robot": short_name(b.block.robot), "total": total, "known": known, "methods": found, "budgets": b.block.budgets,
    }  # fmt: skip


def _limitations(run: Run) -> list[str]:
    """List the limitations of rates and iterations."""
    blocks: list[BudgetRows] = run.of("budgets")
    items = [
        "In blocks with iteration budgets every method gets one attempt from the given start, without restarts: the paper's "
        "iteration has none. A method that runs with default settings is marked. These blocks are not timed: times come "
        "from single calls."
    ]
    if any(b.block.set == "graph_paper" for b in blocks):
        items.append(
            "Known solutions of graph-paper targets were searched before the comparison, by lm with 100 restarts and by all "
            "branches of closed_form. It is therefore expected that these two, with default settings, solve all of them. "
            "Random targets are reachable by construction. “No known solution” means that neither the search nor any method "
            "found one; it does not prove that the target is out of reach. All graph-paper targets have the start's "
            "orientation."
        )
    if any(b.rows.group_by("method").agg(pl.col("problem").n_unique())["problem"].n_unique() > 1 for b in blocks):
        items.append(
            "Some methods were run on a subset of the problems. Methods are compared on the targets that all ranked methods "
            "were given. A method that was given far fewer is not ranked: its figures are those of its own targets."
        )
    return items


def _winners(run: Run) -> list[Winner]:
    """Return who solves most targets in one attempt, for each block that compares methods."""
    found = []
    for b in comparisons(run):
        rows, who = compared_rows(b)
        last = rows.filter(pl.col("budget") == b.budget).with_columns(good=succeeded(SUCCESS_LEVELS[-1]))
        labels = [label for label in b.budgeted if label in who.labels]
        solved = {label: last.filter(pl.col("method") == label)["good"].to_numpy() for label in labels}
        if not any(map(len, solved.values())):
            continue
        note = (
            f"{len(solved[labels[0]]):,} targets with a known solution, the same for all, at most {b.budget} iterations, "
            f"within {level_words(SUCCESS_LEVELS[-1])} m and rad{who.left_out}"
        )
        found.append(most_solved(f"Highest success rate in one attempt: {b.block.title}", "budgets", solved, note))
    return found


def _tables(run: Run) -> list[Table]:
    """Return the tables: all methods of every block, and the dampings."""
    found = [method_table(b) for b in run.of("budgets")]
    dampings = damping_table(run)
    return found if dampings is None else [*found, dampings]


# ---------------------------------------------------------------- the paper beside this report


def _paper(run: Run) -> dict[str, Any] | None:
    """Show the counterpart of each figure, equation and claim of the paper in this report, with links."""
    verdicts = {f"claim ({f.key})": f.verdict for f in run.findings}
    if all(verdict == UNTESTED for verdict in verdicts.values()):
        return None
    blocks: list[BudgetRows] = run.of("budgets")
    there = {
        "claims": True, "budgets": blocks, "error": blocks,
        "damping": any(b.block.id == DAMPING_BLOCK for b in blocks),
        "maps": any(sheets_of(b) for b in comparisons(run)),
        **dict.fromkeys(("line", "joints", "laws"), any(b.block.detail for b in run.of("timing"))),
    }  # fmt: skip
    rows = [
        (c._replace(anchor=c.anchor if there.get(c.anchor) else ""), verdicts.get(c.what, "")) for c in COUNTERPARTS
    ]
    return {"title": PAPER_TITLE, "rows": rows}


_TERMS, _SUMMARY, _PAPER = (Path(__file__).with_name(f"{name}.html.j2") for name in ("terms", "summary", "paper"))
"""Templates of a sentence, and of tables with colours or links in their cells."""

REPORT = KindReport(
    (
        Section("Definition of a solved problem", "terms", _terms, _TERMS, 30, place="terms"),
        Section("Problems and methods", "budgets", _summary, _SUMMARY, 30, place="summary"),
        Section("Is the default better than the paper's iteration?", "default", default, order=5),
        Section("Reached spots of the workspace", "picture", picture, order=5, place="top"),
        Section("Methods", "budgets", methods, order=30),
        Section("Error against distance", "error", accuracy, order=40),
        Section("Damping by distance to a singularity", "damping", damping, order=50),
        Section("The workspace: positions and errors (Fig. 10 to 13)", "maps", maps, order=60),
        Section("The paper and this report", "paper", _paper, _PAPER, 98),
    ),
    lambda blocks: ("inverse kinematics",),
    winners=_winners,
    tables=_tables,
    limitations=_limitations,
)
