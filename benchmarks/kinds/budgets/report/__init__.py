"""Sections of the report on iteration budgets."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from benchmarks.kinds.base import Section
from benchmarks.kinds.budgets.report.accuracy import accuracy
from benchmarks.kinds.budgets.report.damping import damping
from benchmarks.kinds.budgets.report.default import default
from benchmarks.kinds.budgets.report.head import summary, terms
from benchmarks.kinds.budgets.report.maps import maps
from benchmarks.kinds.budgets.report.methods import methods
from benchmarks.kinds.budgets.report.paper import paper
from benchmarks.kinds.budgets.report.picture import picture

_QUESTION = Path(str(files("benchmarks.report"))) / "templates" / "question.html.j2"
"""The template of a section that answers one question: an answer, plots, tables, then prose."""

SECTIONS = (
    Section("Definition of a solved problem", "terms", terms, Path(__file__).with_name("terms.html.j2"), 30, place="terms"),
    Section("Problems and methods", "budgets", summary, Path(__file__).with_name("summary.html.j2"), 30, place="summary"),
    Section("Is the default better than the paper's iteration?", "default", default, _QUESTION, 5),
    Section("Reached spots of the workspace", "picture", picture, _QUESTION, 5, place="top"),
    Section("Methods", "methods", methods, Path(__file__).with_name("methods.html.j2"), 30),
    Section("Error against distance and budget", "error", accuracy, Path(__file__).with_name("accuracy.html.j2"), 40),
    Section("Damping by distance to a singularity", "damping", damping, Path(__file__).with_name("damping.html.j2"), 50),
    Section("The workspace: positions and errors (Fig. 10 to 13)", "maps", maps, Path(__file__).with_name("maps.html.j2"), 60),
    Section("The paper and this report", "paper", paper, Path(__file__).with_name("paper.html.j2"), 98),
)  # fmt: skip
"""Sections, a sentence in the first paragraph and a table after the key findings."""
