"""Sections of the report on iteration budgets."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from benchmarks.report.base import KindReport, Section
from benchmarks.report.ik.budgets.accuracy import accuracy
from benchmarks.report.ik.budgets.best import tables, winners
from benchmarks.report.ik.budgets.damping import damping
from benchmarks.report.ik.budgets.default import default
from benchmarks.report.ik.budgets.head import findings, limitations, summary, terms
from benchmarks.report.ik.budgets.maps import maps
from benchmarks.report.ik.budgets.methods import methods
from benchmarks.report.ik.budgets.paper import paper
from benchmarks.report.ik.budgets.picture import picture

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

REPORT = KindReport(
    SECTIONS,
    lambda blocks: ("inverse kinematics",),
    winners=winners,
    tables=tables,
    findings=findings,
    limitations=limitations,
)
