"""Section on single calls: plots and tables of success and time, and who wins."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from benchmarks.blocks.block import values_of
from benchmarks.blocks.calls import FIRST_ROUND_FROM, CallRows
from benchmarks.blocks.entries import shared
from benchmarks.report import boards
from benchmarks.report.base import KindReport, Run, Section, Winner
from benchmarks.report.boards import Board, Control, Sample, add, figure, fraction_plot, log_axis, percent_axis, vary
from benchmarks.report.budgets.default import has_same_problems
from benchmarks.report.calls.tables import LABEL, block_tables
from benchmarks.report.page import most_solved, rank_methods
from benchmarks.report.tables import VERSION_COLUMNS, Cell, Table, version_cells
from benchmarks.statistics import median_interval, not_longer, percentage
from optik.types import Array

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

PLOT_ROOM = 0.03
"""Margin beside the curves, as a fraction of the width of a plot [1]."""

LEAST_ERROR = 1e-12
"""Errors below this [m, rad] are drawn here: they are rounding, not a result."""

SIGMA_BINS = 12
"""Bins of the smallest singular value, each as wide as the others on a logarithmic axis."""

FEWEST_IN_BIN = 10
"""Least number of problems in a bin with a plotted rate: with fewer it is not informative."""


def _board(id: str, blocks: list[CallRows], run: Run, plots: tuple[Figure, ...], caption: str) -> Board:
    return Board(id, plots, (Control.of_blocks(blocks),), caption)


def _samples(blocks: list[CallRows], run: Run, values: Callable[[CallRows, str], ArrayLike]) -> Iterator[Sample]:
    """Yield the values of each method of each block."""
    for b in blocks:
        for label in b.by_method:
            yield Sample(label, values(b, label), run.look(label), {"block": [b.block.id]})


SOLVED_NS = pl.when("solved").then(pl.col("ns").cast(pl.Float64)).otherwise(np.inf)
"""Time of a call that solved [ns], infinite for others."""


def success_in_time(blocks: list[CallRows], run: Run) -> Board:
    """Return the percentage of all problems that each method has solved within a time."""
    across = log_axis("time budget of a call [µs]", dtick=1)
    samples = _samples(blocks, run, lambda b, label: b.by_method[label].select(SOLVED_NS / 1e3).to_series())
    hover = "%{y:.4~g} % solved within %{x:.3g} µs"
    plot = fraction_plot("success-time", "Success against time budget", across, "problems solved", hover, samples, 420)
    for b in blocks:
        us = values_of(b.rows.filter("solved"), SOLVED_NS / 1e3)
        if len(us):
            vary(plot, {"block": [b.block.id]}, {"xaxis": {"range": _widened(np.log10(us.min()), np.log10(us.max()))}})
    caption = (
        "Percentage of all problems solved by a call within this time. A curve ends at its method's success rate. The time of "
        "a call is the median of its rounds."
    )
    return _board("success-time-board", blocks, run, (plot,), caption)


def _widened(low: float, high: float) -> list[float]:
    """Return a range with margins at both ends, so that no curve ends at the frame."""
    room = max(PLOT_ROOM * (high - low), 0.05)
    return [low - room, high + room]


def profiles(blocks: list[CallRows], run: Run) -> Board:
    """Return performance profiles: problems solved within a multiple of the fastest method's time there."""
    ratios = {b.block.id: profile_ratios(b.rows, tuple(b.by_method)) for b in blocks}
    samples = _samples(blocks, run, lambda b, label: ratios[b.block.id][label])
    across = log_axis("time / least time of any method on the same problem", dtick=1)
    hover = "%{y:.4~g} % within %{x:.3g} times the least"
    plot = fraction_plot("call-profile", "Performance profile", across, "problems solved", hover, samples)
    caption = (
        "On the problems that all methods were given (Dolan and Moré 2002). At 1: how often a method is the fastest that "
        "solves; at the right end: its success rate. The profile compares each method with the best one only."
    )
    return _board("call-profile-board", blocks, run, (plot,), caption)


def profile_ratios(rows: pl.DataFrame, labels: tuple[str, ...]) -> dict[str, Array]:
    """Return the time of each method over the least of any, on each problem that all were given; infinite if unsolved."""
    least = SOLVED_NS.min().over("problem")
    both = shared(rows, labels).with_columns(ratio=pl.when("solved").then(SOLVED_NS / least).otherwise(np.inf))
    return {label: both.filter(pl.col("method") == label).sort("problem")["ratio"].to_numpy() for label in labels}


