"""Section of the report on time laws on many lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.entries import JOINT_LIMITS
from benchmarks.blocks.timing.rows import in_group
from benchmarks.blocks.timing.settings import GIVEN_LINE, LINE_KINDS, LawBlock, LimitSet
from benchmarks.report.base import KindReport, Run, Section, Winner
from benchmarks.report.page import rank_methods
from benchmarks.report.tables import listed, number, quote_label
from benchmarks.report.timing import line, tables
from benchmarks.report.timing.joints import motion
from benchmarks.report.timing.line import broken_limits, detailed, law_table, limits_of, line_in_space, solved_of
from benchmarks.report.timing.tables import compared, durations, law_tables, plan_times, torques, violations
from benchmarks.statistics import median_interval, not_longer
from optik.registry import short_name
from optik.types import Array
from planners.limits import FIELD_LIMITS, kind_of


def timing(run: Run) -> dict[str, Any] | None:
    """Show for every block plots, a table for each kind of line, limit violations, whole plans, and one line in detail."""
    blocks = [_block(b, run) for b in run.of("timing") if not b.block.detail]
    return {"blocks": blocks} if blocks else None


def _block(b: BlockRows, run: Run) -> dict[str, Any]:
    block = b.block
    return {
        "id": block.id, "title": block.title, "samples": block.samples, "rounds": block.rounds,
        "solver": listed(map(short_name, block.solvers)),
        "limits": [limit_words(part) for part in block.limits], "reference": _reference(b),
        "done": b.rows["line"].n_unique(), "count": sum(part.count for part in block.lines),
        "sets": [(part.arm, part.kind.replace("_", "-"), part.count) for part in block.lines],
        "boards": [board for board in (durations(b, run), torques(b, run)) if board is not None],
        "tables": law_tables(b),
        "others": [table for table in (violations(b), plan_times(b), compared(b)) if table is not None],
        "example": tables.example_boards(b, run),
    }  # fmt: skip


def limit_words(part: LimitSet) -> str:
    """Describe a set of limits."""
    own = listed([name.replace("_", " ") for name in part.own])
    words = [f"{own} of the robot"] if own else []
    for kind in FIELD_LIMITS:
        value = part.limits.value(kind.name)
        if value is not None:
            each = ", ".join(f"{x:g}" for x in np.atleast_1d(value).ravel())
            words.append(f"{kind.name.replace('_', ' ')} {each} {kind.units[0]}")
    for name, value in part.extra.items():
        if name not in part.own:
            fields = value.items() if isinstance(value, dict) else [(value, kind_of(name).units[0])]
            words.append(f"{name.replace('_', ' ')} {', '.join(f'{k} {v}' for k, v in fields)}")
    return f"{quote_label(part.label)} ({'; '.join(words)})"


def _reference(b: BlockRows) -> str:
    entry = b.block.reference
    if entry is None:
        return ""
    return f"{entry.name} ({entry.words})" if entry.words else str(entry.name)


DECIDED_BY = (
    "bootstrap 95 % intervals; differences by Wilcoxon's signed-rank test, for which fewer than six motions are too few"
)
"""Rule of the ranking in words."""

OF_T = "T* is the shortest known duration of a path"
"""Definition, at the first use of T* on a page."""
FEWEST_SHARED = 5
"""Least number of motions for a ranking of laws: with fewer a median is not informative."""


def winners(run: Run) -> Sequence[Winner]:
    """Return two questions for each kind of line of each block."""
    found = [winner for b in run.of("timing") for kind in b.block.kinds for winner in kind_winners(b, kind)]
    return found + [winner for b in run.of("timing") if b.block.detail for winner in _line_winner(b)]


def _line_winner(b: BlockRows) -> list[Winner]:
    """Return the law with the shortest motion along the one motion of a block, among those that respect every limit."""
    solved = solved_of(b)
    within = [row for row in solved if not broken_limits(row)]
    if not within:
        return []
    entries = [(row["method"], *(row["duration"],) * 3) for row in within]
    out = [row["method"] for row in solved if row not in within]
    note = f"one line of {number(1e3 * within[0]['length'])} mm, exact durations"
    return [
        Winner(
            "Shortest motion along the line within every limit", "s", "less",
            tuple(sorted(entries, key=lambda entry: entry[1])), "laws",
            note + (f"; not ranked (limit exceeded): {listed(out)}" if out else ""),
        )
    ]  # fmt: skip


def kind_winners(b: BlockRows, kind: str) -> list[Winner]:
    """Return the law with the shortest motions on a kind of line, and the fastest to compute of those equally short.

    Ranked are laws whose jerk is bounded, so that any motion can be slowed until it keeps the limits, and which stay on the
    path. All are compared on the motions that all of them were asked for.
    """
    rows = in_group(b.rows, kind).filter(pl.col("method").is_in(list(b.entries)))
    able, unable = _rankable(b, rows)
    who = rank_methods({label: rows.filter(pl.col("method") == label).height for label in able})
    rows = rows.filter(pl.col("method").is_in(who.labels))
    rows = rows.filter(pl.len().over("line", "problem") == len(who.labels)).sort("line", "problem")
    count = len(rows) // max(len(who.labels), 1)
    if len(who.labels) < 2 or count < FEWEST_SHARED:
        return []
    parts = {label: rows.filter(pl.col("method") == label) for label in who.labels}
    note = f"medians of the same {count:,} motions for all"
    where, note = f"{b.block.title}, {kind.replace('_', '-')}", note + unable + who.left_out
    lengths = {label: part["kept_over_optimum"].to_numpy() for label, part in parts.items()}
    times = {label: part["ms_law"].fill_null(np.inf).to_numpy() for label, part in parts.items()}
    return [
        _winner(f"Shortest motions, all stretched to meet the limits: {where}", "× T*", lengths, f"{OF_T}; {note}"),
        _winner(f"Shortest computing time: {where}", "ms", times, note),
    ]


def _rankable(b: BlockRows, rows: pl.DataFrame) -> tuple[list[str], str]:
    """Return the labels of the laws that can be ranked, and the reasons of the others."""
    unbounded = [
        label
        for label in b.entries
        if np.isinf(rows.filter(pl.col("method") == label)["least_duration"].drop_nulls().to_numpy()).any()
    ]
    asked = set(rows["method"])
    on_path = set(rows.filter(pl.col("solved") & pl.col("follows"))["method"])
    off = [label for label in b.entries if label in asked - on_path]
    reasons = (("jerk unbounded", unbounded), ("no motion on its path", off))
    unable = "".join(f"; {why}, not ranked: {listed(labels)}" for why, labels in reasons if labels)
    return [label for label in b.entries if label in on_path and label not in unbounded], unable


def _winner(question: str, unit: str, values: Mapping[str, Array], note: str) -> Winner:
    """Return the least median of paired values, and those not significantly longer by Wilcoxon's test."""
    entries = sorted(((label, *median_interval(x)) for label, x in values.items()), key=lambda entry: entry[1])
    level, count = not_longer(entries[0][0], values), len(values[entries[0][0]])
    return Winner(question, unit, "less", tuple(entries), "timing", note, DECIDED_BY, level, count)


