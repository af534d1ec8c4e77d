"""Piece of the section on speed: batches by number of threads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kinds._speed import SPEED
from benchmarks.kinds.base import Section
from benchmarks.kinds.batch.measures import extra_memory, solved_rate
from benchmarks.report.numbers import number
from benchmarks.report.run import Run
from benchmarks.report.tables import share
from optik.registry import short_name


def batches(run: Run) -> dict[str, Any] | None:
    """One row for each batch and number of threads.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    dict or None
        What the template shows; None where no batch has rows.
    """
    rows = []
    for b in run.of("batch"):
        for (threads,), part in b.rows.group_by("threads", maintain_order=True):
            rows.append(
                {
                    "title": b.block.title, "robot": short_name(b.block.robot), "solver": short_name(b.block.solver),
                    "threads": threads,
                    "count": part["count"][0], "solved": share(int(part["solved"].to_numpy().min()), part["count"][0]),
                    "seconds": number(float(np.median(part["seconds"].to_numpy()))), "repeats": len(part),
                    "rate": number(solved_rate(part)), "iterations": number(float(part["iterations"].to_numpy().mean())),
                    "extra": number(extra_memory(part)),
                }
            )  # fmt: skip
    return {"rows": rows} if rows else None


SECTIONS = (
    SPEED,
    Section("Batches", "speed", batches, Path(__file__).with_name("report.html.j2"), 12),
)
"""A table, after what it shares with single calls and first use."""
