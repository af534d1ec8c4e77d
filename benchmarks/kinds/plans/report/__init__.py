"""Sections of the report on the line."""

from __future__ import annotations

from pathlib import Path

from benchmarks.kinds.base import Section
from benchmarks.kinds.plans.report.arm import moving_arm
from benchmarks.kinds.plans.report.head import summary
from benchmarks.kinds.plans.report.laws import laws
from benchmarks.kinds.plans.report.motion import motion

_HERE = Path(__file__).parent
"""Where the templates of this kind are."""

SECTIONS = (
    Section("The line", "plans", summary, _HERE / "summary.html.j2", 70, place="summary"),
    Section("The line in space", "line", moving_arm, _HERE / "arm.html.j2", 70),
    Section("Joint and tool motion", "motion", motion, _HERE / "motion.html.j2", 80),
    Section("Time laws", "laws", laws, _HERE / "laws.html.j2", 90),
)
"""Sections, and a sentence after the key findings."""
