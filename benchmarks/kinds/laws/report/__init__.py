"""Section of the report on time laws on many lines."""

from __future__ import annotations

from pathlib import Path

from benchmarks.kinds.base import Section
from benchmarks.kinds.laws.report.section import timing

SECTIONS = (Section("Time laws on many lines", "timing", timing, Path(__file__).with_name("section.html.j2"), 20),)
"""The one section."""
