"""What the kinds that measure speed have in common in the report: the rules of timing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.report.base import Section
from benchmarks.report.run import Run


def _speed(run: Run) -> dict[str, Any]:
    """The template needs nothing of the run."""
    return {}


SPEED = Section("Speed of one call", "speed", _speed, Path(__file__).with_name("speed.html.j2"), 19)
"""The end of the section on speed; every kind that stands in it names it among its sections."""