OF_MODELS = (
    "Torques are those of the arms' models: what motors deliver at a speed or a temperature, and the elasticity of gears, are "
    "not in them."
)
"""Text of every report with torques."""


def subjects(blocks: Sequence[LawBlock]) -> tuple[str]:
    """Describe how many lines or paths were timed."""
    parts = [part for block in blocks for part in block.lines]
    count = sum(part.count for part in parts)
    noun = "straight line" if all(part.kind in (*LINE_KINDS, GIVEN_LINE) for part in parts) else "path"
    return (f"time laws along {'a' if count == 1 else f'{count:,}'} {noun}{'s' if count > 1 else ''}",)


def limitations(run: Run) -> tuple[str, ...]:
    """List the limitations of the figures."""
    many = [b for b in run.of("timing") if not b.block.detail]
    shown = detailed(run)
    return (*(() if shown is None else _line_limitations(run, shown)), *(_many_limitations(many) if many else ()))


def _line_limitations(run: Run, b: BlockRows) -> tuple[str, ...]:
    limits = limits_of(run, b)
    given = [name.replace("_", " ") for name in JOINT_LIMITS if limits.value(name) is not None]
    return (
        "The tool's distance from the line is a proved bound for every instant, at most 5 % (or a nanometre) above the "
        "largest value found. Peak velocities, accelerations and jerks are exact, from the roots of "
        "the polynomials' derivatives.",
        f"The limits on {listed(given)} are those of the robot file; the paper gives none. "
        + ("Torques are those of the arm's model. The" if "torque" in given else "Dynamics, torque limits, the")
        + " controller and a real arm are not included.",
        "TOPP-RA enforces its limits at grid points. Between them a ratio may exceed 1 by a few millionths, less on a "
        "finer grid. It has no jerk limit by design.",
    )[: 3 if any(row["method"] == "toppra" for row in solved_of(b)) else 2]


def _many_limitations(blocks: Sequence[BlockRows]) -> tuple[str, ...]:
    sets = [part for b in blocks for part in b.block.limits]
    return (
        "T* is the shortest known duration, not a proved optimum.",
        "Lines are sampled such that the whole line can be followed inside the joint limits. The smallest singular value "
        "along a line is never below 0.02."
        + ("" if any(part.own for part in sets) else " The limits are the suite's, not the robots' own."),
        "Peers time the joint path that optik follows, with its exact derivatives if they accept them. Their motions are "
        "shown unchanged, and compared after the same uniform time scaling to the limits as those of optik.",
        *([OF_MODELS] if any(part.counts_torque for part in sets) else []),
    )


def line_summary(run: Run) -> dict[str, Any] | None:
    """Describe the motion that is shown in detail; None without one."""
    block = next((block for block in run.suite.of("timing") if block.detail), None)
    if block is None or block.example_set.kind != GIVEN_LINE:
        return None
    part = block.example_set
    move, start = ", ".join(number(1e3 * x) for x in part.move_m), ", ".join(f"{x:g}" for x in part.start_deg)
    words = (
        f"The line: {number(1e3 * float(np.linalg.norm(part.move_m)))} mm by ({move}) mm in the base frame at constant "
        f"orientation, from q = ({start.replace('-', '−')})°, {block.samples} samples; inverse kinematics by "
        f"{', '.join(map(short_name, block.solvers))}; time laws {', '.join(law.label for law in block.laws)}."
    )
    return {"words": [words]}


def line_laws(run: Run) -> dict[str, Any] | None:
    """Return a row for each law along the line, and the influence of the IK method."""
    b = detailed(run)
    if b is None:
        return None
    return {"tables": [law_table(run, b)], "after": [words for words in (line.ik_matters(b),) if words]}


REPORT = KindReport(
    (
        Section("Time laws on many lines", "timing", timing, Path(__file__).with_name("section.html.j2"), 20),
        Section("The line", "line", line_summary, order=70, place="summary"),
        Section("The line in space (Fig. 5 and 6)", "line", line_in_space, Path(__file__).with_name("arm.html.j2"), 70),
        Section("Clearance", "clearance-line", line.draw_clearance, order=75),
        Section("Joint and tool motion", "joints", motion, order=80),
        Section("Time laws", "laws", line_laws, order=90),
    ),
    subjects,
    winners=winners,
    tables=tables.make_line_tables,
    limitations=limitations,
)