def errors(blocks: list[CallRows], run: Run) -> Board:
    """Return distributions of the errors of answers inside the limits, of position and of rotation."""

    def plot(what: str, unit: str) -> Figure:
        inside = pl.when("inside").then(pl.col(f"{what}_error").clip(LEAST_ERROR)).otherwise(np.inf)
        return fraction_plot(
            f"call-{what}", f"Percentage of problems with at most this {what} error",
            log_axis(f"{what} error [{unit}]", dtick=3), "problems", f"%{{y:.4~g}} % within %{{x:.2g}} {unit}",
            _samples(blocks, run, lambda b, label: b.by_method[label].select(inside).to_series()), 360,
        )  # fmt: skip

    caption = f"Answers inside the limits, by optik's forward kinematics. The least error shown is {LEAST_ERROR:g}."
    return _board("call-errors-board", blocks, run, (plot("position", "m"), plot("rotation", "rad")), caption)


def against_singularity(blocks: list[CallRows], run: Run) -> Board | None:
    """Return the percentage solved against the smallest singular value at the solution that generated the target."""
    known = [b for b in blocks if b.rows["sigma"].is_finite().any() and not b.rows["solved"].all()]

    across, percent = log_axis("smallest singular value at the solution", dtick=1), percent_axis("problems solved")
    plot = figure("call-sigma", "Success against the smallest singular value", across, percent, 380)
    for b in known:
        for label, part in b.by_method.items():
            rates = by_sigma(part, _singular_edges(b.rows))
            add(plot, boards.line(
                [r[0] for r in rates], [r[1] for r in rates], digits=6, mode="lines+markers", name=label,
                text=[f"{y:.4g} % [{low:.4g}, {high:.4g}] of {n:,}" for _, y, low, high, n in rates],
                line=run.look(label) | {"shape": "hv"}, hover=f"{label}<br>%{{text}}",
            ), {"block": [b.block.id]})  # fmt: skip
    caption = (
        f"{SIGMA_BINS} bins of equal width on this axis; bins with fewer than {FEWEST_IN_BIN} problems are omitted. Hover for "
        "the Wilson intervals."
    )
    drawn = any(len(trace.x) for trace in plot.data)
    return _board("call-sigma-board", known, run, (plot,), caption) if drawn else None


def _singular_edges(rows: pl.DataFrame) -> Array:
    """Return the edges of the bins of the smallest singular value."""
    sigma = np.maximum(rows.filter(pl.col("sigma").is_finite())["sigma"].to_numpy(), LEAST_ERROR)
    return np.geomspace(sigma.min(), sigma.max() * (1.0 + 1e-9), SIGMA_BINS + 1)


def by_sigma(part: pl.DataFrame, edges: Array) -> list[tuple[float, float, float, float, int]]:
    """Return the middle, the percentage solved with its interval and the count of every bin with enough problems."""
    own = part.filter(pl.col("sigma").is_finite())
    number = np.searchsorted(edges, np.maximum(own["sigma"].to_numpy(), LEAST_ERROR), side="right") - 1
    solved, found = own["solved"].to_numpy(), []
    for i in range(len(edges) - 1):
        count = int((number == i).sum())
        if count >= FEWEST_IN_BIN:
            rate = percentage(int(solved[number == i].sum()), count)
            found.append((float(np.sqrt(edges[i] * edges[i + 1])), *rate, count))
    return found


def tables(run: Run) -> list[Table]:
    """Return the tables of all blocks, and one of the compared methods."""
    found: list[Table] = []
    for b in run.of("calls"):
        first, *others = block_tables(b)
        wider = [m.block.title for m in run.of("budgets") if has_same_problems(m.block, b.block)]
        if wider:
            words = f"The rates here are those of the timed calls; those of one attempt are in “{wider[0]}”."
            first = replace(first, note=f"{first.note} {words}")
        found += [first, *others]
    return [*found, _compared(run)] if found else []


def _compared(run: Run) -> Table:
    """Return every method and peer once, or several times if its settings differ between blocks."""
    found: dict[tuple[str, str], dict[str, Cell]] = {}
    for b in run.of("calls"):
        for label, about in b.entries.items():
            found.setdefault((label, about["settings"]), {"label": label} | version_cells(about))
    return Table("calls-compared", "Versions and settings", (LABEL, *VERSION_COLUMNS), tuple(found.values()))


# ---------------------------------------------------------------- who wins


def winners(run: Run) -> list[Winner]:
    """Answer two questions for each block that compares methods."""
    blocks = [b for b in run.of("calls") if len(b.by_method) > 1 and not b.unreachable]
    return [winner for b in blocks for winner in block_winners(b)]


