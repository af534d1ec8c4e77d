"""Piece of the section on speed: first use in fresh processes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.kinds._speed import SPEED
from benchmarks.kinds.base import Section
from benchmarks.kinds.first_use.measures import MEASURES
from benchmarks.report.numbers import number
from benchmarks.report.run import Run
from benchmarks.targets import measure_named


def first_use(run: Run) -> dict[str, Any] | None:
    """Seconds of every process by measure.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    dict or None
        What the template shows; None where it was not run.
    """
    rows = []
    for b in run.of("first_use"):
        for (measure,), part in b.rows.group_by("measure", maintain_order=True):
            seconds = part["seconds"].to_list()
            what = measure_named(MEASURES, str(measure), "measure").title
            each = ", ".join(number(s) for s in seconds)
            rows.append({"what": what, "median": number(float(np.median(seconds))), "all": each})
    return {"rows": rows} if rows else None


SECTIONS = (
    SPEED,
    Section("First use", "speed", first_use, Path(__file__).with_name("report.html.j2"), 13),
)
"""A table, after what it shares with single calls and batches."""
