"""Sections of the report on the line."""

from __future__ import annotations

from pathlib import Path

from benchmarks.kinds.base import Section
from benchmarks.kinds.plans.report.arm import moving_arm
from benchmarks.kinds.plans.report.head import summary
from benchmarks.kinds.plans.report.laws import laws
from benchmarks.kinds.plans.report.motion import motion
from benchmarks.kinds.plans.report.space import space

SECTIONS = (
    Section("The line", "plans", summary, Path(__file__).with_name("summary.html.j2"), 70, place="summary"),
    Section("The line in space (Fig. 5 and 6)", "line", moving_arm, Path(__file__).with_name("arm.html.j2"), 70),
    Section("Joint and tool motion", "motion", motion, Path(__file__).with_name("motion.html.j2"), 80),
    Section("Clearance", "clearance-line", space, Path(__file__).with_name("space.html.j2"), 75),
    Section("Time laws", "laws", laws, Path(__file__).with_name("laws.html.j2"), 90),
)
"""Sections, and a sentence after the key findings."""
