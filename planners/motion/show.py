"""A motion for people: its content for a viewer, and plots against its limits."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.card import COLOURS, MOST_POINTS, Card, Plot
from optik.check import describe_ratio, format_count
from optik.errors import MissingDependency
from optik.scene import Scene
from optik.types import Array
from optik.view.page import find_torques
from optik.view.show import Show, Track
from planners.certificate.certificate import Certificate, find_enforced, limit_bars, proof_facts, summary_lines
from planners.certificate.certification import find_section_times
from planners.limits import MotionLimits, sides
from planners.motion.motion import HasMotion, Motion, World, get_motion
from planners.paths.base import Path
from planners.paths.free_path import FreePath
from planners.paths.joint_curve import JointCurve
from planners.paths.point_to_point import PointToPoint
from planners.paths.program import ProgramPath
from planners.trajectory import Trajectory

# ---------------- plots of a motion against its limits


FIGURE_POINTS = 600
"""Number of instants of a figure's curves, besides the knots of the motion."""
WIDE = 0.15
"""Fraction of the duration from which a run of segments has room for the name of its constraint."""
ROW_HEIGHT, TITLE_WIDTH = 170, 46
"""Height of a plot of a figure [px], and letters in a line of its title: a narrow page shows them all."""
TOP = {"y": 1.0, "yref": "container", "yanchor": "top", "pad": {"t": 40}}
"""Place of a figure's title."""
INK, GRID = "#7d8590", "rgba(125,133,144,0.3)"
"""Colours of the words and of the grid of a figure."""


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
        title=title, verdict=verdict, good=proof.is_valid, bars=limit_bars(proof), facts=proof_facts(proof), plots=plots,
        names=motion.robot.joint_names,
    )  # fmt: skip


def plot_motion(motion: Motion, proof: Certificate, stops: tuple[Array, Array] | None = None) -> Any:
    """Return a figure of Plotly: every joint over time against its limits, and the active constraint of each segment.

    `stops` are times of the motion and the durations of the stops from them.
    """
    robot, t = motion.robot, _instants(motion)
    rows = [(one, found) for one in QUANTITIES if (found := _curves(motion, one, t)) is not None]
    titles = [f"{one.title} [{one.unit(robot)}]" for one, _ in rows] + ["stopping time [s]"] * (stops is not None)
    title = f"{robot.name}, {motion.law or 'a motion'}: {proof.duration:.4g} s; {summary_lines(proof)[0]}"
    figure = _make_figure([*titles, "active constraint"], [1.0] * len(titles) + [0.25], title, "t [s]")
    if stops is not None:
        figure.add_scatter(x=stops[0], y=stops[1], showlegend=False, line={"color": COLOURS[0]}, row=len(titles), col=1)
    for row, (quantity, values) in enumerate(rows, 1):
        _add_curves(figure, row, robot, t, values, _bounds(robot, motion.limits, quantity.limit))
    _add_active(figure, proof, len(titles) + 1)
    figure.update_yaxes(visible=False, row=len(titles) + 1)
    return figure


def plot_positions(robot: Robot, t: Array, q: Array, time: str, title: str) -> Any:
    """Return a figure of positions (k, n) alone, of a motion without a certificate; `time` is the title of its axis."""
    figure = _make_figure([f"position [{QUANTITIES[0].unit(robot)}]"], [1.0], title, time)
    _add_curves(figure, 1, robot, t, q, (robot.limits.lower, robot.limits.upper) if t.size else None)
    return figure


