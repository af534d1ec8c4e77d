"""Tables of a block of timed lines: laws and peers, limit violations, whole plans, and the compared methods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from benchmarks.blocks._contest import version_words
from benchmarks.blocks._torques import JOINT_LIMITS
from benchmarks.blocks.timing.laws.rows import NEARLY, ON_PATH_M, in_group
from benchmarks.records import slug
from benchmarks.report.tables import Column, Table
from benchmarks.statistics import median_interval, percentage, quantiles
from optik.types import Array
from planners.limits import DERIVATIVES

if TYPE_CHECKING:
    from benchmarks.blocks.timing.laws.rows import LawRows
    from benchmarks.report.run import Run
    from benchmarks.report.tables import Cell

TORQUE_NOTE = (
    "Torques are those of this model of the arm: bounds proved for every instant, with Coulomb friction. The torque rate is "
    "without Coulomb friction."
)
"""Note of every table with torques."""

LAW_COLUMN = Column("label", "Law", show="text")
"""First column of every table."""


def limited(rows: pl.DataFrame) -> list[str]:
    """Return the limits on joints that some motion has: those on torque only if they were requested."""
    return [field for field in JOINT_LIMITS if field in DERIVATIVES or rows[field].is_not_null().any()]


def _words(field: str) -> str:
    return field.replace("_", " ")


def law_tables(b: LawRows) -> list[Table]:
    """Return a table for each kind of line on all arms, then for each arm."""
    whole, parts = [], []
    for kind in b.block.kinds:
        rows = in_group(b.rows, kind)
        robots = rows["robot"].unique(maintain_order=True).to_list()
        if not robots:
            continue
        words = kind.replace("_", "-")
        whole.append(laws_table(b, rows, f"{b.block.title}, {words}: {', '.join(robots)}", slug(kind)))
        if len(robots) > 1:
            parts += [
                laws_table(
                    b, rows.filter(pl.col("robot") == robot), f"{b.block.title}, {words}: {robot} alone",
                    f"{slug(kind)}-{slug(robot)}",
                )
                for robot in robots
            ]  # fmt: skip
    return whole + parts


def laws_table(b: LawRows, rows: pl.DataFrame, title: str, name: str) -> Table:
    """Return every law and peer on some lines: unchanged, within 0.1 %, and after a uniform slow-down."""
    ms, fields = "ms", limited(rows)
    columns = (
        LAW_COLUMN,
        Column("kept", "within every limit", "%", "more", "share"),
        *([Column("over_torque", "over a torque limit", "%", "less", "share")] if "torque" in fields else []),
        Column("nearly", "within 0.1 %", "%", "more", "share"),
        Column("worst", "largest peak / limit", show="limit"),
        Column("as_is", "T / T*, unchanged"),
        Column("slowed_down", "T / T*, stretched to meet the limits", "", "less"),
        Column("ms", "median time of a call", ms, "less"),
        Column("count", "motions requested", show="count"),
        Column("found", "motions found", "%", "more", "share", aside=True),
        Column("worst_slowed_down", "largest T / T*, stretched to meet the limits", "", "less", aside=True),
        *(Column(field, f"largest {_words(field)} / limit", show="limit", aside=field != "torque") for field in fields),
        Column("holds", "certificate valid", show="text", aside=True),
        Column("stretched", "largest stretch by plan", show="precise", aside=True),
        Column("jerk_median", "median jerk at 1 kHz", "rad/s³", aside=True),
        Column("jerk_worst", "largest jerk at 1 kHz", "rad/s³", aside=True),
        Column("distance", "largest distance from the path", "µm", "less", aside=True),
        Column("angle", "largest rotation from the path", "µrad", "less", aside=True),
        Column("ms_p95", "p95 time of a call", ms, "less", aside=True),
    )
    found: list[Mapping[str, Cell]] = []
    for label, about in b.entries.items():
        own = rows.filter(pl.col("method") == label)
        if own.is_empty():
            found.append({"label": label, "kept": "absent" if "absent" in about else "not requested"})
        else:
            found.append({"label": label} | _law_cells(own, about))
    return Table(f"timing-{slug(b.block.id)}-{name}", title, columns, tuple(found), _note(b, rows))


def _law_cells(own: pl.DataFrame, about: Mapping[str, Any]) -> dict[str, Cell]:
    good = own.filter("solved")
    slowed = or_infinite(own["kept_over_optimum"])
    cells: dict[str, Cell] = {
        "kept": share_of(own["keeps_all"]), "nearly": share_of(own["nearly"]), "found": share_of(own["solved"]),
        "as_is": median_interval(or_infinite(own["over_optimum"])), "slowed_down": median_interval(slowed),
        "worst_slowed_down": float(slowed.max()), "count": len(own),
    }  # fmt: skip
    times = quantiles(own["ms_law"].drop_nulls().to_numpy(), (0.5, 0.95))
    cells |= dict(zip(("ms", "ms_p95"), times, strict=True))
    if good.is_empty():
        return cells
    stretched = good["slowed"].drop_nulls().to_numpy()
    share = 100.0 * float(good["holds"].to_numpy().mean())
    cells["over_torque"] = share_of(good["over_torque"])
    return (
        cells
        | {field: _largest(good[field]) for field in JOINT_LIMITS}
        | {
            "worst": _largest(good["worst"]), "holds": f"{share:.1f} %" if about["enforced"] else "nothing enforced",
            "stretched": float(stretched.max()) if len(stretched) else None,
            "jerk_median": float(np.median(good["sampled_jerk"].to_numpy())), "jerk_worst": _largest(good["sampled_jerk"]),
            "distance": _largest(good["distance"], 1e6), "angle": _largest(good["angle"], 1e6),
        }
    )  # fmt: skip


def or_infinite(column: pl.Series) -> Array:
    """Return the values of a column, infinity if there is none: a line without a motion is not left out."""
    return column.cast(pl.Float64).fill_null(float("inf")).to_numpy()


def share_of(column: pl.Series) -> tuple[float, float, float]:
    """Return the fraction of rows at which a column is true, with Wilson's interval."""
    return percentage(int(column.fill_null(value=False).sum()), len(column))


