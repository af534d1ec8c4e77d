"""Tables of a block of timed lines: laws and peers, limit violations, whole plans, and the compared methods."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import polars as pl

from benchmarks.blocks.arms import JOINT_LIMITS
from benchmarks.blocks.columns import largest, mean, median, median_with_interval, quantile, share
from benchmarks.blocks.contest import version_words
from benchmarks.blocks.timing.rows import NEARLY, ON_PATH_M, in_group
from benchmarks.records import slug
from benchmarks.report.tables import Cell, Column, Group, Table, table_of
from benchmarks.report.timing.line import law_table
from optik.check import format_count
from optik.types import Array
from planners.limits import DERIVATIVES

if TYPE_CHECKING:
    from benchmarks.blocks.base import BlockRows
    from benchmarks.report.base import Run

TORQUE_NOTE = (
    "Torques are those of this model of the arm: bounds proved for every instant, with Coulomb friction. The torque rate is "
    "without Coulomb friction."
)
"""Note of every table with torques."""

LAW_COLUMN = Column("label", "Law", show="text")
"""First column of every table."""


def limited(rows: pl.DataFrame) -> list[str]:
    """Return the limits of some motion; those on torque, and further ones, only if they were requested."""
    return [field for field in (*JOINT_LIMITS, "further") if field in DERIVATIVES or rows[field].is_not_null().any()]


def _words(field: str) -> str:
    return "further limit" if field == "further" else field.replace("_", " ")


def law_tables(b: BlockRows) -> list[Table]:
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


def _or_infinite(column: str) -> Callable[[pl.DataFrame], Array]:
    return lambda own: or_infinite(own[column])


def laws_table(b: BlockRows, rows: pl.DataFrame, title: str, name: str) -> Table:
    """Return every law and peer on some lines: unchanged, within 0.1 %, and after a uniform slow-down."""
    ms, fields, slowed = "ms", limited(rows), _or_infinite("kept_over_optimum")
    jerk, valid = "sampled_jerk", mean("holds", 100.0, among="solved")

    def holds(own: pl.DataFrame) -> Cell:
        if not b.entries[own["method"][0]]["enforced"] and own["solved"].any():
            return "nothing enforced"
        rate = valid(own)
        return None if rate is None else f"{rate:.1f} %"

    columns = (
        LAW_COLUMN,
        Column("kept", "within every limit", "%", "more", "share", of=share("keeps_all")),
        *([Column("over_torque", "over a torque limit", "%", "less", "share", of=share("over_torque", among="solved"))]
          if "torque" in fields else []),
        Column("nearly", "within 0.1 %", "%", "more", "share", of=share("nearly")),
        Column("worst", "largest peak / limit", show="limit", of=largest("worst", among="solved")),
        Column("as_is", "T / T*, unchanged", of=median_with_interval(_or_infinite("over_optimum"))),
        Column("slowed_down", "T / T*, stretched to meet the limits", "", "less", of=median_with_interval(slowed)),
        Column("ms", "median time of a call", ms, "less", of=quantile("ms_law", 0.5)),
        Column("count", "motions requested", show="count", of=len),
        Column("found", "motions found", "%", "more", "share", aside=True, of=share("solved")),
        Column("worst_slowed_down", "largest T / T*, stretched to meet the limits", "", "less", aside=True, of=largest(slowed)),
        *(
            Column(field, f"largest {_words(field)} / limit", show="limit", aside=field != "torque",
                   of=largest(field, among="solved"))
            for field in fields
        ),
        Column("holds", "certificate valid", show="text", aside=True, of=holds),
        Column("stretched", "largest stretch by plan", show="precise", aside=True, of=largest("slowed", among="solved")),
        Column("jerk_median", "median jerk at 1 kHz", "rad/s³", aside=True, of=median(jerk, among="solved")),
        Column("jerk_worst", "largest jerk at 1 kHz", "rad/s³", aside=True, of=largest(jerk, among="solved")),
        Column("distance", "largest distance from the path", "µm", "less", aside=True,
               of=largest("distance", 1e6, among="solved")),
        Column("angle", "largest rotation from the path", "µrad", "less", aside=True, of=largest("angle", 1e6, among="solved")),
        Column("ms_p95", "p95 time of a call", ms, "less", aside=True, of=quantile("ms_law", 0.95)),
    )  # fmt: skip
    groups: list[Group] = []
    for label, about in b.entries.items():
        own = rows.filter(pl.col("method") == label)
        missing = "absent" if "absent" in about else "not requested"
        groups.append(({"label": label, "kept": missing}, None) if own.is_empty() else ({"label": label}, own))
    return table_of(f"timing-{slug(b.block.id)}-{name}", title, columns, groups, _note(b, rows))


def or_infinite(column: pl.Series) -> Array:
    """Return the values of a column, infinity if there is none: a line without a motion is not left out."""
    return column.cast(pl.Float64).fill_null(float("inf")).to_numpy()


def _note(b: BlockRows, rows: pl.DataFrame) -> str:
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
        endless = own.filter(pl.col("least_duration").is_infinite())
        if unbounded := len(endless.filter(pl.any_horizontal(pl.col(DERIVATIVES).is_infinite()))):
            sentences.append(f"{label}: jerk unbounded in {unbounded:,} motions; no time scaling meets a jerk limit.")
        if beyond := len(endless) - unbounded:
            count = format_count(beyond, "motion")
            sentences.append(f"{label}: a limit is exceeded at rest in {count}; no time scaling meets it.")
        failed = rows.filter((pl.col("method") == label) & ~pl.col("solved"))
        if len(failed):
            sentences.append(f"{label}: no motion on {len(failed):,} ({failed['reason'][0]}).")
    return " ".join(sentences)


# ---------------------------------------------------------------- violations, plans, settings


def violations(b: BlockRows) -> Table | None:
    """Return limit violations of every law: how often, by how much, and the duration without violations."""
    good = b.rows.filter(pl.col("solved") & (pl.col("entry") != "reference"))
    order = {label: i for i, label in enumerate(b.block.labels)}
    found: list[tuple[dict[str, Cell], pl.DataFrame]] = []
    for (label, limits), rows in good.group_by("method", "limits", maintain_order=True):
        if (rows["breaks"] != "").any():
            found.append(({"label": str(label), "limits": str(limits)}, rows))
    if not found:
        return None
    columns = [LAW_COLUMN, Column("limits", "Limits", show="text"), Column("count", "motions", show="count", of=len)]
    for field in limited(b.rows):
        broken = (pl.col(field) > 1.0).fill_null(value=False)
        columns += [
            Column(field, f"{_words(field)} exceeded in", "%", "less", "share", of=share(broken)),
            Column(f"{field}_worst", f"largest {_words(field)} / limit", show="limit", of=largest(field)),
        ]
    least = "median T of the violating motions, stretched to meet the limits"
    columns += [
        Column("now", "median T", "s", show="precise", of=median("duration")),
        Column("least", least, "s", show="precise", of=median("least_duration", among=pl.col("breaks") != "")),
    ]
    ordered = sorted(found, key=lambda group: (order[str(group[0]["label"])], str(group[0]["limits"])))
    title = f"{b.block.title}: limit violations, enforced or not"
    return table_of(f"timing-{slug(b.block.id)}-violations", title, columns, ordered)


def plan_times(b: BlockRows) -> Table | None:
    """Return the computing times of the steps of a whole plan, by arm and kind of line."""
    steps = {"ms_follow": "follow", "ms_law": "law", "ms_certificate": "certificate", "ms_plan": "whole plan"}
    timed = b.rows.filter(pl.col("ms_plan").is_not_null())
    groups: list[Group] = [
        ({"label": f"{robot}, {str(kind).replace('_', '-')}"}, rows)
        for (robot, kind), rows in timed.group_by("robot", "kind", maintain_order=True)
    ]
    if not groups:
        return None
    columns = [Column("label", "Lines", show="text"), Column("count", "plans", show="count", of=len)]
    columns += [Column(key, f"{words}, median", "ms", of=quantile(key, 0.5)) for key, words in steps.items()]
    columns += [
        Column(f"{key}_p95", f"{words}, p95", "ms", aside=True, of=quantile(key, 0.95)) for key, words in steps.items()
    ]
    title = f"{b.block.title}: computing time of a whole plan with {timed['method'][0]}, by step"
    return table_of(f"timing-{slug(b.block.id)}-plans", title, columns, groups)


def compared(b: BlockRows) -> Table:
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
    found: list[Table | None] = []
    for b in run.of("timing"):
        found += [law_table(run, b)] if b.block.detail else [*law_tables(b), violations(b), plan_times(b), compared(b)]
    return [table for table in found if table is not None]
