"""What the page says of the executed cell first: findings, what must be known to quote them, and the claims as executed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.cell.laws import OWN_TIME
from benchmarks.blocks.cell.settings import MEASURES, NOISY, IsoBlock, LawsBlock, Noise, figures_of
from benchmarks.experiments.executed import executed_claims
from benchmarks.report.cell.look import cell_blocks, spots_blocks
from benchmarks.report.findings import claims_of
from benchmarks.report.numbers import number
from benchmarks.report.run import Run
from planners.cell.iso9283 import SIMULATED, PoseFigures

NOISE_WORDS = {
    "laser_angle": ("σ of the laser's pan and tilt", 1e3, "mrad"), "laser_range": ("σ of its range", 1e3, "mm"),
    "laser_position": ("σ of each coordinate of its calibrated position", 1e3, "mm"),
    "laser_rotation": ("σ of each component of its calibrated orientation", 1e3, "mrad"),
    "friction": ("friction of each joint, uniform ±", 1e2, "%"), "payload": ("payload, uniform ±", 1e2, "%"),
    "encoder_counts": ("encoder resolution", 1.0, "counts per turn"),
    "encoder_angle": ("σ of encoder readings", 1e6, "µrad"),
}  # fmt: skip
"""What varies, in words, with the factor to its unit."""


def claims(run: Run) -> dict[str, Any] | None:
    """The paper's claims as executed, for every block of spots."""
    found = [f for b in spots_blocks(run) for f in executed_claims(b.rows)]
    return claims_of(found) if found else None


def noise_words(noise: Noise) -> str:
    """What varies from trial to trial, in words."""
    words = []
    for name in NOISE_WORDS:
        value = getattr(noise, name)
        what, scale, unit = NOISE_WORDS[name]
        if value:
            gap = "" if what.endswith("±") else " "
            words.append(f"{what}{gap}{scale * value:.7g}{' ' + unit if unit else ''}")
    return ", ".join(words)


def drives_of(b: BlockRows) -> str:
    """The drive of a block in words."""
    names = b.rows["drive"].drop_nulls().unique().sort().to_list()
    ideal = " (without masses: no servo error, torque or energy; friction and payload have no effect)"
    return " and ".join(name + (ideal if name == "ideal" else "") for name in names)


def findings(run: Run) -> Sequence[str]:
    """Verdicts as executed, accuracy and repeatability, and the laws' costs, one sentence for each block."""
    found = [
        f"As executed, claim ({f.key}) {f.verdict}: {f.summary}"
        for b in spots_blocks(run)
        for f in executed_claims(b.rows)
    ]
    found += [_iso_sentence(b) for b in cell_blocks(run, IsoBlock)]
    return [words for words in (*found, *(_laws_sentence(b) for b in cell_blocks(run, LawsBlock))) if words]


def _iso_sentence(b: BlockRows) -> str:
    found = {m.name: m.compute(b.rows.filter(b.rows["method"] == NOISY)) for m in MEASURES["iso"][:4]}
    poses = [f for f in figures_of(b.rows.filter(b.rows["method"] == NOISY)) if isinstance(f, PoseFigures)]
    if not poses:
        return ""
    words = ", ".join(f"{name[:2].upper()} {number(value)} mm" for name, value in found.items() if value == value)
    cycles = "1 cycle" if poses[0].cycles == 1 else f"{poses[0].cycles} cycles"
    return f"In the manner of ISO 9283, {SIMULATED}, worst of five poses over {cycles} and of one line: {words}."


def _laws_sentence(b: BlockRows) -> str:
    rows = b.rows.filter((b.rows["timed"] == OWN_TIME) & (b.rows["repeat"] == 0) & b.rows["tracking_m"].is_not_null())
    if rows.is_empty():
        return ""
    each = rows.group_by("method", maintain_order=True).agg(pl.col("tracking_m", "duration").max())
    words = [f"{law} {number(1e3 * off)} mm in {number(T)} s" for law, off, T in each.iter_rows()]
    return f"{b.block.title}: largest tracking error of the tool, and longest duration: {'; '.join(words)}."


def limitations(run: Run) -> Sequence[str]:
    """What is simulated, and what varies."""
    found = ["Every execution is simulated; nothing was measured on a real arm."]
    for b in run.of("cell"):
        varies = noise_words(b.block.noise)
        load = "" if b.block.payload is None else f" {b.block.payload:g} kg in the tool."
        found.append(
            f"{b.block.title}: executed on the drive {drives_of(b)}, set-points every {1e3 * b.block.period:g} ms.{load} "
            f"What varies: {varies or 'nothing'}."
        )
    return found
