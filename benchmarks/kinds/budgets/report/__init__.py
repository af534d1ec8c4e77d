"""Sections of the report on iteration budgets."""

from __future__ import annotations

from pathlib import Path

from benchmarks.kinds.base import Section
from benchmarks.kinds.budgets.report.accuracy import accuracy
from benchmarks.kinds.budgets.report.damping import damping
from benchmarks.kinds.budgets.report.head import summary, terms
from benchmarks.kinds.budgets.report.maps import maps
from benchmarks.kinds.budgets.report.methods import methods

_HERE = Path(__file__).parent
"""Where the templates of this kind are."""

SECTIONS = (
    Section("What solved means", "terms", terms, _HERE / "terms.html.j2", 30, place="terms"),
    Section("What was run", "budgets", summary, _HERE / "summary.html.j2", 30, place="summary"),
    Section("Methods", "methods", methods, _HERE / "methods.html.j2", 30),
    Section("Error against distance and budget", "error", accuracy, _HERE / "accuracy.html.j2", 40),
    Section("Which damping, where", "damping", damping, _HERE / "damping.html.j2", 50),
    Section("Workspace maps", "maps", maps, _HERE / "maps.html.j2", 60),
)
"""Sections, a sentence in the first paragraph and a table after the key findings."""