def _make_figure(titles: list[str], heights: list[float], title: str, time: str) -> Any:
    """Return a figure without curves, with a row for each title; its colours are legible on white and on black."""
    try:
        from plotly.subplots import make_subplots
    except ModuleNotFoundError:
        raise MissingDependency("plotly", "plan.plot()", "plot") from None
    figure = make_subplots(
        len(titles), 1, shared_xaxes=True, vertical_spacing=0.035, subplot_titles=titles, row_heights=heights
    )
    lines, clear = wrap(title, TITLE_WIDTH), "rgba(0,0,0,0)"
    top, bottom = 52 + 19 * len(lines), 110
    height = ROW_HEIGHT * sum(heights) + top + bottom
    figure.update_xaxes(title=time, row=len(titles))
    figure.update_xaxes(gridcolor=GRID, zerolinecolor=GRID)
    figure.update_yaxes(gridcolor=GRID, zerolinecolor=GRID)
    figure.update_annotations(font_size=13, x=0.0, xanchor="left")
    figure.update_layout(
        height=height, title={"text": "<br>".join(lines), "font": {"size": 14}, "x": 0.0, "xref": "paper"} | TOP,
        margin={"t": top, "b": bottom, "l": 50, "r": 10}, font_color=INK, paper_bgcolor=clear, plot_bgcolor=clear,
        legend={"orientation": "h", "yanchor": "top", "y": -45.0 / (height - top - bottom)},
    )  # fmt: skip
    return figure


def _add_curves(
    figure: Any, row: int, robot: Robot, t: Array, values: Array, bounds: tuple[Array, Array] | None
) -> None:
    """Add the curves (k, n) of all joints and their limits to a row of a figure; positions fill their row."""
    import plotly.graph_objects as go

    if bounds is not None and bounds[0] is robot.limits.lower:
        room = 0.05 * np.ptp(values) or 0.1
        figure.update_yaxes(range=[values.min() - room, values.max() + room], row=row)
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

    active = find_enforced(proof)
    words = [
        f"{limit} of {joint}" if joint else "at rest" for limit, joint in zip(active.limit, active.joint, strict=True)
    ]
    colours = {word: COLOURS[k % len(COLOURS)] for k, word in enumerate(dict.fromkeys(words))}
    for word, run in groupby(range(len(words)), key=lambda k: words[k]):
        segments = list(run)
        begin, end = active.t[[segments[0], segments[-1] + 1]].tolist()
        hover = f"{word}: {describe_ratio(active.ratio[segments].max())}<br>{begin:.4f} to {end:.4f} s<extra></extra>"
        wide = end - begin > WIDE * proof.duration
        strip = go.Scatter(
            x=[begin, 0.5 * (begin + end), end], y=[0.0] * 3, mode="lines+text", text=["", word if wide else "", ""],
            textfont={"color": "white", "size": 11}, line={"color": colours[word], "width": 16}, showlegend=False,
            hovertemplate=hover,
        )  # fmt: skip
        figure.add_trace(strip, row, 1)


# ---------------- the content of a viewer for a motion


MOST_INSTANTS = 2000
"""Largest number of instants of a motion; the viewer interpolates cubics between them."""
SAMPLE_PERIOD = 0.004
"""Interval between instants of a short motion [s]; cubics between them deviate by at most 1e-7 rad at usual jerks."""
PATH_POINTS = 400
"""Number of drawn points of a path."""
ZONE_POINTS, MOST_EVENTS = 24, 12
"""Drawn points of a rounded corner, and events that are listed."""
PLOT_LIMITS = {"dq": "velocity", "ddq": "acceleration", "jerk": "jerk", "torque": "torque"}
"""Quantities that a viewer plots with a limit of the motion, and the name of that limit."""


def show_motion(motion: Motion | HasMotion) -> Show:
    """Return the content of a viewer for a motion.

    Parameters
    ----------
    motion : Motion or Plan
        Such as `planners.load_motion` reads.

    Returns
    -------
    Show
        Its facts include the motion's certificate.

    Raises
    ------
    NoSolution
        A plan that failed.
    InvalidInput
        Neither a motion nor a plan.
    """
    found = get_motion(motion)
    proof = getattr(motion, "certificate", None)
    if not isinstance(proof, Certificate):
        proof = found.certify()
    title, world = f"{found.robot.name}: {found.law or 'a motion'}", found.world
    shown = show_trajectory(found.robot, found.trajectory, proof, found.limits, found.scene, world)
    path = sample_path(found.path) if world is None else shown.path
    facts = (*motion_facts(found), *_freedom_facts(found.path), *_program_facts(found), *shown.facts)
    at = [event.t for event in found.events]
    order = slice(None) if world is None else world.group.places(found.robot)
    events = shown.robot.fk(found.trajectory(np.array(at))[:, order])[:, :3, 3] if at else None
    before, zones = (sample_first_way(found.path), sample_zones(found.path)) if world is None else (None, ())
    return replace(shown, title=title, path=path, facts=facts, before=before, zones=zones, events=events)


