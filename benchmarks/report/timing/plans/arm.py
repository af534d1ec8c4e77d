"""Section: the line in space with the arm moving along it, the paper's Fig. 5 and 6."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from benchmarks.report.board import Board, Json, Key, Plot
from benchmarks.report.figures import GRID_COLOUR, HOVER, MUTED_COLOUR, lean, line_3d
from benchmarks.report.numbers import number
from benchmarks.report.run import Run
from benchmarks.report.timing.plans.tables import law_control, line_plans
from optik.types import Array

EYE_DISTANCE = 2.4
"""Distance of the eye, in units of the scene: the whole arm is in view."""

STANDING_EVERY = 12
"""Interval of pictures between solid drawings of the arm: six of them, so that a still page shows the motion."""


def moving_arm(run: Run) -> dict[str, Any] | None:
    """Show the arm in pictures equally spaced in time, for every law."""
    frames = run.folder.read("line/frames.parquet")
    line = line_plans(run)
    if frames is None or line is None or not line.solved:
        return None
    robot = run.robot(line.block.robot)
    plan = line.solved[0]
    start, goal = (1e3 * np.array(plan["path"][end])[:3, 3] for end in ("start", "goal"))
    points = 1e3 * frames.select("x", "y", "z").to_numpy()
    scene = _scene(robot.gravity, goal - start, np.vstack([points, start, goal]))
    plot = Plot(
        "arm", "The arm along the line (Fig. 6)", {"scene": scene, "margin": dict.fromkeys("lrtb", 0)}, height=520
    )
    laws = frames["law"].unique(maintain_order=True).to_list()
    for law in laws:
        plot.frames.append({"when": {"law": [law]}} | _pictures(frames.filter(pl.col("law") == law)))
    first = plot.frames[0]
    for k in range(0, len(first["t"]), STANDING_EVERY):
        plot.add(_standing(first, k))
    plot.add(_arm(first))
    base = np.array([first[a][0][0] for a in "xyz"])
    plot.add(_points([base], marker={"color": "var(--muted)", "size": 8, "symbol": "square"}, name="base"))
    plot.add(_points([start, goal], mode="lines", line={"color": "var(--c1)", "width": 6}, name="line"))
    plot.add(_points([start], marker={"color": "var(--c2)", "size": 7, "symbol": "circle"}, name="start"))
    plot.add(_points([goal], marker={"color": "var(--c3)", "size": 7, "symbol": "diamond"}, name="goal"))
    legend = (
        Key("base", "var(--muted)", "fill"), Key("arm, base to tool", "var(--ink)"), Key("arm on its way", "var(--muted)"),
        Key("line", "var(--c1)", "solid"), Key("samples", "var(--c0)", "dot"),
        Key("start", "var(--c2)", "dot"), Key("goal", "var(--c3)", "dot"),
    )  # fmt: skip
    up = _words(-robot.gravity)
    board = Board(
        "arm-board", (_straight(start, goal, line.block.samples), plot), (law_control(laws),), legend,
        f"Fig. 5: the line with its {line.block.samples} samples; Fig. 6: the arm along it. "
        f"Base frame, equal scales for the arm, {up} up (against the robot's gravity). Points are the origins of the joint "
        "frames and the tool. Played at half the real speed. Drag to turn.",
    )  # fmt: skip
    ends = [", ".join(number(x, 4) for x in point) for point in (start, goal)]
    return {"words": [f"From ({ends[0]}) mm to ({ends[1]}) mm."], "boards": [board]}


def _scene(gravity: Array, direction: Array, points: Array) -> Json:
    """Return a scene that contains all pictures, seen from the side of the line and a little above, with z upwards."""
    up = -gravity
    side = np.cross(up, direction)
    if np.linalg.norm(side) < 1e-6 * np.linalg.norm(direction):
        side = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    side /= np.linalg.norm(side)
    eye = EYE_DISTANCE * (0.8 * side + 0.45 * np.cross(side, up) + 0.3 * up)
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.08 * (high - low).max()
    axes = {
        f"{a}axis": {
            "title": {"text": f"{a.upper()} [mm]"}, "range": lean([low[i] - room, high[i] + room]), "nticks": 6,
            "gridcolor": GRID_COLOUR, "zerolinecolor": GRID_COLOUR, "linecolor": MUTED_COLOUR, "showbackground": False,
        }
        for i, a in enumerate("xyz")
    }  # fmt: skip
    vectors = {
        name: dict(zip("xyz", lean(v), strict=True)) for name, v in (("up", up), ("eye", eye), ("center", -0.15 * up))
    }
    return {"aspectmode": "data", "camera": vectors, **axes}


def _straight(start: Array, goal: Array, samples: int) -> Plot:
    """Draw only the line, with its samples."""
    axes = {
        f"{a}axis": {
            "title": {"text": f"{a.upper()} [mm]"}, "nticks": 5, "gridcolor": GRID_COLOUR, "zerolinecolor": GRID_COLOUR,
            "linecolor": MUTED_COLOUR, "showbackground": False,
        }
        for a in "xyz"
    }  # fmt: skip
    plot = Plot(
        "straight", "The straight line in Cartesian coordinates (Fig. 5)",
        {"scene": {"aspectmode": "cube", **axes}, "margin": dict.fromkeys("lrtb", 0)}, height=520,
    )  # fmt: skip
    along = start + np.linspace(0.0, 1.0, samples)[:, None] * (goal - start)
    plot.add(_points([start, goal], mode="lines", line={"color": "var(--c1)", "width": 4}, name="line"))
    plot.add(_points(list(along), marker={"color": "var(--c0)", "size": 2}, name="sample"))
    plot.add(_points([start], marker={"color": "var(--c2)", "size": 6, "symbol": "circle"}, name="P₀"))
    plot.add(_points([goal], marker={"color": "var(--c3)", "size": 6, "symbol": "diamond"}, name="P"))
    return plot


def _standing(pictures: Json, k: int) -> Json:
    """Draw the arm at one instant."""
    return line_3d(
        x=pictures["x"][k], y=pictures["y"][k], z=pictures["z"][k], mode="lines", name="arm on its way", hoverinfo="skip",
        line={"color": MUTED_COLOUR, "width": 3}, opacity=0.5,
    )  # fmt: skip


def _pictures(rows: pl.DataFrame) -> Json:
    out: Json = {"t": [], "x": [], "y": [], "z": []}
    for (_,), picture in rows.group_by("frame", maintain_order=True):
        out["t"].append(float(f"{picture['t'][0]:.4g}"))
        for a in "xyz":
            out[a].append(lean(1e3 * picture[a]))
    return out


def _arm(pictures: Json) -> Json:
    return line_3d(
        x=pictures["x"][0], y=pictures["y"][0], z=pictures["z"][0], mode="lines+markers", name="arm", meta="moves",
        line={"color": "var(--ink)", "width": 9}, marker={"color": "var(--c0)", "size": 5},
        hovertemplate=f"%{{x:.0f}}, %{{y:.0f}}, %{{z:.0f}} mm{HOVER}",
    )  # fmt: skip


def _points(points: list[Array], **options: Any) -> Json:
    x, y, z = np.array(points).T
    name = options.pop("name")
    mode = options.pop("mode", "markers")
    hover = f"{name}<br>%{{x:.1f}}, %{{y:.1f}}, %{{z:.1f}} mm{HOVER}"
    return line_3d(x=lean(x), y=lean(y), z=lean(z), mode=mode, name=name, hovertemplate=hover, **options)


def _words(direction: Array) -> str:
    i = int(np.argmax(np.abs(direction)))
    if abs(direction[i]) < 1.0 - 1e-9:
        return "the direction (" + ", ".join(f"{d:.2f}" for d in direction) + ")"
    return ("+" if direction[i] > 0 else "−") + "XYZ"[i]
