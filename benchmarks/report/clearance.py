"""Section: contacts that sampling misses, compared with the certificate, and the computing time of both."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.clearance import MEASURES, PROOF
from benchmarks.records import slug
from benchmarks.report import boards
from benchmarks.report.base import KindReport, Run, Section
from benchmarks.report.boards import Board, Sample, add, axis, figure, fraction_plot, interval, line, ticked_axis
from benchmarks.report.tables import Column, Table, number, table_of
from benchmarks.statistics import percentage

TIME_TICKS = (0.1, 0.3, 1, 3, 10, 30, 100, 300)
"""Numbers on the axes of times [ms]."""

HOW = (
    "Motions are straight in joint space, one quintic from rest to rest, between two collision-free configurations. The "
    "certificate is for every instant. Sampling is Pinocchio's computeCollisions with coal at configurations equally spaced in "
    "joint space or in time, up to the first contact. Both examine the same pairs of the same shapes. The truth is a contact "
    "if coal finds one at some sample, or confirms the one of the certificate at its instant."
)
"""Description of the judged motions and of the methods."""

CLEARANCE_COLUMNS = (Column("label", "Method", show="text"), *MEASURES)
"""Columns of a table: what targets can name."""


def section(run: Run) -> dict[str, Any] | None:
    """Show plots of all scenes, and a table for each."""
    blocks = run.of("clearance")
    return {"boards": [_board(blocks, run)], "tables": run.tables_of("clearance"), "after": [HOW]} if blocks else None


def tables(run: Run) -> Sequence[Table]:
    """Return one table for each block."""
    return [_table(b) for b in run.of("clearance")]


def findings(run: Run) -> Sequence[str]:
    """Return the contacts that each sampling misses, and the times, for each block."""
    return [_sentence(b) for b in run.of("clearance")]


def _sentence(b: BlockRows) -> str:
    words, contacts, motions = [], 0, 0
    for label, rows in b.by_method.items():
        contacts, motions = int(rows["contact"].sum()), len(rows)
        ms = number(float(np.median(rows["ms"].to_numpy())))
        undecided = int((rows["says"] == "undecided").sum())
        left = f", {undecided} undecided" if undecided else ""
        words.append(f"{label} {int(rows['missed'].sum())} ({ms} ms{left})")
    asked = f"missed of {contacts:,} contacts in {motions:,} motions, with the median time"
    return f"{b.block.title}: {asked}: {'; '.join(words)}."


def _table(b: BlockRows) -> Table:
    groups = [({"label": label}, rows) for label, rows in b.by_method.items()]
    note = (
        f"{b.rows['problem'].n_unique():,} motions of {b.block.robot}. Rates have Wilson's 95 % intervals. "
        "Collision-free motions take longest: sampling stops at the first contact."
        + (f" A distance below {1e3 * b.block.margin:g} mm to the scene counts as contact." if b.block.margin else "")
        + ("" if len(groups) > 1 else " Sampling needs coal and Pinocchio: pip install coal pin.")
    )
    return table_of(f"clearance-{slug(b.block.id)}", b.block.title, CLEARANCE_COLUMNS, groups, note)


def _board(blocks: Sequence[BlockRows], run: Run) -> Board:
    """Plot missed contacts against the time of a motion, and the distribution of times."""
    each = [(int(rows["missed"].sum()), int(rows["contact"].sum())) for b in blocks for rows in b.by_method.values()]
    most = max((percentage(*pair)[2] for pair in each if pair[1]), default=100.0)
    missed = figure(
        "clearance-missed", "Missed contacts against the time of a motion",
        ticked_axis("median time of a motion [ms]", TIME_TICKS),
        axis("missed contacts [%]", range=[-0.04 * most, 1.05 * most]), 400,
    )  # fmt: skip
    times = fraction_plot(
        "clearance-times", "Motions judged within this time", ticked_axis("time [ms]", TIME_TICKS), "motions",
        "%{y:.3~g} % within %{x:.3g} ms",
        [Sample(label, rows["ms"], run.look(label), {"scene": [b.block.title]})
         for b in blocks for label, rows in b.by_method.items()], 400,
    )  # fmt: skip
    for b in blocks:
        for label, rows in b.by_method.items():
            contacts = int(rows["contact"].sum())
            if contacts:
                share, low, high = percentage(int(rows["missed"].sum()), contacts)
                add(missed, line(
                    [rows["ms"].median()], [share], mode="markers", name=label,
                    marker={"color": run.colour(label), "size": 11, "symbol": run.symbol(label)},
                    error_y=interval([(share, low, high)], color=run.colour(label)),
                    hover=f"{label}<br>%{{y:.3g}} % of {contacts} contacts, %{{x:.3g}} ms",
                ), {"scene": [b.block.title]})  # fmt: skip
    titles = [b.block.title for b in blocks]
    return Board(
        "clearance-board", (missed, times), (boards.Control.of("scene", "Scene", titles),) if titles[1:] else (),
        f"{PROOF.capitalize()}: also between samples. Bars are Wilson's 95 % intervals.",
    )  # fmt: skip


LIMITATIONS_OF_CLEARANCE = (
    "Clearance is that of the capsules around the arm's links, which extend beyond the real surface: a contact of "
    "the shapes need not be one of the arm. Pairs of links that always touch are not examined.",
)
"""Limitations of the figures."""

REPORT = KindReport(
    (Section("Contact between samples", "clearance", section, order=25),),
    lambda blocks: (f"proofs of clearance over {sum(block.count for block in blocks):,} motions",),
    tables=tables,
    findings=findings,
    limitations=lambda run: LIMITATIONS_OF_CLEARANCE,
)
