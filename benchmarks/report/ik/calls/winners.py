"""Who wins on a block of single calls: most targets solved; shortest time among those that solve as many."""

from __future__ import annotations

from collections.abc import Sequence

import polars as pl

from benchmarks.blocks.ik.calls.measures import shared
from benchmarks.blocks.ik.calls.rows import CallRows
from benchmarks.report.base import Winner
from benchmarks.report.ik.calls.cells import share_cell
from benchmarks.report.ranked import ranked
from benchmarks.report.run import Run
from benchmarks.statistics import median_interval, not_beaten, not_longer


def winners(run: Run) -> Sequence[Winner]:
    """Two questions for each block that compares methods."""
    blocks = [b for b in run.of("calls") if len(b.by_method) > 1 and not b.unreachable]
    return [winner for b in blocks for winner in block_winners(b)]


def block_winners(b: CallRows) -> list[Winner]:
    """Who solves most, and who is fastest among those that McNemar's test does not tell from the best.

    Methods are compared on the problems that all of them were given, times on those that all of them solved as well.
    """
    who = ranked({label: len(part) for label, part in b.by_method.items()})
    rows = shared(b.rows, who.labels).sort("problem")
    if rows.is_empty():
        return []
    parts = {label: rows.filter(pl.col("method") == label) for label in who.labels}
    problems = _problems(parts[who.labels[0]], b.facts["count"])
    solved = [(label, *share_cell(int(part["solved"].sum()), len(part))) for label, part in parts.items()]
    solved.sort(key=lambda e: (-e[1], -e[2]))
    level = not_beaten(
        solved[0][0], {label: dict(part.select("problem", "solved").iter_rows()) for label, part in parts.items()}
    )
    most = Winner(
        f"Highest success rate: {b.block.title}", "%", "more", tuple(solved), "speed",
        f"{problems}{who.left_out}", "Wilson 95 % intervals; differences by McNemar's test", level,
        len(parts[who.labels[0]]),
    )  # fmt: skip
    fastest = _fastest(b, rows, level)
    return [most] if fastest is None else [most, fastest]


def _fastest(b: CallRows, rows: pl.DataFrame, labels: tuple[str, ...]) -> Winner | None:
    """The shortest median time on the problems that all of some methods solved."""
    both = shared(rows.filter("solved"), labels)
    if len(labels) < 2 or both["method"].n_unique() < len(labels):
        return None
    us = {label: both.filter(pl.col("method") == label)["ns"].to_numpy() / 1e3 for label in labels}
    times = sorted(((label, *median_interval(x)) for label, x in us.items()), key=lambda entry: entry[1])
    return Winner(
        f"Fastest among equally successful methods: {b.block.title}", "µs", "less", tuple(times), "speed",
        f"median time of a call on the {both['problem'].n_unique():,} problems solved by all of them",
        "bootstrap 95 % intervals; differences by Wilcoxon's signed-rank test", not_longer(times[0][0], us),
        len(us[labels[0]]),
    )  # fmt: skip


def _problems(part: pl.DataFrame, count: int) -> str:
    """Which problems are compared: how many of how many, and of how many a solution is known."""
    words = f"the same {len(part):,}{f' of {count:,}' if len(part) < count else ''} problems for all"
    known = int(part["known"].sum())
    if known == len(part):
        return f"{words}, each with a known solution"
    return f"{words}, {known:,} of them with a known solution"
