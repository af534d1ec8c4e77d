"""Sections of the report on the line."""

from __future__ import annotations

from pathlib import Path

from benchmarks.report.base import KindReport, Section
from benchmarks.report.timing.plans.arm import moving_arm
from benchmarks.report.timing.plans.best import tables, winners
from benchmarks.report.timing.plans.head import findings, limitations, summary
from benchmarks.report.timing.plans.laws import laws
from benchmarks.report.timing.plans.motion import motion
from benchmarks.report.timing.plans.space import space
from optik.registry import short_name

SECTIONS = (
    Section("The line", "plans", summary, Path(__file__).with_name("summary.html.j2"), 70, place="summary"),
    Section("The line in space (Fig. 5 and 6)", "line", moving_arm, Path(__file__).with_name("arm.html.j2"), 70),
    Section("Joint and tool motion", "motion", motion, Path(__file__).with_name("motion.html.j2"), 80),
    Section("Clearance", "clearance-line", space, Path(__file__).with_name("space.html.j2"), 75),
    Section("Time laws", "laws", laws, Path(__file__).with_name("laws.html.j2"), 90),
)
"""Sections, and a sentence after the key findings."""

REPORT = KindReport(
    SECTIONS,
    lambda blocks: ("inverse kinematics", "time laws along a straight line"),
    winners=winners,
    tables=tables,
    findings=findings,
    limitations=limitations,
    labels=lambda block: [short_name(law) for law in block.laws],
)
