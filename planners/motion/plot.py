"""Plots of a motion against its limits: small ones for a notebook's card, and a figure of Plotly."""

from __future__ import annotations

from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.card import COLOURS, MOST_POINTS, Card, Plot
from optik.errors import MissingDependency
from optik.types import Array
from optik.view.data import find_torques
from optik.view.show import Track
from planners.certificate.certificate import Certificate, limit_bars, summary_lines, tool_facts
from planners.limits import MotionLimits, sides
from planners.motion.motion import Motion

FIGURE_POINTS = 600
"""Number of instants of a figure's curves, besides the knots of the motion."""
WIDE = 0.15
"""Fraction of the duration from which a run of segments has room for the name of its constraint."""
ROW_HEIGHT = 150
"""Height of a plot of a figure [px]."""


class Quantity(NamedTuple):
    """A quantity of the joints over time: title, order of its derivative (None for the torque), and name of its limit."""

    title: str
    order: int | None
    limit: str

    def unit(self, robot: Robot) -> str:
        """Return the units of the joints."""
        slides = sorted(set(robot.prismatic.tolist()))
        if self.order is None:
            return ", ".join("N" if one else "N·m" for one in slides)
        return ", ".join(f"{'m' if one else 'rad'}{('', '/s', '/s²', '/s³')[self.order]}" for one in slides)


QUANTITIES = (
    Quantity("position", 0, "position"),
    Quantity("velocity", 1, "velocity"),
    Quantity("acceleration", 2, "acceleration"),
    Quantity("jerk", 3, "jerk"),
    Quantity("torque", None, "torque"),
)
"""What is plotted, in this order."""


def _curves(motion: Motion, quantity: Quantity, t: Array) -> Array | None:
    """Return a quantity of every joint (k, n) at times (k,); None for the torque of an arm without masses."""
    q, dq, ddq = (motion.trajectory(t, order) for order in range(3))
    if quantity.order is None:
        return find_torques(motion.robot, Track(t, q, dq, ddq))
    return np.asarray((q, dq, ddq)[quantity.order] if quantity.order < 3 else motion.trajectory(t, 3))


def _bounds(robot: Robot, limits: MotionLimits, name: str) -> tuple[Array, Array] | None:
    """Return the lower and upper limits (n,) of a quantity; None if there are none."""
    if name == "position":
        return robot.limits.lower, robot.limits.upper
    known = limits.bounds(robot.n)
    found = sides(known[name]) if name in known else None
    return None if found is None or not np.isfinite(found).any() else found


def motion_card(title: str, motion: Motion, proof: Certificate) -> Card:
    """Return verdict, peaks, and plots of the joints as fractions of their limits, for a notebook."""
    t, plots = np.linspace(0.0, motion.trajectory.duration, MOST_POINTS), []
    for quantity in QUANTITIES[:4]:
        values = _curves(motion, quantity, t)
        bounds = None if quantity.order == 0 else _bounds(motion.robot, motion.limits, quantity.limit)
        assert values is not None
        if bounds is None:
            plots.append(Plot(f"{quantity.title} [{quantity.unit(motion.robot)}]", t, values))
        else:
            ratios = np.where(values < 0.0, values / -np.asarray(bounds[0]), values / bounds[1])
            plots.append(Plot(f"{quantity.title} / limit", t, ratios, (-1.0, 1.0)))
    verdict = f"{summary_lines(proof)[0]}; {proof.duration:.4g} s"
    return Card(
        title=title, verdict=verdict, good=proof.is_valid, bars=limit_bars(proof), facts=tool_facts(proof), plots=plots,
        names=motion.robot.joint_names,
    )  # fmt: skip