def show_trajectory(
    robot: Robot, trajectory: Trajectory, proof: Certificate, limits: MotionLimits, scene: Scene | None,
    world: World | None = None,
) -> Show:  # fmt: skip
    """Return the content of a viewer for a trajectory with its certificate, and its own course as the path."""
    track, bounds = sample_track(trajectory), plot_limits(limits, robot.n)
    if world is not None:  # the base of a chain through several mechanisms moves
        order, tool = world.group.places(robot), robot.joint_names[-1].partition("/")[0]
        track = Track._make(one[:, order] if k and one is not None else one for k, one in enumerate(track))
        bounds = {name: (low[order], high[order]) for name, (low, high) in bounds.items()}
        robot, scene = world.group.as_robot(tool), world.scene
    return Show(
        robot, robot.name, track, robot.fk(track.q)[:, :3, 3], scene=scene, limits=bounds,
        facts=certificate_facts(proof), bars=limit_bars(proof), verdict=summary_lines(proof)[0], good=proof.is_valid,
    )  # fmt: skip


def plot_limits(limits: MotionLimits, n: int) -> dict[str, tuple[Array, Array]]:
    """Return the lower and upper limits (n,) of each quantity of a viewer's plots."""
    bounds = limits.bounds(n)
    return {name: sides(bounds[limit]) for name, limit in PLOT_LIMITS.items() if limit in bounds}


# ---------------------------------------------------------------- motions at instants


def sample_track(trajectory: Trajectory) -> Track:
    """Sample a motion for a viewer."""
    count = int(np.clip(np.ceil(trajectory.duration / SAMPLE_PERIOD), 1, MOST_INSTANTS - 1)) + 1
    t = np.linspace(0.0, trajectory.duration, count)
    return Track(t, trajectory(t), trajectory(t, 1), trajectory(t, 2), None, trajectory(t, 3))


def sample_first_way(path: Path) -> Array | None:
    """Return the points of the tool along the way around obstacles near which a path began, or None."""
    if not isinstance(path, PointToPoint) or path.corners is None:
        return None
    u = np.linspace(0.0, len(path.corners) - 1.0, PATH_POINTS)
    q = np.stack([np.interp(u, np.arange(len(path.corners)), x) for x in path.corners.T], axis=1)
    return np.asarray(path.robot.fk(q)[:, :3, 3])


def sample_path(path: Path) -> Array:
    """Return the points of a path to draw."""
    s = np.union1d(np.linspace(0.0, path.end, PATH_POINTS), path.breaks)
    return np.asarray(path.pose(s)[:, :3, 3], dtype=np.float64)


def sample_zones(path: Path) -> tuple[Array, ...]:
    """Return the points of a path in each of its rounded corners, of a program."""
    zones = []
    for start, section in zip(path.starts, path.sections, strict=False) if isinstance(path, ProgramPath) else ():
        if not isinstance(section, JointCurve):
            continue
        rounded = section.owners[:, 0] != section.owners[:, 1]
        first = section.owners.min(axis=1)
        for part in np.unique(first[rounded]):
            pieces = np.flatnonzero(rounded & (first == part))
            s = np.linspace(section.breaks[pieces[0]], section.breaks[pieces[-1] + 1], ZONE_POINTS)
            zones.append(np.asarray(path.pose(start + s)[:, :3, 3]))
    return tuple(zones)


# ---------------------------------------------------------------- facts


