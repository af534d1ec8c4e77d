"""The sections of the page, in their order: those of the kinds that were run, then the common ones."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Any

from benchmarks.report.base import Section, load_report
from benchmarks.report.failures import failure_section, home_of
from benchmarks.report.findings import asked, claims, limitations, misprints, provenance
from benchmarks.report.run import Run

_TEMPLATES = Path(__file__).parent / "templates"
"""Folder of the templates of the frame."""

CLOSING = (
    Section("The paper's claims", "claims", claims, _TEMPLATES / "claims.html.j2", 100),
    Section("The paper's misprints", "misprints", misprints, _TEMPLATES / "misprints.html.j2", 110),
    Section("Known limitations", "limitations", limitations, _TEMPLATES / "limitations.html.j2", 120),
    Section("Acceptance targets", "asked", asked, _TEMPLATES / "asked.html.j2", 125),
    Section("Provenance", "provenance", provenance, _TEMPLATES / "provenance.html.j2", 130),
)
"""Last sections of every page, for all kinds."""


def all_sections(run: Run) -> list[Section]:
    """Return the sections of all kinds that were run, and the last sections of the page."""
    found: dict[Section, None] = {}
    for kind in run.suite.kinds:
        own = load_report(kind).sections
        failed = failure_section(kind, home_of(kind, own), run)
        found |= dict.fromkeys([*own, *([] if failed is None else [failed])])
    return sorted((*found, *CLOSING), key=lambda section: section.order)


def built(run: Run, place: str) -> list[tuple[Section, list[tuple[Section, dict[str, Any]]]]]:
    """Return the sections that are not empty, each with its pieces: those with the same anchor."""
    shown = []
    for _, group in groupby((s for s in all_sections(run) if s.place == place), key=lambda section: section.anchor):
        pieces = [(section, context) for section in group if (context := section.build(run)) is not None]
        if pieces:
            shown.append((pieces[0][0], pieces))
    return shown