def plot_motion(motion: Motion, proof: Certificate, stops: tuple[Array, Array] | None = None) -> Any:
    """Return a figure of Plotly: every joint over time against its limits, and the active constraint of each segment.

    `stops` are times of the motion and the durations of the stops from them.
    """
    try:
        from plotly.subplots import make_subplots
    except ModuleNotFoundError:
        raise MissingDependency("plotly", "plan.plot()", "plot") from None
    robot, t = motion.robot, _instants(motion)
    rows = [(one, found) for one in QUANTITIES if (found := _curves(motion, one, t)) is not None]
    titles = [f"{one.title} [{one.unit(robot)}]" for one, _ in rows] + ["stopping time [s]"] * (stops is not None)
    figure = make_subplots(
        len(titles) + 1, 1, shared_xaxes=True, vertical_spacing=0.035, subplot_titles=[*titles, "active constraint"],
        row_heights=[1.0] * len(titles) + [0.25],
    )  # fmt: skip
    if stops is not None:
        figure.add_scatter(x=stops[0], y=stops[1], showlegend=False, line={"color": COLOURS[0]}, row=len(titles), col=1)
    for row, (quantity, values) in enumerate(rows, 1):
        _add_curves(figure, row, robot, t, values, _bounds(robot, motion.limits, quantity.limit))
    _add_active(figure, proof, len(titles) + 1)
    figure.update_yaxes(visible=False, row=len(titles) + 1)
    figure.update_xaxes(title="t [s]", row=len(titles) + 1)
    figure.update_annotations(font_size=13, x=0.0, xanchor="left")
    title = f"{robot.name}, {motion.law or 'a motion'}: {proof.duration:.4g} s; {summary_lines(proof)[0]}"
    heading = {"text": title, "font": {"size": 14}}
    figure.update_layout(height=ROW_HEIGHT * len(titles) + 120, title=heading, margin={"t": 70, "b": 40})
    return figure


def _add_curves(
    figure: Any, row: int, robot: Robot, t: Array, values: Array, bounds: tuple[Array, Array] | None
) -> None:
    """Add the curves (k, n) of all joints and their limits to a row of a figure."""
    import plotly.graph_objects as go

    for i, name in enumerate(robot.joint_names):
        one, look = {"name": name, "legendgroup": name}, {"color": COLOURS[i % len(COLOURS)], "width": 1.6}
        hover = f"{name}<br>%{{x:.4f}} s: %{{y:.5g}}<extra></extra>"
        figure.add_trace(
            go.Scatter(x=t, y=values[:, i], line=look, hovertemplate=hover, showlegend=row == 1, **one), row, 1
        )
        for side in bounds or ():
            level = float(np.broadcast_to(side, robot.n)[i])
            if np.isfinite(level):
                ends = {
                    "x": t[[0, -1]],
                    "y": [level, level],
                    "mode": "lines",
                    "line": look | {"width": 1, "dash": "dot"},
                }
                figure.add_trace(go.Scatter(**ends, showlegend=False, hoverinfo="skip", **one), row, 1)


def _instants(motion: Motion) -> Array:
    """Return the times of the curves, on either side of every knot, because the jerk is discontinuous there."""
    knots, end = motion.trajectory.knots, motion.trajectory.duration
    before = np.maximum(np.nextafter(knots, -1.0), 0.0)
    return np.unique(np.concatenate([np.linspace(0.0, end, FIGURE_POINTS), knots, before]))


def _add_active(figure: Any, proof: Certificate, row: int) -> None:
    """Add a strip with the limit and the joint that have the largest ratio, for runs of segments with the same ones."""
    import plotly.graph_objects as go

    active = proof.binding
    words = [f"{limit} of {joint}" for limit, joint in zip(active.limit, active.joint, strict=True)]
    colours = {word: COLOURS[k % len(COLOURS)] for k, word in enumerate(dict.fromkeys(words))}
    for word, run in groupby(range(len(words)), key=lambda k: words[k]):
        segments = list(run)
        begin, end = active.t[[segments[0], segments[-1] + 1]].tolist()
        hover = f"{word}: {active.ratio[segments].max():.3g} of its limit<br>{begin:.4f} to {end:.4f} s<extra></extra>"
        wide = end - begin > WIDE * proof.duration
        strip = go.Scatter(
            x=[begin, 0.5 * (begin + end), end], y=[0.0] * 3, mode="lines+text", text=["", word if wide else "", ""],
            textfont={"color": "white", "size": 11}, line={"color": colours[word], "width": 16}, showlegend=False,
            hovertemplate=hover,
        )  # fmt: skip
        figure.add_trace(strip, row, 1)
