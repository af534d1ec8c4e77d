"""Section of the report on single calls: plots, tables, and who wins."""

from __future__ import annotations

from pathlib import Path

from benchmarks.report.base import KindReport, Section
from benchmarks.report.ik.calls.section import all_tables, calls, success_plot
from benchmarks.report.ik.calls.winners import winners
from benchmarks.report.ik.speed import SPEED

_TEMPLATE = Path(__file__).with_name("section.html.j2")
"""What shows plots, then tables."""

SECTIONS = (
    Section("Success against time budget", "calls", success_plot, _TEMPLATE, 11, "top"),
    SPEED,
    Section("Speed of one call", "speed", calls, _TEMPLATE, 11),
)
"""A plot for the first screen; then the section, after what it shares with batches and first use."""

LIMITATIONS_OF_CALLS = (
    "Calls are timed in a loop over different targets, with code and tables in the processor's caches. A single call "
    "after other work takes longer. The garbage collector is off during timing.",
    "Every round has the same problems. If the first round of a method is far slower than the others, it may cache "
    "answers: its time is then that of the first round, and the note below the table names it.",
    "Closed-form peers compute every branch, our methods one solution near the start. A peer that starts threads is "
    "timed with them. Peers have the settings that served them best on the paper's arm; their rows state them.",
)
"""What a reader should know before quoting a figure."""

REPORT = KindReport(
    SECTIONS,
    lambda blocks: ("inverse kinematics, call by call",),
    winners=winners,
    tables=all_tables,
    limitations=lambda run: LIMITATIONS_OF_CALLS,
)
