"""Section: durations before and after the choice of path and time, the free coordinates, and the arm along both paths."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.freedom import ALONG_INITIAL, CHOSEN, MEASURES, FreeSet
from benchmarks.records import slug
from benchmarks.report import boards
from benchmarks.report.base import KindReport, Run, Section
from benchmarks.report.boards import Board, Control, Sample, add, axis, colour, figure, fraction_plot, line, vary
from benchmarks.report.tables import Column, Group, Table, number, table_of
from benchmarks.report.timing.line import detailed, read_track
from optik.view.page import embed_arm

HOW_COMPARED = (
    "Before is the motion along the initial path within the same limits: the given path of the tool, or the straight line in "
    "joint space; of a cycle it is the sum of straight moves with a stop at each via pose. After is the motion whose path and "
    "timing are chosen together. Each ratio is of one motion. A certificate is valid if every enforced limit is respected at "
    "every instant. A peer's motion is slowed uniformly until it respects all limits."
)
"""Description of the compared motions."""


FREEDOM_COLUMNS = (
    Column("label", "Motions", show="text"),
    Column("robot", "arm", show="text"),
    Column("limits", "limits", show="text"),
    Column("method", "method", show="text"),
    *MEASURES,
)
"""Columns of a table; medians are those of the motions with a duration before and after."""


def tables(run: Run) -> Sequence[Table]:
    """Return one table for each block."""
    return [_table(b) for b in run.of("freedom")]


def findings(run: Run) -> Sequence[str]:
    """Return the median ratio of the durations, for each set of motions and limits."""
    found = []
    for b in run.of("freedom"):
        each = bool(b.block.limits[1:])  # one set of limits is named once
        words = [
            f"{row['label']} of {row['robot']}{' within ' + str(row['limits']) if each else ''} "
            f"{number(_plain(row['median_ratio']))} (n = {row['motions']})"
            for row in _table(b).rows
            if row["method"] == CHOSEN
        ]
        within = "" if each else f" within {b.block.limits[0].label}"
        found.append(
            f"{b.block.title}{within}, median duration after / before path and time were chosen: {'; '.join(words)}."
        )
    return found


def _plain(cell: Any) -> float:
    return float(cell) if isinstance(cell, float | int) else float("nan")


def _groups(b: BlockRows, method: str = CHOSEN) -> list[tuple[FreeSet, str, pl.DataFrame]]:
    """Return the rows of a method, of every set of motions within every set of limits."""
    found = []
    for part, limits in product(b.block.sets, b.block.limits):
        rows = b.rows.filter(kind=part.label, robot=part.arm, limits=limits.label, method=method)
        found += [] if rows.is_empty() else [(part, limits.label, rows)]
    return found


def _table(b: BlockRows) -> Table:
    groups: list[Group] = [
        ({"label": part.label, "robot": part.arm, "limits": limits, "method": method}, rows)
        for method in b.block.labels
        for part, limits, rows in _groups(b, method)
    ]
    alone = int(b.rows["ratio"].is_null().sum())
    note = "The certified rate has Wilson's 95 % interval." + (
        f" {alone} motions have no ratio: there is no plan before or after." if alone else ""
    )
    title = f"Duration before and after: {b.block.title}"
    return table_of(f"freedom-{slug(b.block.id)}", title, FREEDOM_COLUMNS, groups, note)


# ---------------------------------------------------------------- plots


def section(run: Run) -> dict[str, Any] | None:
    """Show the ratios of all sets, the table of each block, and an example of each set."""
    blocks = run.of("freedom")
    if not blocks:
        return None
    shown = [_ratios(blocks)]
    examples = _examples(blocks)
    if examples:
        shown.append(_coordinates(examples))
    return {"boards": shown, "tables": run.tables_of("freedom"), "after": [HOW_COMPARED]}


def _ratios(blocks: Sequence[BlockRows]) -> Board:
    """Plot the distribution of the ratios of every set."""
    low = min(b.rows["ratio"].drop_nulls().to_numpy().min(initial=1.0) for b in blocks)
    across = axis("duration after / before", range=[low - 0.02, 1.02])
    samples = [
        Sample(
            f"{part.label}, {part.arm}" + (f", {limits}" if b.block.limits[1:] else ""), rows["ratio"],
            {"color": colour(k), "width": 2, "dash": ("solid", "dash", "dot")[k % 3]}, {"block": [b.block.id]},
        )
        for b in blocks
        for k, (part, limits, rows) in enumerate(_groups(b))
    ]  # fmt: skip
    title, hover = "Motions up to this ratio of durations", "%{y:.3g} % up to %{x:.4g}"
    plot = fraction_plot("freedom-ratios", title, across, "motions", hover, samples)
    return Board(
        "freedom-board",
        (plot,),
        (Control.of_blocks(blocks),),
        "The percentage is of all motions, with or without a plan.",
    )


Example = tuple[BlockRows, int, FreeSet, pl.DataFrame, pl.DataFrame]
"""A block, the number of a set and the set, and the motions and coordinates of its example."""


def _examples(blocks: Sequence[BlockRows]) -> list[Example]:
    """Return the first motion that became shorter, of every set that has one."""
    found = []
    for b in blocks:
        for k, part in enumerate(b.block.sets):
            motions, coordinates = b.table(f"motion-{k}"), b.table(f"coordinates-{k}")
            if motions is not None and coordinates is not None:
                found.append((b, k, part, motions, coordinates))
    return found


def _coordinates(examples: Sequence[Example]) -> Board:
    """Plot the free coordinates along the path of each example, with their ranges."""
    plot = figure("freedom-coordinates", "Free coordinates along the path of the first motion that became shorter",
                  axis("fraction of the path", range=[-0.01, 1.01]), "coordinate", 380)  # fmt: skip
    names = [f"{part.label}, {part.arm}" for _b, _k, part, _motions, _rows in examples]
    for name, (_b, _k, _part, _motions, rows) in zip(names, examples, strict=True):
        when = {"set": [name]}
        for i, ((coordinate,), one) in enumerate(rows.group_by("coordinate", maintain_order=True)):
            s, unit = one["s"].to_numpy(), one["unit"][0]
            add(plot, line(
                s / s[-1], one["value"], name=str(coordinate), line={"color": colour(i), "width": 2},
                hover=f"{coordinate}<br>%{{x:.3g}} of the path: %{{y:.4g}} {unit}",
            ), when)  # fmt: skip
        has_unit = bool(rows["unit"][0])  # a coordinate with a unit; joints are shown as fractions of their ranges
        title = f"{rows['coordinate'][0]} [{rows['unit'][0]}]" if has_unit else "fraction of the joint's range"
        vary(plot, when, {"yaxis": {"title": {"text": title}}})
        for words, dash, stroke in (("reached", "dot", boards.MUTED_COLOUR), ("allowed", "dash", boards.ALARM_COLOUR)):
            keys = ("least", "most") if words == "allowed" else ("reached_least", "reached_most") if has_unit else ()
            ends = {float(end) for key in keys for end in rows[key].unique() if np.isfinite(end)}
            for end in sorted(ends):
                look = {"color": stroke, "width": 1, "dash": dash}
                add(plot, line([0.0, 1.0], [end, end], line=look, hover=f"{words}: %{{y:.4g}} {rows['unit'][0]}"), when)
            if ends:
                add(plot, boards.entry(f"range {words}", stroke, dash), when)
    return Board(
        "coordinates-board", (plot,), (Control.of("set", "Motions", names),),
        "The initial path has the coordinate 0. The reached range is that of the spline's coefficients, which enclose the "
        "coordinate. The coordinate of an elbow is its distance from the initial joint path. "
        "Of free joint paths the joints are shown.",
    )  # fmt: skip


def arm(run: Run) -> dict[str, Any] | None:
    """Show the arm along the chosen path, and on request along the initial one beside it."""
    examples = _examples(run.of("freedom"))
    if not examples or detailed(run):  # a page has one arm, that of its line
        return None
    _b, _k, part, motions, _coordinates = examples[0]
    robot = part.fit(run.robot(part.robot))
    tracks = {name: read_track(motions.filter(motion=name), robot.n) for name in (CHOSEN, ALONG_INITIAL)}
    path = robot.fk(tracks[ALONG_INITIAL].q)[:, :3, 3]
    return {
        "words": [f"{part.label}, {part.arm}: the first motion that became shorter."],
        "arm": boards.squeeze(json.dumps(embed_arm(robot, tracks, path)).encode()),
    }  # fmt: skip


def _subjects(blocks: Sequence[Any]) -> Sequence[str]:
    motions = sum(part.count * len(block.limits) for block in blocks for part in block.sets)
    return (f"{motions:,} motions along initial and along free paths",)


REPORT = KindReport(
    (
        Section("Path and time together", "freedom", section, order=22),
        Section("The arm along both paths", "freedom-arm", arm, Path(__file__).parent / "timing" / "arm.html.j2", 23),
    ),
    _subjects,
    tables=tables,
    findings=findings,
)