def _largest(column: pl.Series, scale: float = 1.0) -> float | None:
    values = column.drop_nulls().to_numpy()
    return scale * float(values.max()) if len(values) else None


def _note(b: LawRows, rows: pl.DataFrame) -> str:
    sentences = [
        "Each path counts once for each set of limits. Without a motion, T / T* is infinite. Ratios are exact and the largest "
        f"of all motions. Within 0.1 %: no value above {NEARLY:g} times its limit. Stretched to meet the limits: the same "
        "motion after uniform time scaling; T* is the shortest such duration. A motion does not count if it is more than "
        f"{1e6 * ON_PATH_M:g} µm off its path or does not cover it. Medians have 95 % bootstrap intervals, rates Wilson's."
    ]
    if "torque" in limited(rows):
        sentences.append(TORQUE_NOTE)
    for label, about in b.entries.items():
        own = rows.filter((pl.col("method") == label) & pl.col("solved"))
        if "absent" in about:
            sentences.append(f"{label}: {about['absent']}.")
        elif len(own) and not own["follows"].all():
            sentences.append(f"{label}: {int((~own['follows']).sum()):,} motions leave the path or do not cover it.")
        if len(own) and (unbounded := int(own["least_duration"].is_infinite().fill_null(value=False).sum())):
            sentences.append(f"{label}: jerk unbounded in {unbounded:,} motions; no time scaling meets a jerk limit.")
        failed = rows.filter((pl.col("method") == label) & ~pl.col("solved"))
        if len(failed):
            sentences.append(f"{label}: no motion on {len(failed):,} ({failed['reason'][0]}).")
    return " ".join(sentences)


# ---------------------------------------------------------------- violations, plans, settings


