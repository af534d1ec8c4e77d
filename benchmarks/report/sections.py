"""The sections of the page, in their order: a section is one object in one tuple."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from benchmarks.report.accuracy import accuracy
from benchmarks.report.arm import moving_arm
from benchmarks.report.damping import damping
from benchmarks.report.findings import claims, limitations, misprints, provenance
from benchmarks.report.laws import laws
from benchmarks.report.methods import methods
from benchmarks.report.motion import motion
from benchmarks.report.run import Run
from benchmarks.report.speed import speed
from benchmarks.report.timing import timing
from benchmarks.report.workspace import maps


@dataclass(frozen=True)
class Section:
    """One section.

    Attributes
    ----------
    title, anchor : str
        Heading, and its address on the page.
    build : callable
        From the run to what the template shows; None where the run has no data for it: it is left out.
    template : str
        File in ``templates``.
    """

    title: str
    anchor: str
    build: Callable[[Run], dict[str, Any] | None]
    template: str


SECTIONS = (
    Section("Speed of one call", "speed", speed, "speed.html.j2"),
    Section("Time laws on many lines", "timing", timing, "timing.html.j2"),
    Section("Methods", "methods", methods, "methods.html.j2"),
    Section("Error against distance and budget", "error", accuracy, "accuracy.html.j2"),
    Section("Which damping, where", "damping", damping, "damping.html.j2"),
    Section("Workspace maps", "maps", maps, "maps.html.j2"),
    Section("The line in space", "line", moving_arm, "arm.html.j2"),
    Section("Joint and tool motion", "motion", motion, "motion.html.j2"),
    Section("Time laws", "laws", laws, "laws.html.j2"),
    Section("The paper's claims", "claims", claims, "claims.html.j2"),
    Section("The paper's misprints", "misprints", misprints, "misprints.html.j2"),
    Section("Known limitations", "limitations", limitations, "limitations.html.j2"),
    Section("Provenance", "provenance", provenance, "provenance.html.j2"),
)
