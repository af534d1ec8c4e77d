"""Sections of the report on the executed cell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.experiments.executed import executed_claims
from benchmarks.report.base import QUESTION, KindReport, Run, Section
from benchmarks.report.cell.spots import axes, space, split
from benchmarks.report.cell.tables import drives_of, noise_words, tables
from benchmarks.report.sections import claims_of


def claims(run: Run) -> dict[str, Any] | None:
    """Show the paper's claims as executed, for every block of spots."""
    found = [f for b in run.of("cell") for f in executed_claims(b.rows)]
    return claims_of(found) if found else None


def findings(run: Run) -> Sequence[str]:
    """Return verdicts as executed, one sentence for each claim of each block."""
    found = [f for b in run.of("cell") for f in executed_claims(b.rows)]
    return [f"As executed, claim ({f.key}) {f.verdict}: {f.summary}" for f in found]


def limitations(run: Run) -> Sequence[str]:
    """Describe the simulation and its random quantities."""
    found = ["Every execution is simulated; nothing was measured on a real arm."]
    for b in run.of("cell"):
        varies = noise_words(b.block.noise)
        load = "" if b.block.payload is None else f" {b.block.payload:g} kg in the tool."
        found.append(
            f"{b.block.title}: executed on the drive {drives_of(b)}, set-points every {1e3 * b.block.period:g} ms.{load} "
            f"What varies: {varies or 'nothing'}."
        )
    return found


REPORT = KindReport(
    (
        Section("The paper's claims, as executed", "cell-claims", claims, QUESTION.with_name("claims.html.j2"), 61),
        Section("The task in space", "cell-space", space, order=62),
        Section("Sources of the error", "cell-split", split, order=63),
        Section("Spot and tool, as executed (Fig. 10 to 13)", "cell-axes", axes, order=64),
    ),
    lambda blocks: ("executed motions of the laser cell",),
    tables=tables,
    findings=findings,
    limitations=limitations,
    labels=lambda block: [m.label for m in block.methods],
)
