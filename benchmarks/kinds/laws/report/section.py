"""Section: time laws and peers on many lines, against the shortest motion known, with their targets."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from benchmarks.kinds.laws.measures import in_group
from benchmarks.kinds.laws.report.example import example_boards
from benchmarks.kinds.laws.rows import LawRows
from benchmarks.report.board import Board, Control, Json, Key, Plot
from benchmarks.report.figures import HOVER, axis, lean, line
from benchmarks.report.numbers import number, percent, ratio
from benchmarks.report.run import Run
from benchmarks.report.tables import share, target_row
from optik.registry import short_name
from planners.limits import DERIVATIVES

EVERY = "every line"
"""The group of all lines, in a control of the page."""

LINE_SHARES = np.linspace(0.0, 1.0, 201)
"""Shares of lines at which a distribution is drawn."""

RATIO_TICKS = (0.3, 0.5, 0.7, 1.0, 1.5, 2, 3, 5, 10, 20, 50)
"""Numbers on the axes of T / T*."""

LEAST_EXCESS = 0.01
"""Excess over T* [%] that is drawn for all that come nearer: a logarithmic axis has no 0."""


def timing(run: Run) -> dict[str, Any]:
    """For every block: targets, a table for each group of lines, plots, limit violations, whole plans, and one line in detail.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    dict
        What the template shows.
    """
    return {"blocks": [_block(b, run) for b in run.of("laws")]}


def findings(run: Run) -> list[str]:
    """Durations and times of every law of ours, and of the peers that were installed, on all lines.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    list of str
        One sentence for each block.
    """
    return [words for b in run.of("laws") if (words := _medians(b))]


def _medians(b: LawRows) -> str:
    words = []
    for label in b.entries:
        rows = b.rows.filter((pl.col("law") == label) & pl.col("solved"))
        if rows.is_empty():
            continue
        kept = int(rows["keeps_all"].sum())
        keeps = "keeps every limit"
        if kept < len(rows):
            keeps += f" on {percent(100.0 * kept / len(rows))}"
        ratio_, ms = (float(np.median(rows[column].to_numpy())) for column in ("over_optimum", "ms_law"))
        words.append(f"{label} {number(ratio_, 4)} T* ({keeps}, {number(ms)} ms)")
    lines = b.rows["line"].n_unique()
    return f"{b.block.title}, {lines:,} of them, medians: " + "; ".join(words) + "." if words else ""


def _block(b: LawRows, run: Run) -> dict[str, Any]:
    block = b.block
    groups = _groups(b)
    return {
        "id": block.id, "title": block.title, "samples": block.samples, "rounds": block.rounds, "ik": short_name(block.ik),
        "limits": [part.label for part in block.limits], "reference": _reference(b),
        "done": b.rows["line"].n_unique(), "count": sum(part.count for part in block.lines),
        "sets": [(short_name(part.robot), part.kind.replace("_", "-"), part.count) for part in block.lines],
        "targets": [target_row(o) for o in run.outcomes if o.block == block.id],
        "tables": [_table(b, run, title, rows, is_open) for title, rows, is_open in groups],
        "boards": [_durations(b, run), _against_singularity(b, run)],
        "broken": _broken(b, run), "plans": _plans(b),
        "entries": [_entry(label, about, run) for label, about in b.entries.items()],
        "example": example_boards(b, run),
    }  # fmt: skip


def _reference(b: LawRows) -> str:
    entry = b.block.reference
    if entry is None:
        return ""
    return f"{entry.name} ({entry.words})" if entry.words else str(entry.name)


def _groups(b: LawRows) -> list[tuple[str, pl.DataFrame, bool]]:
    """Title, rows and whether its table is open: kinds of lines on all arms first, then each arm."""
    several = len(b.block.robots) > 1
    found = []
    for kind in b.block.kinds:
        rows = in_group(b.rows, kind)
        if not rows.is_empty():
            robots = rows["robot"].unique(maintain_order=True).to_list()
            found.append((f"{kind.replace('_', '-').capitalize()} lines: {', '.join(robots)}", rows, True))
            if several and len(robots) > 1:
                for robot in robots:
                    title = f"{kind.replace('_', '-').capitalize()} lines of {robot}"
                    found.append((title, rows.filter(pl.col("robot") == robot), False))
    return found


# ---------------------------------------------------------------- tables


def _table(b: LawRows, run: Run, title: str, rows: pl.DataFrame, is_open: bool) -> dict[str, Any]:
    return {
        "title": title, "open": is_open, "lines": rows["line"].n_unique(),
        "rows": [_law_row(label, about, rows.filter(pl.col("law") == label), run) for label, about in b.entries.items()],
    }  # fmt: skip


def _law_row(label: str, about: dict[str, Any], rows: pl.DataFrame, run: Run) -> dict[str, Any]:
    row: dict[str, Any] = {"label": label, "kind": about["kind"], "colour": run.colour(label), "absent": ""}
    if "absent" in about or rows.is_empty():
        return row | {"absent": about.get("absent", "no rows: it was given none of these lines, or not yet")}
    good = rows.filter("solved")
    row |= {"count": len(rows), "solved": share(len(good), len(rows)), "ms": _spread(rows["ms_law"])}
    if good.is_empty():
        return row | {"absent": f"no motion on {len(rows):,} lines: {rows['reason'][0]}"}
    worst = {field: float(good[field].to_numpy().max()) for field in DERIVATIVES}
    slowed = good["slowed"].drop_nulls().to_numpy()
    return row | {
        "optimum": (float(np.median(good["over_optimum"].to_numpy())), float(good["over_optimum"].to_numpy().max())),
        "worst": {field: (ratio(value), value > 1.0) for field, value in worst.items()},
        "keeps": share(int(good["keeps_all"].sum()), len(good))[0],
        "holds": share(int(good["holds"].sum()), len(good))[0] if about["keeps"] else "no promise",
        "slowed": f"{float(slowed.max()):.6g}" if len(slowed) else "–",
        "jerk": [number(float(pick(good["sampled_jerk"].to_numpy()))) for pick in (np.median, np.max)],
        "distance": number(1e6 * float(good["distance"].to_numpy().max())),
        "angle": number(1e6 * float(good["angle"].to_numpy().max())),
    }


def _spread(column: pl.Series) -> tuple[float, float]:
    values = column.drop_nulls().to_numpy()
    return float(np.median(values)), float(np.quantile(values, 0.95))


def _broken(b: LawRows, run: Run) -> list[dict[str, Any]]:
    """Limit violations of every law: how often, by how much, and the duration at which there would be none."""
    found = []
    good = b.rows.filter(pl.col("solved") & (pl.col("entry") != "reference"))
    for (label, limits), rows in good.group_by("law", "limits", maintain_order=True):
        broken = rows.filter(pl.col("breaks") != "")
        if broken.is_empty():
            continue
        fields = []
        for field in DERIVATIVES:
            values = rows[field].to_numpy()
            share_ = 100.0 * float((values > 1.0).mean())
            fields.append((f"{share_:.0f} %", number(float(np.median(values))), ratio(float(values.max()))))
        least, optimum = broken["least_duration"].to_numpy(), broken["optimum"].to_numpy()
        found.append(
            {
                "label": label, "kind": b.entries[str(label)]["kind"], "colour": run.colour(str(label)),
                "limits": limits, "count": len(rows), "fields": fields,
                "now": number(float(np.median(rows["duration"].to_numpy()))),
                "least": tuple(number(float(x)) for x in (np.median(least), least.max())),
                "over": number(float(np.median(least / optimum))),
            }
        )  # fmt: skip
    order = {label: i for i, label in enumerate(b.block.labels)}
    return sorted(found, key=lambda row: (order[row["label"]], str(row["limits"])))


def _plans(b: LawRows) -> list[dict[str, Any]]:
    """Where the time of a whole plan goes, by kind of line."""
    found = []
    for (robot, kind), rows in b.rows.filter(pl.col("ms_plan").is_not_null()).group_by(
        "robot", "kind", maintain_order=True
    ):
        steps = [_spread(rows[column]) for column in ("ms_follow", "ms_law", "ms_certificate", "ms_plan")]
        found.append(
            {
                "robot": robot,
                "kind": str(kind).replace("_", "-"),
                "count": len(rows),
                "law": rows["law"][0],
                "steps": steps,
            }
        )
    return found


def _entry(label: str, about: dict[str, Any], run: Run) -> dict[str, Any]:
    return {
        "label": label, "kind": about["kind"], "colour": run.colour(label),
        "version": about["version"] or ("–" if about["kind"] == "peer" else "this one"),
        "settings": about["settings"], "promises": ", ".join(k.replace("_", " ") for k in about["keeps"]) or "nothing",
    }  # fmt: skip


# ---------------------------------------------------------------- plots


def _durations(b: LawRows, run: Run) -> Board:
    """Durations over T*: of all motions as they are, and after slowing until every limit is kept."""
    plain = Plot(
        "timing-distribution", "Share of lines with a duration of at most this multiple of T*",
        {"xaxis": _ticked("T / T*", RATIO_TICKS), "yaxis": axis("lines [%]", range=[-2, 102])}, 400,
    )  # fmt: skip
    kept = Plot(
        "timing-profile", "The same, slowed until every limit is kept: excess over T*",
        {"xaxis": _ticked("T / T* − 1 [%]", (0.01, 0.1, 1, 10, 100, 1000)), "yaxis": axis("lines [%]", range=[-2, 102])}, 400,
    )  # fmt: skip
    groups = [EVERY, *b.block.kinds] + (list(map(short_name, b.block.robots)) if len(b.block.robots) > 1 else [])
    for group in groups:
        part = in_group(b.rows, "" if group == EVERY else group)
        for label, about in b.entries.items():
            rows = part.filter(pl.col("law") == label)
            if "absent" in about or rows.is_empty():
                continue
            look = _look(label, about, run)
            _steps(plain, label, look, rows.filter("solved")["over_optimum"].to_numpy(), len(rows), group, "× T*")
            slowed = rows.filter("solved")["kept_over_optimum"].to_numpy()
            excess = 100.0 * (slowed[np.isfinite(slowed)] - 1.0)
            _steps(kept, label, look, np.maximum(excess, LEAST_EXCESS), len(rows), group, "% longer")
    names = [(g, g.replace("_", "-") + (" lines" if g in b.block.kinds else "")) for g in groups]
    return Board(
        f"{b.block.id}-durations", (plain, kept), (Control("group", "Lines", tuple(names)),), _legend(b, run),
        "First: all motions as they are; one that breaks a limit may be shorter than T*. Then: the duration to which a motion "
        "must be slowed, uniformly, until its exact velocity, acceleration and jerk keep the limits. A law whose acceleration "
        f"jumps has none. What comes nearer than {LEAST_EXCESS:g} % is drawn there. Solid: ours; dotted: peers.",
    )  # fmt: skip


def _ticked(title: str, ticks: tuple[float, ...]) -> Json:
    """A logarithmic axis with these numbers on it."""
    return axis(title, type="log", tickvals=list(ticks), ticktext=[f"{x:g}" for x in ticks])


def _steps(plot: Plot, label: str, look: Json, values: Any, count: int, group: str, unit: str) -> None:
    """Share of lines [%] at or below each value."""
    if not len(values):
        return
    x = np.quantile(values, LINE_SHARES, method="inverted_cdf")
    trace = line(
        x=lean(x, 6), y=lean(100.0 * LINE_SHARES * len(values) / count, 6), name=label, line=look | {"shape": "hv"},
        hovertemplate=f"{label}<br>%{{y:.3~g}} % of the lines within %{{x:.4g}} {unit}{HOVER}",
    )  # fmt: skip
    plot.add(trace, {"group": [group]})


def _look(label: str, about: dict[str, Any], run: Run) -> Json:
    return {"color": run.colour(label), "width": 2, "dash": "dot" if about["kind"] == "peer" else "solid"}


def _legend(b: LawRows, run: Run) -> tuple[Key, ...]:
    here = set(b.rows["law"])
    return tuple(
        Key(label, run.colour(label), "dashed" if about["kind"] == "peer" else "solid")
        for label, about in b.entries.items()
        if label in here
    )


def _against_singularity(b: LawRows, run: Run) -> Board:
    """Durations and their ratio to T* over the smallest singular value on the way."""
    across = _ticked("smallest singular value on the line", (0.02, 0.03, 0.05, 0.1, 0.2, 0.3))
    seconds = _ticked("T [s]", (0.2, 0.3, 0.5, 1, 2, 3, 5, 10))
    plots = (
        Plot("timing-sigma-duration", "Duration", {"xaxis": across, "yaxis": seconds}, 400),
        Plot("timing-sigma-ratio", "Duration over T*", {"xaxis": across, "yaxis": _ticked("T / T*", RATIO_TICKS)}, 400),
    )
    for (label, limits), rows in b.rows.filter("solved").group_by("law", "limits", maintain_order=True):
        about = b.entries.get(str(label))
        if about is None:
            continue
        for plot, column in zip(plots, ("duration", "over_optimum"), strict=True):
            colour = run.colour(str(label))
            marker = {"color": colour, "size": 5, "opacity": 0.75, "symbol": "circle"}
            if about["kind"] == "peer":
                marker |= {"symbol": "x-thin", "size": 6, "line": {"width": 1.5, "color": colour}}
            trace = line(
                mode="markers", x=lean(rows["singular_value"], 4), y=lean(rows[column], 5), name=str(label), marker=marker,
                text=[f"{r} {k.replace('_', '-')} {i}" for r, k, i in rows.select("robot", "kind", "index").iter_rows()],
                hovertemplate=f"{label}<br>%{{text}}<br>σ = %{{x:.3g}}: %{{y:.4g}}{HOVER}",
            )  # fmt: skip
            plot.add(trace, {"limits": [str(limits)]})
    controls = (Control.of("limits", "Limits [rad/s, rad/s², rad/s³]", [part.label for part in b.block.limits]),)
    return Board(
        f"{b.block.id}-singularity", plots, controls, _legend(b, run),
        "One point a line and law. A law with one bound for the whole line is paced by its worst place: it falls behind to the "
        "left, where a singularity is near. Dots: ours; crosses: peers.",
    )  # fmt: skip
