"""Section of the report on single calls: plots, tables, and who wins."""

from __future__ import annotations

from pathlib import Path

from benchmarks.kinds._speed import SPEED
from benchmarks.kinds.base import Section
from benchmarks.kinds.calls.report.section import calls, success_plot

_TEMPLATE = Path(__file__).with_name("section.html.j2")
"""What shows plots, then tables."""

SECTIONS = (
    Section("Success against time budget", "calls", success_plot, _TEMPLATE, 11, "top"),
    SPEED,
    Section("Speed of one call", "speed", calls, _TEMPLATE, 11),
)
"""A plot for the first screen; then the section, after what it shares with batches and first use."""
