"""Sections: the line with the arm that plays along it (Fig. 5 and 6), and the clearance over time and where it is least."""

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
    INK_COLOUR,
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
from optik.arm.robot import Robot
from optik.types import Array
from planners.cell.view.page import embed_arm
from planners.cell.view.show import Track, thin

if TYPE_CHECKING:
    from plotly.graph_objects import Figure, Scatter3d

ARM_INSTANTS = 251
"""Number of instants of a motion of the arm; the viewer interpolates cubics between them."""

AROUND = 13
"""Points of a drawn circle."""

MARK_COLOUR = ALARM_COLOUR
"""Colour of the nearest shapes."""

SCENE_COLOUR = colour(1)
"""Colour of the scene."""

PLANE_HALF = 0.8
"""Half of the edge of the square that is drawn of a plane [m]."""


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
    pictures = run.folder.read_json(rows_file("timing", found.block.id, "nearest.json")) or []
    if not pictures:
        return None
    pairs = _left_out(pictures[0]["left_out"])
    left_out = f" Pairs not examined: {pairs}." if pairs else ""
    return {
        "boards": [_over_time(rows, pictures, run), _in_space(pictures, arm_of(run, found))],
        "notes": [f"{picture['law']}: {picture['words']}." for picture in pictures],
        "after": ["The shapes are capsules that enclose the links, so real clearances are larger." + left_out],
    }


def _left_out(pairs: Sequence[Sequence[str]]) -> str:
    """Return the pairs that were not examined, by reason."""
    by_reason: dict[str, list[str]] = {}
    for first, second, why in pairs:
        by_reason.setdefault(why, []).append(f"{first} and {second}")
    return "; ".join(f"{', '.join(dict.fromkeys(names))} ({why})" for why, names in by_reason.items())


def _over_time(rows: pl.DataFrame, pictures: Sequence[Json], run: Run) -> Board:
    """Plot the least distance of all pairs and that between links, with the proved bounds."""
    laws = rows["law"].unique(maintain_order=True).to_list()
    margin = 1e3 * float(pictures[0]["margin"])
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
    for picture in pictures:
        times, distances = np.array(picture["marks"]).T
        mark = line(
            times, 1e3 * distances, digits=5, mode="markers", name="least, from the certificate",
            marker={"color": MARK_COLOUR, "size": 10, "symbol": "diamond"},
            hover="least, from the certificate<br>%{x:.3f} s: %{y:.4g} mm",
        )  # fmt: skip
        add(plot, mark, {"law": [picture["law"]]})
    for words, dash in (("arm and scene", "solid"), ("between links", "dot")):
        add(plot, entry(words, MUTED_COLOUR, dash))
    return Board(
        "clearance-time-board", (plot,), (law_control(laws),) if laws[1:] else (),
        "Least distance of the examined pairs at sampled instants, for the shapes of arm and scene. The bound of the "
        "certificate is for every instant.",
    )  # fmt: skip


def _in_space(pictures: Sequence[Json], robot: Robot) -> Board:
    """Draw the shapes of arm and scene at the instant of their least distance."""
    points = np.vstack([1e3 * np.array(capsule[:2]) for picture in pictures for capsule in picture["arm"]])
    corners = [1e3 * _corners(box) for box in pictures[0]["boxes"]]
    everything = np.vstack([points, *corners])
    plot = figure(
        "clearance-space", "Arm and scene where they are nearest", height=560,
        scene=axes_in_space(robot.gravity, everything), margin=dict.fromkeys("lrtb", 0),
    )  # fmt: skip
    for picture in pictures:
        when = {"law": [picture["law"]]}
        parts = [
            ([_capsule(c) for c in picture["arm"] if not c[3]], INK_COLOUR, "arm, capsules around its links", 2),
            ([_edges(box) for box in picture["boxes"] if not box[2]], SCENE_COLOUR, "scene", 3),
            ([_capsule(c) for c in picture["rounds"] if not c[3]], SCENE_COLOUR, "scene", 2),
            ([_cylinder(c) for c in picture.get("cylinders", ()) if not c[3]], SCENE_COLOUR, "scene", 2),
            ([_mesh(mesh) for mesh in picture.get("meshes", ()) if not mesh[1]], SCENE_COLOUR, "scene", 2),
            ([_square(plane) for plane in picture["planes"]], SCENE_COLOUR, "scene", 2),
            ([_capsule(c) for c in (*picture["arm"], *picture["rounds"]) if c[3]]
             + [_cylinder(c) for c in picture.get("cylinders", ()) if c[3]]
             + [_mesh(mesh) for mesh in picture.get("meshes", ()) if mesh[1]]
             + [_edges(box) for box in picture["boxes"] if box[2]], MARK_COLOUR, " and ".join(picture["pair"]), 4),
        ]  # fmt: skip
        for lines, look, name, width in parts:
            if lines:
                x, y, z = 1e3 * np.vstack(lines).T
                add(plot, line_3d(x, y, z, name=name, line={"color": look, "width": width}, hover=f"{name}"), when)
        ends = 1e3 * np.array(picture["points"])
        add(plot, line_3d(
            ends[:, 0], ends[:, 1], ends[:, 2], mode="lines+markers", name="the nearest pair and its nearest points",
            line={"color": MARK_COLOUR, "width": 6}, marker={"color": MARK_COLOUR, "size": 5},
            hover=f"{1e3 * picture['found']:.4g} mm",
        ), when)  # fmt: skip
    laws = [picture["law"] for picture in pictures]
    return Board(
        "clearance-space-board", (plot,), (law_control(laws),) if laws[1:] else (),
        "At the instant of the least distance between arm and scene. Base frame, equal scales; capsules by rings and "
        "lengthwise lines. Drag to turn.",
    )  # fmt: skip


