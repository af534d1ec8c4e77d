"""Table of the executed cell: spots by method and budget."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.cell.settings import Noise, share_within
from benchmarks.blocks.columns import Of, count, largest, median
from benchmarks.records import slug
from benchmarks.report.base import Run
from benchmarks.report.tables import Column, Group, Table, table_of
from benchmarks.statistics import quantiles

NOISE_WORDS = {
    "laser_angle": ("σ of the laser's pan and tilt", 1e3, "mrad"), "laser_range": ("σ of its range", 1e3, "mm"),
    "laser_position": ("σ of each coordinate of its calibrated position", 1e3, "mm"),
    "laser_rotation": ("σ of each component of its calibrated orientation", 1e3, "mrad"),
    "friction": ("friction of each joint, uniform ±", 1e2, "%"), "payload": ("payload, uniform ±", 1e2, "%"),
    "encoder_counts": ("encoder resolution", 1.0, "counts per turn"),
    "encoder_angle": ("σ of encoder readings", 1e6, "µrad"),
}  # fmt: skip
"""Random quantities of a trial in words, with the factor to their unit."""


ENDED_TRIAL = pl.col("position_error").is_not_null()
"""Whether a trial was executed."""


def _mm(column: str, level: float = 0.5) -> Of:
    """Return the computation of a quantile [mm] over the executed trials; None without any."""

    def of(rows: pl.DataFrame) -> float | None:
        ends = rows.filter(ENDED_TRIAL)
        return 1e3 * quantiles(ends[column].to_numpy(), (level,))[0] if len(ends) else None

    return of


SPOT_COLUMNS = (
    Column("label", "Method", show="text"),
    Column("budget", "iterations", show="text"),
    Column("within", "within 2 mm on each axis", "%", "more", "share", of=share_within),
    Column("count", "trials", show="count", of=len),
    Column("error", "median error", "mm", "less", of=_mm("position_error")),
    Column("p95", "p95 error", "mm", "less", of=_mm("position_error", 0.95)),
    *(Column(name.lower(), name, "mm", of=_mm(f"{name.lower()}_error")) for name in ("laser", "IK", "path", "servo")),
    Column("tracking", "largest tracking error", "mm", "less", of=largest("tracking_m", 1e3, among=ENDED_TRIAL)),
    Column("torque", "largest torque / bound", "", "", "limit", of=largest("torque_ratio", among=ENDED_TRIAL)),
    Column("duration", "median duration", "s", aside=True, of=median("duration", among=ENDED_TRIAL)),
    Column("failed", "not executed", show="count", of=count(~ENDED_TRIAL)),
)
"""Columns of a table of spots; the parts of the error are medians of lengths."""


def noise_words(noise: Noise) -> str:
    """Describe the random quantities of a trial."""
    words = []
    for name in NOISE_WORDS:
        value = getattr(noise, name)
        what, scale, unit = NOISE_WORDS[name]
        if value:
            gap = "" if what.endswith("±") else " "
            words.append(f"{what}{gap}{scale * value:.7g}{' ' + unit if unit else ''}")
    return ", ".join(words)


def drives_of(b: BlockRows) -> str:
    """Describe the drive of a block."""
    names = b.rows["drive"].drop_nulls().unique().sort().to_list()
    ideal = " (without masses: no servo error, torque or energy; friction and payload have no effect)"
    return " and ".join(name + (ideal if name == "ideal" else "") for name in names)


def tables(run: Run) -> Sequence[Table]:
    """Return all tables of the executed cell."""
    return [spots_table(b) for b in run.of("cell")]


def _budget_words(budget: Any, along: bool) -> str:
    """Say how many iterations were made, and where."""
    return "the whole line" if budget is None else f"{budget} at each pose" if along else f"{budget} from the start"


def spots_table(b: BlockRows) -> Table:
    """Return spots by method and budget."""
    groups: list[Group] = [
        ({"label": str(setting), "budget": _budget_words(budget, part["along"][0])}, part)
        for (setting, budget), part in b.rows.filter("known").group_by("setting", "budget", maintain_order=True)
    ]
    note = (
        "Spots with a known solution. The parts of the error are median lengths of vectors at the end of the motion: laser "
        "(target − spot), IK (tool at the method's answer − target), path (planned − answer), servo (executed − planned). If "
        "the answer is the start, there is no motion and no servo error. A trial that was not executed counts as a miss and "
        "has no error. Torque: simulated peak / certificate's bound for the nominal arm. Other friction and payload may "
        "exceed the bound, and so may single steps in which the servo responds to the resolution and noise of its encoders."
    )
    return table_of(f"cell-spots-{slug(b.block.id)}", b.block.title, SPOT_COLUMNS, groups, note)
