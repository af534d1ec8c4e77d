"""Sections: the line with the arm that plays along it (Fig. 5 and 6), and the clearance over time."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from benchmarks.records import rows_file
from benchmarks.report.base import Run
from benchmarks.report.boards import Board, squeeze
from benchmarks.report.figures import (
    ALARM_COLOUR,
    MUTED_COLOUR,
    Json,
    add,
    axis,
    band,
    colour,
    entry,
    figure,
    lean,
    line,
    line_3d,
)
from benchmarks.report.numbers import number
from benchmarks.report.timing.line import arm_of, detailed, law_control
from optik.types import Array
from optik.view.page import embed_arm
from optik.view.show import Track, thin

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Scatter3d

ARM_INSTANTS = 251
"""Number of instants of a motion of the arm; the viewer interpolates cubics between them."""


def line_in_space(run: Run) -> dict[str, Any] | None:
    """Show the path with its samples, and the arm along it under the time law that the reader chooses."""
    found = detailed(run)
    rows, tool = (None, None) if found is None else (found.table("joints"), found.table("tool"))
    if rows is None or tool is None or found is None:
        return None
    robot, samples = arm_of(run, found), found.block.samples
    laws = law_control(rows["law"].unique(maintain_order=True).to_list())
    names = sorted((law for law, _ in laws.options), key=lambda law: law != laws.value)
    motions = {law: read_track(rows.filter(pl.col("law") == law), robot.n) for law in names}
    one = tool.filter(pl.col("law") == names[0])
    path, s = one.select("x", "y", "z").to_numpy(), one["s"].to_numpy()
    at = np.linspace(s[0], s[-1], samples)
    along = np.stack([np.interp(at, s, path[:, k]) for k in range(3)], axis=1)
    words = [", ".join(number(1e3 * x, 4) for x in point) for point in along[[0, -1]]]
    board = Board(
        "line-board", (_straight(1e3 * along),), (),
        f"The line with its {samples} samples, in the base frame. Drag to turn.",
    )  # fmt: skip
    return {
        "words": [f"From ({words[0]}) mm to ({words[1]}) mm."], "boards": [board],
        "arm_title": "The arm along the line (Fig. 6)", "arm": squeeze(json.dumps(embed_arm(robot, motions, along)).encode()),
    }  # fmt: skip


def read_track(rows: pl.DataFrame, n: int) -> Track:
    """Return a motion for the viewer, from a row for each instant and joint."""
    t, q, dq = (rows[name].to_numpy().reshape(-1, n) for name in ("t", "q", "dq"))
    return thin(Track(t[:, 0], q, dq), ARM_INSTANTS)


def _straight(along: Array) -> Figure:
    """Plot the line alone, by its samples [mm]."""
    scene = {"aspectmode": "cube", **{f"{a}axis": _axis_in_space(a, 5) for a in "xyz"}}
    plot = figure(
        "straight", "The straight line in Cartesian coordinates (Fig. 5)", height=520, scene=scene,
        margin=dict.fromkeys("lrtb", 0),
    )  # fmt: skip
    add(plot, _points(along, "line", mode="lines", line={"color": colour(1), "width": 4}))
    add(plot, _points(along, "samples", marker={"color": colour(0), "size": 2}))
    add(plot, _points(along[:1], "start", marker={"color": colour(2), "size": 6, "symbol": "circle"}))
    add(plot, _points(along[-1:], "goal", marker={"color": colour(3), "size": 6, "symbol": "diamond"}))
    return plot


def _points(points: Array, name: str, mode: str = "markers", **options: Any) -> Scatter3d:
    hover = f"{name}<br>%{{x:.1f}}, %{{y:.1f}}, %{{z:.1f}} mm"
    return line_3d(*points.T, mode=mode, name=name, hover=hover, **options)


# ---------------------------------------------------------------- clearance


def clearance(run: Run) -> dict[str, Any] | None:
    """Show clearance over time and in space, for every law."""
    found = detailed(run)
    rows = None if found is None else found.table("clearance")
    if rows is None or found is None:
        return None
    facts = run.folder.read_json(rows_file("timing", found.block.id, "clearance.json"))
    pairs = _left_out(facts[0]["left_out"])
    left_out = f" Pairs not examined: {pairs}." if pairs else ""
    return {
        "boards": [_over_time(rows, facts, found.block.margin, run)],
        "notes": [f"{one['law']}: {one['words']}." for one in facts],
        "after": ["The shapes are capsules that enclose the links, so real clearances are larger." + left_out],
    }


def _left_out(pairs: Sequence[Sequence[str]]) -> str:
    """Return the pairs that were not examined, by reason."""
    by_reason: dict[str, list[str]] = {}
    for first, second, why in pairs:
        by_reason.setdefault(why, []).append(f"{first} and {second}")
    return "; ".join(f"{', '.join(dict.fromkeys(names))} ({why})" for why, names in by_reason.items())


def _over_time(rows: pl.DataFrame, facts: Sequence[Json], margin: float, run: Run) -> Board:
    """Plot the least distance of all pairs and that between links, with the proved bounds."""
    laws = rows["law"].unique(maintain_order=True).to_list()
    margin *= 1e3
    below = band(-1e4, margin, "nearer to the scene than the margin" if margin else "contact")
    most = 1e3 * float(np.nanmax(rows.select(pl.max_horizontal("scene", "own")).to_numpy().astype(float)))
    plot = figure(
        "clearance-time", "Clearance over time", axis("t [s]", rangemode="tozero"),
        axis("distance [mm]", range=[min(-0.04 * most, margin - 0.1 * most), 1.06 * most]), 380, shapes=[below],
    )  # fmt: skip
    for law in laws:
        part = rows.filter(pl.col("law") == law)
        for column, words, dash in (("scene", "arm and scene", "solid"), ("own", "between links", "dot")):
            kept = part.filter(pl.col(column).is_not_null())
            if kept.is_empty():
                continue
            trace = line(
                kept["t"], 1e3 * kept[column].to_numpy(), digits=5, **{"name": law} if dash == "solid" else {},
                line={"color": run.colour(law), "width": 2, "dash": dash},
                hover=f"{words}, {law}<br>%{{x:.3f}} s: %{{y:.4g}} mm",
            )  # fmt: skip
            add(plot, trace, {"law": [law]})
    for one in facts:
        times, distances = np.array(one["marks"]).T
        mark = line(
            times, 1e3 * distances, digits=5, mode="markers", name="least, from the certificate",
            marker={"color": ALARM_COLOUR, "size": 10, "symbol": "diamond"},
            hover="least, from the certificate<br>%{x:.3f} s: %{y:.4g} mm",
        )  # fmt: skip
        add(plot, mark, {"law": [one["law"]]})
    for words, dash in (("arm and scene", "solid"), ("between links", "dot")):
        add(plot, entry(words, MUTED_COLOUR, dash))
    return Board(
        "clearance-time-board", (plot,), (law_control(laws),) if laws[1:] else (),
        "Least distance of the examined pairs at sampled instants, for the shapes of arm and scene. The bound of the "
        "certificate is for every instant.",
    )  # fmt: skip


def axes_in_space(gravity: Array, points: Array) -> Json:
    """Return axes with equal scales that contain everything, with z upwards."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.05 * (high - low).max()
    axes = {f"{a}axis": _axis_in_space(a, 6, range=[low[i] - room, high[i] + room]) for i, a in enumerate("xyz")}
    up = dict(zip("xyz", lean(-gravity).tolist(), strict=True))
    camera = {"up": up, "eye": {"x": 1.0, "y": -1.2, "z": 0.6}, "center": {"x": 0.0, "y": 0.0, "z": -0.12}}
    return {"aspectmode": "data", "camera": camera, **axes}


def _axis_in_space(name: str, ticks: int, **options: Any) -> Json:
    return options | {"title": {"text": f"{name.upper()} [mm]"}, "nticks": ticks}
