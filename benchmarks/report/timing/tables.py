"""Tables and plots of timed lines: laws and peers, limit violations, durations over T*, active limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.blocks.block import largest, mean, median, median_with_interval, quantile, share
from benchmarks.blocks.entries import JOINT_LIMITS, arm_label
from benchmarks.blocks.timing.rows import NEARLY, ON_PATH_M, in_group
from benchmarks.blocks.timing.settings import GIVEN_LINE
from benchmarks.records import slug
from benchmarks.report import boards
from benchmarks.report.base import Run
from benchmarks.report.boards import Board, Control, Sample, add, axis, figure, fraction_plot, line, ticked_axis
from benchmarks.report.tables import VERSION_COLUMNS, Cell, Column, Group, Table, quote_label, table_of, version_cells
from benchmarks.report.timing.line import law_table
from optik.check import format_count
from optik.registry import short_name
from planners.limits import DERIVATIVES, LOADED, limit_names

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


# ---------------- tables of a block of timed lines


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
    """Return a table for each kind of line, on all arms."""
    groups = [(kind, rows) for kind in b.block.kinds if len(rows := in_group(b.rows, kind))]
    arms = {kind: ", ".join(rows["robot"].unique(maintain_order=True)) for kind, rows in groups}
    return [
        laws_table(b, rows, f"{b.block.title}, {kind.replace('_', '-')}: {arms[kind]}", slug(kind))
        for kind, rows in groups
    ]


def laws_table(b: BlockRows, rows: pl.DataFrame, title: str, name: str) -> Table:
    """Return every law and peer on some lines: unchanged, within 0.1 %, and after a uniform slow-down."""
    ms, fields, stretched = "ms", limited(rows), "kept_over_optimum"
    jerk, valid = "sampled_jerk", mean("holds", 100.0, among="solved")

    def holds(group: pl.DataFrame) -> Cell:
        if not b.entries[group["method"][0]]["enforced"] and group["solved"].any():
            return "nothing enforced"
        rate = valid(group)
        return None if rate is None else f"{rate:.1f} %"

    columns = (
        LAW_COLUMN,
        Column("kept", "within every limit", "%", "more", "share", of=share("keeps_all")),
        *([Column("over_torque", "over a torque limit", "%", "less", "share", of=share("over_torque", among="solved"))]
          if "torque" in fields else []),
        Column("nearly", "within 0.1 %", "%", "more", "share", of=share("nearly")),
        Column("worst", "largest peak / limit", show="limit", of=largest("worst", among="solved")),
        Column("as_is", "T / T*, unchanged", of=median_with_interval("over_optimum")),
        Column("slowed_down", "T / T*, stretched to meet the limits", "", "less", of=median_with_interval(stretched)),
        Column("ms", "median time of a call", ms, "less", of=quantile("ms_law", 0.5)),
        Column("count", "motions requested", show="count", of=len),
        Column("found", "motions found", "%", "more", "share", aside=True, of=share("solved")),
        Column("worst_slowed_down", "largest T / T*, stretched to the limits", "", "less", aside=True, of=largest(stretched)),
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
        group = rows.filter(pl.col("method") == label)
        missing = "absent" if "absent" in about else "not requested"
        groups.append(({"label": label, "kept": missing}, None) if group.is_empty() else ({"label": label}, group))
    return table_of(f"timing-{slug(b.block.id)}-{name}", title, columns, groups, _note(b, rows))


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
        solved = rows.filter((pl.col("method") == label) & pl.col("solved"))
        if "absent" in about:
            sentences.append(f"{label}: {about['absent']}.")
        elif len(solved) and not solved["follows"].all():
            sentences.append(f"{label}: {int((~solved['follows']).sum()):,} motions leave the path or do not cover it.")
        endless = solved.filter(pl.col("least_duration").is_infinite())
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
    groups: list[tuple[dict[str, Cell], pl.DataFrame]] = []
    for (label, limits), rows in good.group_by("method", "limits", maintain_order=True):
        if (rows["breaks"] != "").any():
            groups.append(({"label": str(label), "limits": str(limits)}, rows))
    if not groups:
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
    ordered = sorted(groups, key=lambda group: (order[str(group[0]["label"])], str(group[0]["limits"])))
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
    columns = (LAW_COLUMN, Column("promises", "enforces", show="text"), *VERSION_COLUMNS)
    rows = [
        version_cells(about)
        | {"label": label, "promises": ", ".join(k.replace("_", " ") for k in about["enforced"]) or "nothing"}
        for label, about in b.entries.items()
    ]
    title = f"{b.block.title}: versions and settings"
    return Table(f"timing-{slug(b.block.id)}-compared", title, columns, tuple(rows))


def make_line_tables(run: Run) -> list[Table]:
    """Return tables of all blocks."""
    found: list[Table | None] = []
    for b in run.of("timing"):
        found += [law_table(run, b)] if b.block.detail else [*law_tables(b), violations(b), plan_times(b), compared(b)]
    return [table for table in found if table is not None]


# ---------------- plots of time laws


ACTIVE = 0.99
"""Distance to a limit up to which a constraint counts as active, relative to the limit [1]."""

LIMIT_COLOURS = {
    "velocity": 0, "acceleration": 1, "jerk": 2, "tool_speed": 3, "rotation_speed": 4, "torque": 5, "torque_rate": 6,
}  # fmt: skip
"""Number of the colour of each limit; further limits have the next one."""


def active_plot(name: str, near: pl.DataFrame, laws: Sequence[str], scale: float, unit: str) -> Figure:
    """Return a plot of the active limits along the path, with one row for each joint and limit."""
    rows = sorted(
        {(joint, limit) for joint, limit in near.select("joint", "limit").iter_rows()},
        key=lambda row: (limit_names().index(row[1]), row[0]),
    )
    names = [f"{joint} {limit.replace('_', ' ')}" for joint, limit in rows]
    across = axis("", type="category", categoryorder="array", categoryarray=names[::-1], range=[-0.6, len(names) - 0.4])
    plot = figure(name, "Active constraint along the path", f"s [{unit}]", across, max(220, 90 + 26 * len(names)))
    for law in laws:
        for (joint, limit), part in near.filter(pl.col("law") == law).group_by("joint", "limit", maintain_order=True):
            x: list[float | None] = []
            for start, end in part.select("from", "to").iter_rows():
                x += [scale * start, scale * end, None]
            words = f"{joint} {str(limit).replace('_', ' ')}"
            trace = line(
                x, [words] * len(x), digits=5, name=str(limit).replace("_", " "),
                line={"color": limit_colour(str(limit)), "width": 9}, hover=f"{words} at %{{x:.4g}} {unit}",
            )  # fmt: skip
            add(plot, trace, {"law": [law]})
    return plot


def limit_colour(limit: str) -> str:
    """Return the colour of a limit."""
    return boards.colour(LIMIT_COLOURS.get(limit, len(LIMIT_COLOURS)))


EVERY = "every path"
"""The group of all lines, in a control of the page."""

RATIO_TICKS = (0.3, 0.5, 0.7, 1.0, 1.5, 2, 3, 5, 10, 20, 50)
"""Numbers on the axes of T / T*."""

RATE_TICKS = (0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000)
"""Numbers on the axis of torque rates over their limits: without a limit on the rate they are tens of times too large."""

MOST_RATIO = 1000.0
"""Ratio of a torque or its rate to its limit at which larger ones are drawn: a plot has no infinity."""

LEAST_RATIO = 0.01
"""Ratio at which smaller ones are drawn."""

LEAST_EXCESS = 0.01
"""Excess over T* [%] at which smaller ones are drawn: a logarithmic axis has no 0."""


PATHS_WITHIN = "%{y:.3~g} % of the paths within %{x:.4g} "
"""Tooltip of a distribution, before the unit."""


def _samples(b: BlockRows, run: Run, rows: pl.DataFrame, groups: Sequence[str], value: pl.Expr) -> Iterator[Sample]:
    """Yield the values of each law and peer, for each group of lines."""
    for group in groups:
        part = in_group(rows, "" if group == EVERY else group)
        for label in b.entries:
            values = part.filter(pl.col("method") == label).select(value).to_series()
            yield Sample(label, values, run.look(label), {"group": [group]})


def durations(b: BlockRows, run: Run) -> Board:
    """Return the distribution of durations over T*: of the unchanged motions, and after time scaling to every limit."""
    groups = [EVERY, *b.block.kinds] + (list(b.block.arms) if len(b.block.arms) > 1 else [])
    plain = fraction_plot(
        "timing-distribution", "Paths with a duration of at most this multiple of T*", ticked_axis("T / T*", RATIO_TICKS),
        "paths", PATHS_WITHIN + "× T*", _samples(b, run, b.rows, groups, pl.col("over_optimum")), 400,
    )  # fmt: skip
    excess = (100.0 * (pl.col("kept_over_optimum") - 1.0)).clip(LEAST_EXCESS)
    kept = fraction_plot(
        "timing-profile", "After stretching to meet every limit: excess over T*",
        ticked_axis("T / T* − 1 [%]", (0.01, 0.1, 1, 10, 100, 1000)), "paths", PATHS_WITHIN + "% longer",
        _samples(b, run, b.rows, groups, excess), 400,
    )  # fmt: skip
    names = [(g, g.replace("_", "-")) for g in groups]
    return Board(
        f"{b.block.id}-durations", (plain, kept), (Control("group", "Paths", tuple(names)),),
        "First plot: all motions unchanged; one that exceeds a limit may be shorter than T*. Second plot: durations after "
        "uniform time scaling until all limits are met exactly. A law with discontinuous acceleration has no such duration. "
        f"Values below {LEAST_EXCESS:g} % are shown as {LEAST_EXCESS:g} %.",
    )  # fmt: skip


def torques(b: BlockRows, run: Run) -> Board | None:
    """Return the fraction of motions up to every multiple of their limits on torque and on its rate."""
    fields = [field for field in limited(b.rows) if field in LOADED]
    if not fields:
        return None
    plots = []
    groups = [EVERY, *b.block.arms] if len(b.block.arms) > 1 else [EVERY]
    for field in fields:
        words, ticks = field.replace("_", " "), RATIO_TICKS if field == "torque" else RATE_TICKS
        ratio = pl.col(field).clip(LEAST_RATIO, MOST_RATIO)
        plot = fraction_plot(
            f"timing-{field.replace('_', '-')}", f"Motions whose {words} stays within this multiple of its limit",
            ticked_axis(f"largest {words} / limit", ticks, range=_find_plot_range(b.rows[field])), "motions",
            PATHS_WITHIN + "times the limit", _samples(b, run, b.rows.filter("solved"), groups, ratio), 400,
        )  # fmt: skip
        plots.append(plot.add_vline(1.0, line={"color": boards.ALARM_COLOUR, "width": 1, "dash": "dash"}))
    return Board(
        f"{b.block.id}-torques", tuple(plots), (Control("group", "Arm", tuple((g, g) for g in groups)),) if groups[1:] else (),
        "Motions before time scaling: the worst joint of each, proved for every instant, for the arm's model. Right of the "
        "dashed line a motion exceeds the torque limits. Where the acceleration is discontinuous, the torque rate is "
        f"infinite. Values above {MOST_RATIO:g} are shown as {MOST_RATIO:g}.",
    )  # fmt: skip


def _find_plot_range(values: pl.Series) -> list[float]:
    """Return the decades that contain all plotted values, and the limit with some margin beyond it."""
    drawn = np.clip(values.drop_nulls().to_numpy(), LEAST_RATIO, MOST_RATIO)
    return [float(np.log10(0.9 * min(drawn.min(), 1.0))), float(np.log10(1.2 * max(drawn.max(), 1.0)))]


_METRES, _RADIANS = (1e3, "mm"), (1.0, "rad")
"""Scale and unit of the path parameter, of the tool and in joint space."""

FAR = 1e3
"""Curves that bound the speed are cut at this multiple of the speed of the fastest motion."""


def example_boards(b: BlockRows, run: Run) -> list[Board]:
    """Show the phase plane of all laws, and the active constraints of each."""
    motions, binding, curve = (b.table(name) for name in ("motions", "binding", "curve"))
    if motions is None or binding is None or curve is None or curve.is_empty():
        return []
    words = _which(b)
    unit = _RADIANS if b.block.example.kind == "joints" else _METRES
    return [_phase(b, run, motions, curve, words, unit), _constraints(b, motions, binding, words, unit)]


def _which(b: BlockRows) -> str:
    """Describe which path is shown; paths count from 1."""
    chosen, arm = b.block.example, arm_label(b.block.example.robot, b.block.example.payload)
    within = f"on {arm}, within the limits {quote_label(chosen.limits)}"
    if chosen.path or chosen.kind == GIVEN_LINE:
        return f"path {short_name(chosen.path) if chosen.path else 'given'} {within}"
    counts = [part.count for part in b.block.lines if (part.arm, part.kind) == (arm, chosen.kind)]
    of = f" of {counts[0]}" if counts and chosen.index < counts[0] else ""
    return f"{chosen.kind.replace('_', '-')} path number {chosen.index + 1}{of} {within}"


def _phase(
    b: BlockRows, run: Run, motions: pl.DataFrame, curve: pl.DataFrame, words: str, of: tuple[float, str]
) -> Board:
    scale, unit = of
    laws = motions["law"].unique(maintain_order=True).to_list()
    fastest = float(motions["speed"].to_numpy().max())
    plot = figure(
        "timing-phase", "Speed along the path and its limit curves", f"s [{unit}]",
        axis(f"ds/dt [{unit}/s]", range=[0, 1.25 * scale * fastest]), 440,
    )  # fmt: skip
    at = f"<br>%{{y:.4g}} {unit}/s at %{{x:.4g}} {unit}"
    bounds = (
        ("velocity", "velocities", boards.INK_COLOUR, "dash", "velocity limit of %{text}"),
        ("acceleration", "accelerations", boards.MUTED_COLOUR, "dot", "acceleration limits, for any path acceleration"),
    )
    for field, several, drawn, dash, meaning in bounds:
        trace = line(
            scale * curve["s"].to_numpy(), scale * np.minimum(curve[field].to_numpy(), FAR * fastest),
            name=f"limit curve of the joint {several}", text=curve["velocity_joint"].to_list(),
            line={"color": drawn, "width": 1.6, "dash": dash}, hover=meaning + at,
        )  # fmt: skip
        add(plot, trace)
    for law in laws:
        part = motions.filter(pl.col("law") == law)
        add(plot, line(
            scale * part["s"].to_numpy(), scale * part["speed"].to_numpy(), digits=5, name=law,
            line={"color": run.colour(law), "width": 2}, hover=law + at,
        ))  # fmt: skip
    return Board(
        f"{b.block.id}-phase", (plot,), (),
        f"The {words}. The dashed curves are the maximum-velocity curves: every motion above one of them exceeds a limit.",
    )  # fmt: skip


def _constraints(
    b: BlockRows, motions: pl.DataFrame, binding: pl.DataFrame, words: str, of: tuple[float, str]
) -> Board:
    """Show the active constraints of every law along the line, and the ratio of the joints to their limits."""
    laws = motions["law"].unique(maintain_order=True).to_list()
    near = binding.filter(pl.col("ratio") >= ACTIVE)
    initial = next((law for law in laws if law == b.block.plan), laws[0])
    return Board(
        f"{b.block.id}-who", (active_plot("timing-who", near, laws, *of), _ratios(motions, laws, of)),
        (Control.of("law", "Time law", laws, initial),),
        f"The {words}. First plot: where a joint is within {100 * (1 - ACTIVE):.0f} % of a limit, from the certificate. "
        "Second plot: the jerk of a law without a jerk limit is far above 1. Where its acceleration is discontinuous the jerk "
        "is infinite; the plot shows it between these points.",
    )  # fmt: skip


def _ratios(motions: pl.DataFrame, laws: list[str], of: tuple[float, str]) -> Figure:
    """Plot the largest ratio to its limit of every derivative along the line."""
    scale, unit = of
    plot = figure(
        "timing-ratios", "Largest value / limit of any joint", f"s [{unit}]",
        boards.log_axis("value / limit", dtick=1, range=[-2.3, 3.2]), shapes=[boards.band(1.0, 1e6, "beyond the limit")],
    )  # fmt: skip
    for law in laws:
        part = motions.filter(pl.col("law") == law)
        for field in (name for name in JOINT_LIMITS if name in part.columns and part[name].is_not_nan().any()):
            words = field.replace("_", " ")
            trace = line(
                scale * part["s"].to_numpy(), np.maximum(part[field].to_numpy(), 1e-4), digits=5, name=words,
                line={"color": limit_colour(field), "width": 1.6},
                hover=f"{words} %{{y:.4g}} of its limit at %{{x:.4g}} {unit}",
            )  # fmt: skip
            add(plot, trace, {"law": [law]})
    return plot