def violations(b: LawRows) -> Table | None:
    """Return limit violations of every law: how often, by how much, and the duration without violations."""
    found: list[tuple[int, str, dict[str, Cell]]] = []
    fields = limited(b.rows)
    good = b.rows.filter(pl.col("solved") & (pl.col("entry") != "reference"))
    order = {label: i for i, label in enumerate(b.block.labels)}
    for (label, limits), rows in good.group_by("method", "limits", maintain_order=True):
        broken = rows.filter(pl.col("breaks") != "")
        if broken.is_empty():
            continue
        row: dict[str, Cell] = {"label": str(label), "limits": str(limits), "count": len(rows)}
        for field in fields:
            row[field] = share_of(rows[field] > 1.0)
            row[f"{field}_worst"] = _largest(rows[field])
        row["now"] = float(np.median(rows["duration"].to_numpy()))
        row["least"] = float(np.median(broken["least_duration"].to_numpy()))
        found.append((order[str(label)], str(limits), row))
    if not found:
        return None
    columns = [LAW_COLUMN, Column("limits", "Limits", show="text"), Column("count", "motions", show="count")]
    for field in fields:
        columns += [
            Column(field, f"{_words(field)} exceeded in", "%", "less", "share"),
            Column(f"{field}_worst", f"largest {_words(field)} / limit", show="limit"),
        ]
    columns += [Column("now", "median T", "s", show="precise")]
    columns += [Column("least", "median T of the violating motions, stretched to meet the limits", "s", show="precise")]
    rows_ = tuple(row for _, _, row in sorted(found, key=lambda item: item[:2]))
    title = f"{b.block.title}: limit violations, enforced or not"
    return Table(f"timing-{slug(b.block.id)}-violations", title, tuple(columns), rows_)


def plan_times(b: LawRows) -> Table | None:
    """Return the computing times of the steps of a whole plan, by arm and kind of line."""
    steps = {"ms_follow": "follow", "ms_law": "law", "ms_certificate": "certificate", "ms_plan": "whole plan"}
    timed = b.rows.filter(pl.col("ms_plan").is_not_null())
    found: list[Mapping[str, Cell]] = []
    for (robot, kind), rows in timed.group_by("robot", "kind", maintain_order=True):
        row: dict[str, Cell] = {"label": f"{robot}, {str(kind).replace('_', '-')}", "count": len(rows)}
        for column in steps:
            times = quantiles(rows[column].drop_nulls().to_numpy(), (0.5, 0.95))
            row |= dict(zip((column, f"{column}_p95"), times, strict=True))
        found.append(row)
    if not found:
        return None
    columns = [Column("label", "Lines", show="text"), Column("count", "plans", show="count")]
    columns += [Column(key, f"{words}, median", "ms", "") for key, words in steps.items()]
    columns += [Column(f"{key}_p95", f"{words}, p95", "ms", "", aside=True) for key, words in steps.items()]
    title = f"{b.block.title}: computing time of a whole plan with {timed['method'][0]}, by step"
    return Table(f"timing-{slug(b.block.id)}-plans", title, tuple(columns), tuple(found))


def compared(b: LawRows) -> Table:
    """Return the enforced limits of each law and peer, its version and its settings."""
    columns = (
        LAW_COLUMN,
        Column("promises", "enforces", show="text"),
        Column("version", "version", show="text"),
        Column("settings", "settings", show="text"),
    )
    rows = [
        {
            "label": label, "promises": ", ".join(k.replace("_", " ") for k in about["enforced"]) or "nothing",
            "version": version_words(about), "settings": about["settings"],
        }
        for label, about in b.entries.items()
    ]  # fmt: skip
    title = f"{b.block.title}: versions and settings"
    return Table(f"timing-{slug(b.block.id)}-compared", title, columns, tuple(rows))


def all_tables(run: Run) -> list[Table]:
    """Return tables of all blocks."""
    found = []
    for b in run.of("laws"):
        found += [*law_tables(b), violations(b), plan_times(b), compared(b)]
    return [table for table in found if table is not None]