# ---------------------------------------------------------------- shapes as lines


def _corners(box: Sequence[Any]) -> Array:
    """Return corners (8, 3) of a box [m]."""
    T, edges = np.array(box[0]), np.array(box[1])
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    return np.asarray(0.5 * signs * edges @ T[:3, :3].T + T[:3, 3])


def _edges(box: Sequence[Any]) -> Array:
    """Return the edges of a box as lines (k, 3) [m]."""
    corners, out = _corners(box), []
    for i in range(8):
        for bit in (1, 2, 4):
            if not i & bit:
                out += [corners[i], corners[i | bit], np.full(3, np.nan)]
    return np.array(out)


def _square(plane: Sequence[Any]) -> Array:
    """Return a square of a plane around its point nearest to the base (k, 3) [m]."""
    point, normal = np.array(plane[0]), np.array(plane[1])
    across = np.cross(normal, np.eye(3)[int(np.abs(normal).argmin())])
    across /= np.linalg.norm(across)
    other = np.cross(normal, across)
    middle = (point @ normal) * normal
    ends = [middle + PLANE_HALF * (i * across + j * other) for i, j in ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1))]
    return np.array([*ends, np.full(3, np.nan)])


def _mesh(mesh: Sequence[Any]) -> Array:
    """Return the edges of a mesh as lines (k, 3) [m]."""
    ends = np.array(mesh[0]).reshape(-1, 2, 3)
    return np.concatenate([ends, np.full((len(ends), 1, 3), np.nan)], axis=1).reshape(-1, 3)


def _frame_along(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Return unit vectors x, y, z with z along a segment; along the z axis if it is a point."""
    length = float(np.linalg.norm(b - a))
    z = (b - a) / length if length else np.array([0.0, 0.0, 1.0])
    x = np.cross(z, np.eye(3)[int(np.abs(z).argmin())])
    x /= np.linalg.norm(x)
    return x, np.cross(z, x), z


def _cylinder(cylinder: Sequence[Any]) -> Array:
    """Return rings at both ends of a cylinder and four lengthwise lines (k, 3) [m]."""
    a, b, radius = np.array(cylinder[0]), np.array(cylinder[1]), float(cylinder[2])
    x, y, _ = _frame_along(a, b)
    turn, gap = np.linspace(0.0, 2.0 * np.pi, AROUND)[:, None], np.full((1, 3), np.nan)
    lines = [centre + radius * (np.cos(turn) * x + np.sin(turn) * y) for centre in (a, b)]
    lines += [np.array([a, b]) + radius * side for side in (x, y, -x, -y)]
    return np.vstack([part for one in lines for part in (one, gap)])


def _capsule(capsule: Sequence[Any]) -> Array:
    """Return rings at both ends of a capsule's segment and two lengthwise lines around it (k, 3) [m]."""
    a, b, radius = np.array(capsule[0]), np.array(capsule[1]), float(capsule[2])
    length, (x, y, z) = float(np.linalg.norm(b - a)), _frame_along(a, b)
    gap = np.full((1, 3), np.nan)
    turn = np.linspace(0.0, 2.0 * np.pi, AROUND)[:, None]
    half = np.linspace(0.0, np.pi, AROUND // 2 + 1)[:, None]
    lines = [centre + radius * (np.cos(turn) * x + np.sin(turn) * y) for centre in ((a, b) if length else (a,))]
    for side in (x, y):
        far = b + radius * (np.cos(half) * side + np.sin(half) * z)
        near = a + radius * (-np.cos(half) * side - np.sin(half) * z)
        lines.append(np.vstack([far, near, far[:1]]))
    return np.vstack([part for one in lines for part in (one, gap)])


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
