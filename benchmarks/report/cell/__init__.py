"""Sections of the report on the executed cell."""

from __future__ import annotations

from pathlib import Path

from benchmarks.blocks.cell.settings import SpotsBlock
from benchmarks.report.base import KindReport, Section
from benchmarks.report.cell.axes import axes
from benchmarks.report.cell.head import claims, findings, limitations
from benchmarks.report.cell.plant import iso, laws
from benchmarks.report.cell.space import space
from benchmarks.report.cell.split import split
from benchmarks.report.cell.tables import tables

_SHOWN = Path(__file__).with_name("section.html.j2")
"""Template of words, boards and tables."""

_VERDICTS = Path(__file__).with_name("claims.html.j2")
"""Template of the claims."""

SECTIONS = (
    Section("The paper's claims, as executed", "cell-claims", claims, _VERDICTS, 61),
    Section("The task in space", "cell-space", space, _SHOWN, 62),
    Section("Sources of the error", "cell-split", split, _SHOWN, 63),
    Section("Spot and tool, as executed (Fig. 10 to 13)", "cell-axes", axes, _SHOWN, 64),
    Section("ISO 9283, simulated", "cell-iso", iso, _SHOWN, 65),
    Section("Time laws on the plant", "cell-laws", laws, _SHOWN, 66),
)
"""What was executed, from the claims to the plant."""

REPORT = KindReport(
    SECTIONS,
    lambda blocks: ("executed motions of the laser cell",),
    tables=tables,
    findings=findings,
    limitations=limitations,
    labels=lambda block: [m.label for m in block.methods] if isinstance(block, SpotsBlock) else block.labels,
)
