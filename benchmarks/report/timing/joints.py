"""Section: the motion of every joint under each time law against its limits, and of the tool along the line."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from benchmarks.blocks.base import BlockRows
from benchmarks.report import boards
from benchmarks.report.base import Run
from benchmarks.report.boards import Board, Control, Json, add, axis, band, colour, figure, level, line_over, vary
from benchmarks.report.timing.line import arm_of, detailed, law_control, limits_of
from benchmarks.report.timing.tables import example_boards
from optik.arm.robot import Robot
from optik.types import Array
from planners.limits import MotionLimits, sides

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ALL_LAWS, ALL_JOINTS = "all laws", "all joints"
"""Choices of the controls of laws and joints."""

IN_VIEW, WHOLE_CURVES = "limits in view", "whole curves"
"""Choices of the vertical range."""

OF_TORQUES = (
    " Torques are those of the arm's model, of a payload's interval the end that needs more; the rate of the torque is without "
    "Coulomb friction, which jumps where a joint starts, reverses or stops."
)
"""Caption of the plots of torques."""

ENVELOPE = 15
"""Number of instants whose largest deviation is drawn: it is zero at the samples of the path and oscillates between them."""

JOINT_CURVES = {
    "q": ("position", "q [rad]", None),
    "dq": ("velocity", "q̇ [rad/s]", "velocity"),
    "ddq": ("acceleration", "q̈ [rad/s²]", "acceleration"),
    "jerk": ("jerk", "jerk [rad/s³]", "jerk"),
    "torque": ("torque", "τ [N·m]", "torque"),
    "torque_rate": ("torque rate", "dτ/dt [N·m/s]", "torque_rate"),
}
"""Columns of a motion: in words, with unit, and the limit that each has."""


def motion(run: Run) -> dict[str, Any] | None:
    """Return boards of joints, path and tool."""
    found = detailed(run)
    rows, tool = (None, None) if found is None else (found.table("joints"), found.table("tool"))
    if rows is None or tool is None or found is None:
        return None
    shown = [_joint_board(found, rows, run), *example_boards(found, run), _tool_board(tool, run)]
    return {"boards": shown}


def _joint_board(b: BlockRows, rows: pl.DataFrame, run: Run) -> Board:
    ranges = _ranges(arm_of(run, b), limits_of(run, b))
    laws = rows["law"].unique(maintain_order=True).to_list()
    joints = rows["joint"].unique(maintain_order=True).to_list()
    plots = []
    for column, (words, title, _) in JOINT_CURVES.items():
        if column not in rows.columns:
            continue
        plot = figure(f"motion-{column}", words.capitalize(), axis("t [s]", rangemode="tozero"), title)
        for (law, joint), part in rows.group_by("law", "joint", maintain_order=True):
            i = joints.index(joint)
            t = part["t"]
            trace = line_over(
                0, float(t[-1]) / (len(t) - 1), part[column], name=str(joint), line={"color": colour(i), "width": 1.6},
                hover=f"{joint}, {law}<br>%{{x:.3f}} s: %{{y:.4g}}",
            )  # fmt: skip
            when = {"law": [str(law), ALL_LAWS], "joint": [str(joint), ALL_JOINTS]}
            look = {"name": str(law), "line": {"color": run.colour(str(law))}}
            add(plot, trace, when, at={"law": [ALL_LAWS]}, look=look)
        _bands(plot, ranges[column], column, joints)
        _whole_ranges(plot, rows, column, laws, joints)
        plots.append(plot)
    controls = (
        law_control(laws, ALL_LAWS),
        Control.of("joint", "Joint", (ALL_JOINTS, *joints)),
        Control.of("range", "Vertical range", (IN_VIEW, WHOLE_CURVES)),
    )
    instants = len(rows) // len(rows.unique(["law", "joint"]))
    return Board(
        "motion-board", tuple(plots), controls,
        f"{instants:,} instants of the polynomials. “{IN_VIEW}” clips curves far beyond the limits; “{WHOLE_CURVES}” shows "
        "all. The peaks in the table below are exact, not from these instants."
        + (OF_TORQUES if "torque" in rows.columns else ""),
    )  # fmt: skip


def _ranges(robot: Robot, limits: MotionLimits) -> dict[str, list[tuple[float, float] | None]]:
    """Return the range of every joint for each curve; None if it is unlimited."""
    bounds = limits.bounds(robot.n)
    found = {}
    for column, (_, _, field) in JOINT_CURVES.items():
        lower, upper = (robot.limits.lower, robot.limits.upper) if field is None else sides(bounds[field])
        pairs = zip(np.broadcast_to(lower, robot.n).tolist(), np.broadcast_to(upper, robot.n).tolist(), strict=True)
        found[column] = [pair if np.isfinite(pair).all() else None for pair in pairs]
    return found


def _bands(plot: Figure, limits: list[tuple[float, float] | None], column: str, joints: list[str]) -> None:
    """Shade the area beyond the limits of one joint, or of all if they are the same."""
    for joint, limit in zip(joints, limits, strict=True):
        if limit is not None:
            vary(plot, {"joint": [joint]}, {"shapes": _outside(limit)})
            vary(plot, {"joint": [joint], "range": [IN_VIEW]}, {"yaxis": {"range": _view(limit, column)}})
    given = [x for x in limits if x is not None]
    if not given:
        return
    if len(set(limits)) == 1:
        vary(plot, {"joint": [ALL_JOINTS]}, {"shapes": _outside(given[0])})
    if column != "q":
        widest = max(given, key=lambda limit: limit[1])
        vary(plot, {"joint": [ALL_JOINTS], "range": [IN_VIEW]}, {"yaxis": {"range": _view(widest, column)}})


def _view(limit: tuple[float, float], column: str) -> list[float]:
    room = {"q": 1.1, "dq": 1.2, "ddq": 1.6, "jerk": 2.0, "torque": 1.2, "torque_rate": 2.0}[column]
    middle, half = (limit[0] + limit[1]) / 2, (limit[1] - limit[0]) / 2
    return [middle - room * half, middle + room * half]


def _outside(limit: tuple[float, float]) -> list[Json]:
    """Return the areas beyond the limits, with dashed edges."""
    low, high = limit
    far = 1e6 * (high - low)
    areas = [band(high, high + far, "beyond the limit"), band(low - far, low)]
    return [*areas, *(level(end, dash="dash") for end in limit)]


def _whole_ranges(plot: Figure, rows: pl.DataFrame, column: str, laws: list[str], joints: list[str]) -> None:
    """Return ranges that contain whole curves; the shaded bands would widen those that Plotly computes."""
    for law in (*laws, ALL_LAWS):
        of_law = rows if law == ALL_LAWS else rows.filter(pl.col("law") == law)
        for joint in (ALL_JOINTS, *joints):
            values = (of_law if joint == ALL_JOINTS else of_law.filter(pl.col("joint") == joint))[column].to_numpy()
            low, high = float(values.min()), float(values.max())
            room = 0.06 * (high - low) + 1e-9
            vary(
                plot,
                {"range": [WHOLE_CURVES], "law": [law], "joint": [joint]},
                {"yaxis": {"range": boards.lean([low - room, high + room]).tolist()}},
            )


def _tool_board(rows: pl.DataFrame, run: Run) -> Board:
    most = 1e6 * max(float(rows[c].to_numpy().max()) for c in ("distance", "angle"))
    fields = {
        "speed": ("Speed along the line", axis("speed [mm/s]", rangemode="tozero"), 1e3),
        "distance": ("Distance from the line", _deviation("distance [µm]", most), 1e6),
        "angle": ("Turn from the orientation", _deviation("angle [µrad]", most), 1e6),
    }
    plots = []
    for column, (title, vertical, scale) in fields.items():
        plot = figure(f"tool-{column}", title, axis("t [s]", rangemode="tozero"), vertical, height=300)
        for (law,), part in rows.group_by("law", maintain_order=True):
            t = part["t"].to_numpy()
            if column == "speed":
                y = np.gradient(part["s"].to_numpy(), t)
            else:
                t, y = _envelope(t, part[column].to_numpy())
            add(plot, line_over(
                float(t[0]), float(t[1] - t[0]), scale * y, name=str(law),
                line={"color": run.colour(str(law)), "width": 2}, hover=f"{law}<br>%{{x:.3f}} s: %{{y:.3g}}",
            ))  # fmt: skip
        plots.append(plot)
    return Board(
        "tool-board", tuple(plots), (),
        f"Speed from differences of the path length between instants. Deviations: the largest of every {ENVELOPE} instants.",
    )  # fmt: skip


def _envelope(t: Array, y: Array) -> tuple[Array, Array]:
    """Return the largest of every few instants: a deviation is zero at the samples of the path and oscillates between them."""
    k = len(t) // ENVELOPE * ENVELOPE
    return t[:k].reshape(-1, ENVELOPE).mean(axis=1), np.maximum(y[:k].reshape(-1, ENVELOPE).max(axis=1), boards.NOISE)


def _deviation(title: str, most: float) -> Json:
    return boards.log_axis(title, range=(-10.5, max(0.5, math.log10(max(most, 1e-10)) + 0.5)))
