"""Section of the report on time laws on many lines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.blocks.timing.laws.settings import LINE_KINDS, LawBlock
from benchmarks.report.base import KindReport, Section
from benchmarks.report.run import Run
from benchmarks.report.timing.laws.section import findings, timing
from benchmarks.report.timing.laws.tables import all_tables
from benchmarks.report.timing.laws.winners import winners

SECTIONS = (Section("Time laws on many lines", "timing", timing, Path(__file__).with_name("section.html.j2"), 20),)
"""The one section."""

OF_MODELS = (
    "Torques are those of the arms' models: what motors deliver at a speed or a temperature, and the elasticity of gears, are "
    "not in them."
)
"""What every report with torques says."""


def subjects(blocks: Sequence[LawBlock]) -> tuple[str]:
    """How many lines or paths were timed."""
    parts = [part for block in blocks for part in block.lines]
    words = "straight lines" if all(part.kind in LINE_KINDS for part in parts) else "paths"
    return (f"time laws along {sum(part.count for part in parts)} {words}",)


def limitations(run: Run) -> tuple[str, ...]:
    """What a reader should know before quoting a figure."""
    sets = [part for b in run.of("laws") for part in b.block.limits]
    return (
        "T* is the shortest known duration, not a proved optimum.",
        "Lines are sampled such that the whole line can be followed inside the joint limits. The smallest singular value "
        "along a line is never below 0.02."
        + ("" if any(part.own for part in sets) else " The limits are the suite's, not the robots' own."),
        "Peers time the joint path that optik follows, with its exact derivatives if they accept them. Their motions are "
        "shown unchanged, and compared after the same uniform time scaling to the limits as those of optik.",
        *([OF_MODELS] if any(part.counts_torque for part in sets) else []),
    )


REPORT = KindReport(
    SECTIONS,
    subjects,
    winners=winners,
    tables=all_tables,
    findings=findings,
    limitations=limitations,
)