def _freedom_facts(path: Path) -> tuple[tuple[str, str], ...]:
    """Return the values that the freedoms of a path have, as rows."""
    rows = []
    for one in path.ranges if isinstance(path, FreePath) and path.asked == "pose" else ():
        factor, unit = (180.0 / np.pi, "°") if one.unit == "rad" else (1e3, " mm")
        low, high = (f"{factor * x:.3g}" for x in one.reached)
        rows.append((f"Free {one.name}", f"{low} to {high}{unit}"))
    return tuple(rows)


def _program_facts(motion: Motion) -> tuple[tuple[str, str], ...]:
    """Return the sections and the events of a program as rows."""
    if not isinstance(motion.path, ProgramPath):
        return ()
    path = motion.path
    which = path.find_sections((0.0, path.end) if motion.span is None else motion.span)
    times = find_section_times(path, motion.trajectory, motion.span)[:-1]
    stops = ", ".join(f"{time.rest:.3f} s" for time in times)
    size = f"{format_count(path.segments, 'part')}, {format_count(len(path.sections), 'section')}"
    rows = [("Program", f"{size}{f'; stops at {stops}' if stops else ''}")]
    for i, time in zip(which, times, strict=False):
        one, two = path.robots[i : i + 2]
        words = [f"wait of {time.end - time.rest:.4g} s"] if time.end > time.rest else []
        words += [f"payload {two.payload or 'none'}"] if str(two.payload) != str(one.payload) else []
        centre = ", ".join(f"{1e3 * x:.4g}" for x in two.tool[:3, 3])
        words += [f"tool at ({centre}) mm in the last link"] if (two.tool != one.tool).any() else []
        rows += [(f"At {time.rest:.3f} s", ", ".join(words))] if words else []
    rows += [("Event", f"{event.signal} = {event.value} at {event.t:.4f} s") for event in motion.events[:MOST_EVENTS]]
    more = len(motion.events) - MOST_EVENTS
    return (*rows, *([("Event", f"and {more} more")] if more > 0 else []))


def motion_facts(motion: Motion) -> tuple[tuple[str, str], ...]:
    """Return the arm, law, path and scene of a motion as rows."""
    robot, path = motion.robot, motion.path
    shapes = (
        "no shapes, shown as lines between its joint frames" if robot.shapes is None else f"{robot.shapes.m} capsules"
    )
    turn = f"{np.degrees(path.end):.4g}° of rotation" if path.turns_only else f"{path.end:.4g} rad"
    way = f"{1e3 * path.end:.4g} mm" if path.unit == "m" else turn
    rows = [
        ("Arm", f"{robot.name}, {robot.n} joints, {shapes}"),
        ("Path", f"{path.name}, {way}"),
        ("Law", motion.law or "not stated"),
        ("Duration", f"{motion.trajectory.duration:.4f} s"),
        *payload_facts(robot),
    ]
    if motion.speed is not None:
        unit = "rad/s" if path.turns_only else "m/s"
        rows.append(("Requested tool speed", f"{motion.speed:.4g} {unit}"))
    if motion.scene is not None:
        rows.append(("Scene", f"{len(motion.scene.names)} objects, margin {1e3 * motion.scene.margin:.4g} mm"))
    return tuple(rows)


def payload_facts(robot: Robot) -> tuple[tuple[str, str], ...]:
    """Return the payload of an arm as rows."""
    if robot.payload is None:
        return ()
    centre = ", ".join(f"{1e3 * x:.4g}" for x in robot.payload.com)
    return (("Payload", f"{robot.payload}, centre of mass at ({centre}) mm in the tool's frame"),)


def certificate_facts(proof: Certificate) -> tuple[tuple[str, str], ...]:
    """Return the certificate of a motion as rows."""
    rows = [("Certificate", "valid" if proof.is_valid else f"NOT valid: {'; '.join(proof.reasons)}")]
    if proof.clearance is not None:
        rows += [(f"Clearance {words}", kind.describe()) for words, kind in proof.clearance.kinds.items()]
    return tuple(rows)
