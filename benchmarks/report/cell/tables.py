"""Tables of the executed cell: spots by method and budget, figures of ISO 9283, and the costs of each time law."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.cell.iso9283 import SIMULATED, PoseFigures
from benchmarks.blocks.cell.laws import OWN_TIME, SAME_TIME
from benchmarks.blocks.cell.settings import (
    PATH_TEST,
    POSE_TEST,
    CellBlock,
    IsoBlock,
    LawsBlock,
    Noise,
    SpotsBlock,
    figures_of,
    share_within,
)
from benchmarks.blocks.columns import Of, count, largest, median
from benchmarks.records import slug
from benchmarks.report.base import Run
from benchmarks.report.tables import Cell, Column, Group, Table, table_of
from benchmarks.statistics import quantiles
from optik.types import Array

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

ISO_COLUMNS = (
    Column("label", "Noise", show="text"),
    Column("what", f"Figure ({SIMULATED})", show="text"),
    Column("at", "At", show="text"),
    Column("accuracy", "AP or AT", "mm"),
    Column("repeatability", "RP or RT", "mm"),
    Column("turn", "AP of the angles", "mrad"),
    Column("turn_repeatability", "RP of the angles", "mrad"),
    Column("cycles", "cycles", show="count"),
    Column("reason", "Remark", show="text"),
)
"""Columns of a table of ISO 9283; angles are the largest component of the rotation vector."""

WITHOUT_NOISE = pl.col("repeat") == 0
"""Whether a motion was executed without noise."""

COST_COLUMNS = (
    Column("label", "Law", show="text"),
    Column("duration", "duration", "s", "less", of=median("duration", among=WITHOUT_NOISE)),
    Column("tracking", "tracking error of the tool", "mm", "less", of=largest("tracking_m", 1e3, among=WITHOUT_NOISE)),
    Column(
        "noisy", "largest tracking error with noise", "mm", "less", of=largest("tracking_m", 1e3, among=~WITHOUT_NOISE)
    ),
    Column("joint", "tracking error of a joint", "mrad", "less", of=largest("tracking_rad", 1e3, among=WITHOUT_NOISE)),
    Column("torque", "largest torque / certificate's bound", "", "", "limit"),
    Column("torque_joint", "of joint", show="text"),
    Column("peak", "its largest torque", "N·m"),
    Column("bound", "its bound", "N·m"),
    Column("limit", "largest torque / motor limit", "", "", "limit"),
    Column("proved", "bound / motor limit", "", "", "limit", aside=True),
    Column("energy", "energy", "J", "less", of=median("energy", among=WITHOUT_NOISE)),
    Column(
        "acceleration", "acceleration / limit", "", "", "limit", of=largest("acceleration_ratio", among=WITHOUT_NOISE)
    ),
    Column("jerk", "jerk / limit", "", "", "limit", of=largest("jerk_ratio", among=WITHOUT_NOISE)),
    Column("rest", "error at the end", "mm", "less", aside=True, of=median("rest_m", 1e3, among=WITHOUT_NOISE)),
    Column(
        "status", "Status", show="text", aside=True, of=lambda rows: ", ".join(sorted(set(rows["status"].drop_nulls())))
    ),
)
"""Columns of a table of time laws."""


def cell_blocks(run: Run, kind: type[CellBlock]) -> list[BlockRows]:
    """Return the blocks of one class that have rows."""
    return [b for b in run.of("cell") if isinstance(b.block, kind)]


def spots_blocks(run: Run) -> list[BlockRows]:
    """Return the blocks of spots that have rows."""
    return cell_blocks(run, SpotsBlock)


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
    found = [spots_table(b) for b in spots_blocks(run)] + [iso_table(b) for b in cell_blocks(run, IsoBlock)]
    return [*found, *(table for b in cell_blocks(run, LawsBlock) for table in law_tables(b, run))]


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


def iso_table(b: BlockRows) -> Table:
    """Return accuracy and repeatability of each pose and of the path."""
    rows: list[dict[str, Cell]] = []
    for label in b.block.labels:
        part = b.rows.filter(pl.col("method") == label)
        points = part.filter(pl.col("test") == POSE_TEST)["problem"].drop_nulls().unique().sort().to_list()
        for found, point in zip(figures_of(part), [*points, None], strict=False):
            row: dict[str, Cell] = {
                "label": label, "accuracy": 1e3 * found.accuracy, "cycles": found.cycles, "reason": found.reason,
                "repeatability": None if found.repeatability is None else 1e3 * found.repeatability,
            }  # fmt: skip
            if isinstance(found, PoseFigures):
                three = found.turn_repeatability
                row |= {
                    "what": "AP, RP", "at": f"P{point}", "turn": 1e3 * float(np.abs(found.turn).max()),
                    "turn_repeatability": None if three is None else 1e3 * float(three.max()),
                }  # fmt: skip
            else:
                row |= {"what": "AT, RT", "at": _where(part, found.at)}
            rows.append(row)
    note = (
        f"All figures are {SIMULATED}, in the manner of ISO 9283: AP is the distance of the mean of the reached positions from "
        "the commanded one; RP = l̄ + 3 S of the distances l from that mean, S with n − 1; AT and RT are the largest of these "
        "along the line, where the executed path meets its normal planes. Friction, payload and encoder noise "
        "are sampled anew for each cycle. Without noise, repeatability is not applicable."
    )
    return Table(f"cell-iso-{slug(b.block.id)}", b.block.title, ISO_COLUMNS, tuple(rows), note)


def _where(part: pl.DataFrame, point: int) -> str:
    most = part.filter(pl.col("test") == PATH_TEST)["problem"].max()
    return f"{100.0 * point / float(most or 1):.0f} % of the line"  # type: ignore[arg-type]


def law_tables(b: BlockRows, run: Run) -> list[Table]:
    """Return the costs of each law on the plant: at its own duration, and slowed to a common one."""
    found, limits = [], _torque_limits(run, b.block.robot)
    for timed, words in (
        (OWN_TIME, "each law's own duration"),
        (SAME_TIME, "all stretched to the longest duration"),
    ):
        rows = b.rows.filter(pl.col("timed") == timed)
        if rows.is_empty():
            continue
        parts = [(law, rows.filter(pl.col("method") == law)) for law in b.block.labels]
        groups = [({"label": law} | _torques(part.filter(WITHOUT_NOISE), limits), part) for law, part in parts]
        note = (
            f"For {_lines(rows)}: median duration, energy and end error, and the largest value of all other columns, "
            "without noise unless a column says so. The tracking error is executed − planned at the same instant, at every "
            "step of the plant. The bound is the certificate's largest |torque|; single steps in which the servo responds to "
            "the resolution of its encoders may exceed it. Energy is the integral of the positive powers torque · velocity "
            "of all joints, without recovery while braking. "
            f"{SIMULATED.capitalize()}."
        )
        name = f"cell-laws-{slug(b.block.id)}" + ("" if timed == OWN_TIME else "-same")
        found.append(table_of(name, f"{b.block.title}: {words}", COST_COLUMNS, groups, note))
    return found


def _torque_limits(run: Run, robot: str) -> Array | None:
    """Return the largest torque of each motor (n,) [N·m, N]; None if the arm states none."""
    torque = run.robot(robot).limits.torque
    return None if torque is None else np.abs(np.atleast_2d(np.asarray(torque, dtype=float))).max(axis=0)


def _lines(rows: pl.DataFrame) -> str:
    count = rows["problem"].n_unique()
    return "one line" if count == 1 else f"{count} lines"


def _torques(still: pl.DataFrame, limits: Array | None) -> dict[str, Cell]:
    """Return the largest torque over its bound, with its joint, and over the limit of its motor."""
    worst = still.filter(pl.col("torque_ratio") == pl.col("torque_ratio").max())
    if worst.is_empty():
        return {}
    first = worst.row(0, named=True)
    joint = int(np.argmax(np.array(first["torque"]) / np.array(first["torque_bound"])))
    row: dict[str, Cell] = {
        "torque": first["torque_ratio"], "torque_joint": first["torque_joint"], "peak": first["torque"][joint],
        "bound": first["torque_bound"][joint],
    }  # fmt: skip
    if limits is not None:
        row |= {key: _over(still[column], limits) for key, column in (("limit", "torque"), ("proved", "torque_bound"))}
    return row


def _over(torques: pl.Series, limits: Array) -> float:
    """Return the largest ratio of torque to limit over several motions."""
    return float((np.array(torques.drop_nulls().to_list()) / limits).max())