def block_winners(b: CallRows) -> list[Winner]:
    """Return two winners: the method that solves most, and the fastest method not significantly different from it.

    Methods are compared on the problems that all of them were given, times on those that all of them solved as well.
    """
    who = rank_methods({label: len(part) for label, part in b.by_method.items()})
    rows = shared(b.rows, who.labels).sort("problem")
    if rows.is_empty():
        return []
    parts = {label: rows.filter(pl.col("method") == label) for label in who.labels}
    solved = {label: part["solved"].to_numpy() for label, part in parts.items()}
    note = f"{_problems(parts[who.labels[0]], b.facts['count'])}{who.left_out}"
    most = most_solved(f"Highest success rate: {b.block.title}", "calls", solved, note)
    fastest = _fastest(b, rows, most.tied)
    return [most] if fastest is None else [most, fastest]


def _fastest(b: CallRows, rows: pl.DataFrame, labels: tuple[str, ...]) -> Winner | None:
    """Return the shortest median time on the problems that all of some methods solved."""
    both = shared(rows.filter("solved"), labels)
    if len(labels) < 2 or both["method"].n_unique() < len(labels):
        return None
    us = {label: both.filter(pl.col("method") == label)["ns"].to_numpy() / 1e3 for label in labels}
    times = sorted(((label, *median_interval(x)) for label, x in us.items()), key=lambda entry: entry[1])
    return Winner(
        f"Fastest among equally successful methods: {b.block.title}", "µs", "less", tuple(times), "calls",
        f"median time of a call on the {both['problem'].n_unique():,} problems solved by all of them",
        "bootstrap 95 % intervals; differences by Wilcoxon's signed-rank test", not_longer(times[0][0], us),
        len(us[labels[0]]),
    )  # fmt: skip


def _problems(part: pl.DataFrame, count: int) -> str:
    """Describe the compared problems: how many of how many, and how many with a known solution."""
    words = f"the same {len(part):,}{f' of {count:,}' if len(part) < count else ''} problems for all"
    known = int(part["known"].sum())
    if known == len(part):
        return f"{words}, each with a known solution"
    return f"{words}, {known:,} of them with a known solution"


# ---------------------------------------------------------------- sections

TIMING_RULES = (
    "A call solves one target from one start. Its time includes the way from Python and back. It runs on one thread unless the "
    "method starts threads of its own. optik's forward kinematics judges every answer: solved means errors of at most 10⁻⁶ m "
    "and 10⁻⁶ rad with every joint inside its limits. If a peer returns several branches, one solution among them suffices; "
    "full turns are added where they bring a joint inside its limits. Slow methods are given fewer problems; a ratio of "
    "medians is computed on the problems that both methods were given. Building time includes the first import of a package."
)
"""Rules of timing and judging calls."""

LIMITATIONS_OF_CALLS = (
    "Calls are timed in a loop over different targets, with code and tables in the processor's caches. A single call "
    "after other work takes longer. The garbage collector is off during timing.",
    "Every round has the same problems. If the first call of a problem typically takes more than "
    f"{FIRST_ROUND_FROM:g} times the median of the method's calls of it (median over the problems), the method's time is "
    "that of its first round, and the note below the table names it.",
    "Closed-form peers compute every branch, our methods one solution near the start. A peer that starts threads is "
    "timed with them. Peers have the settings that served them best on the paper's arm; their rows state them.",
)
"""Limitations of the figures."""


def _success_plot(run: Run) -> dict[str, Any] | None:
    """Show success against time budget, for the first screen."""
    blocks = run.of("calls")
    return {"boards": [success_in_time(blocks, run)]} if blocks else None


def _calls(run: Run) -> dict[str, Any] | None:
    """Show performance profiles, errors and singular values, tables of every block, and the compared methods."""
    blocks = run.of("calls")
    if not blocks:
        return None
    shown = [profiles(blocks, run), errors(blocks, run), against_singularity(blocks, run)]
    return {"boards": [board for board in shown if board is not None], "tables": run.tables_of("calls")}


def _rules(run: Run) -> dict[str, Any]:
    """Show how calls are timed."""
    return {"how": "Timing of calls", "prose": [TIMING_RULES]}


REPORT = KindReport(
    (
        Section("Success against time budget", "calls", _success_plot, order=11, place="top"),
        Section("Speed of one call", "calls", _calls, order=11),
        Section("Speed of one call", "calls", _rules, order=19),
    ),
    lambda blocks: ("inverse kinematics, call by call",),
    winners=winners,
    tables=tables,
    limitations=lambda run: LIMITATIONS_OF_CALLS,
)
