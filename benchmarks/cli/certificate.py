"""Certificates as the command line prints them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.cli.command import out_console
from benchmarks.cli.words import translate
from optik.check import format_count
from optik.check import format_ratio as describe_ratio

MOST_CORNERS = 8
"""Corners of a program that are listed."""
EXACT_EXCESS = 5e-13
"""Excess over a limit [1] that is not shown: the rounding of exact extrema."""


def format_excess(ratio: float) -> str:
    """Describe by how much a ratio to a limit exceeds 1."""
    if not np.isfinite(ratio):
        return "unbounded"
    return f"by {100.0 * (ratio - 1.0):.3g} %" if ratio < 2.0 else f"{ratio:.3g} times its limit"


def format_ratio(ratio: float) -> str:
    """Format a ratio to a limit with three digits, or with more if it is barely above 1."""
    if not np.isfinite(ratio):
        return "∞"
    return describe_ratio(ratio) if EXACT_EXCESS < ratio - 1.0 < 5e-3 else f"{ratio:.3g}"


def describe_effort(proof: Any, robot: Any, robots: Sequence[Any] = ()) -> str:
    """Describe the mass model of a motion, its energy and its power."""
    payload = robot.payload
    net = round(proof.energy.net, 9) + 0.0  # neither rounding errors nor −0
    loads = list(dict.fromkeys(str(arm.payload or "none") for arm in robots))  # of a program
    load = "without payload" if payload is None else f"with {payload}"
    load = f"with payloads {', '.join(loads)}" if loads[1:] else load
    words = (
        f"for this mass model, {load}: energy {net:.3g} J ({proof.energy.drawn:.3g} J without recovery while "
        f"braking), peak power {round(proof.energy.power, 9):.3g} W"
    )
    if proof.friction_steps:
        most = max(proof.friction_steps, key=lambda step: step.size)
        unit = "N" if robot.prismatic[robot.joint_names.index(most.joint)] else "N·m"
        steps = f"which steps {len(proof.friction_steps)} times by up to {most.size:.3g} {unit}"
        words += f"; torque rates exclude Coulomb friction, {steps}"
    return words


SMOOTH = {
    -1: "discontinuous positions",
    0: "discontinuous velocities",
    1: "discontinuous accelerations",
    2: "continuous accelerations",
    3: "continuous jerks",
}
"""Meaning of `Certificate.continuous`."""


def describe_clearance(found: Any) -> str:
    """Describe the least distances to the scene and between links, each with its margin."""
    lines = [f"clearance {words}, proved for these shapes: {kind.describe()}" for words, kind in found.kinds.items()]
    lines += [f"note: {found.note}"] if found.note else []
    return "\n".join(
        [*lines, f"{len(found.left_out)} pairs of links are not checked; --json lists them with the reasons"]
    )


def print_certificate(plan: Any, by_law: tuple[str, ...]) -> None:
    """Print a plan's certificate; `by_law` are the limits that its time law enforces."""
    from planners.certificate.certificate import describe_scope
    from planners.limits import ALL_LIMITS, DERIVATIVES

    proof, off = plan.certificate, plan.certificate.path_error
    limits = (*ALL_LIMITS, *proof.extra)
    way = f"{1e3 * plan.path.end:.1f} mm" if plan.path.unit == "m" else f"{np.degrees(plan.path.end):.4g}°"
    arms, parts = getattr(plan.path, "robots", (plan.robot,)), getattr(plan, "parts", ())
    way = f"{format_count(len(parts), 'part')} in {format_count(len(arms), 'section')}" if parts else way
    way += plan.describe_idle() if parts else ""
    title = f"{plan.solver} + {plan.law}: {way} in {proof.duration:.4f} s"
    table = Table("", "peak / limit", "joint", "time, s", f"enforced by {plan.law}", title=title)
    for field in limits:
        ratio, joint, t = proof.worst(field)
        name, required = (
            field.replace("_", " "),
            "yes" if field in by_law else "no, but given" if field in proof.enforced else "no",
        )
        if not np.isnan(ratio):
            table.add_row(name, format_ratio(ratio), joint, f"{t:.3f}", required)
        elif field in DERIVATIVES:
            table.add_row(name, "no limit", "", "", required)
    out_console.print(table)
    for name in proof.exempt:
        out_console.print(f"limit on {name.replace('_', ' ')}{describe_scope(proof, name)}")
    if plan.least_duration:
        out_console.print(f"least duration {plan.least_duration:.4f} s: the slowest joint alone, from rest to rest")
    angle = f" and {1e6 * off.angle:.3g} µrad" + " of the axis" * (proof.asked == "axis")
    out_console.print(
        f"path error at most {1e6 * off.distance:.3g} µm{angle * (proof.asked != 'point')} (proved for every instant), "
        f"tool speed at most {proof.tool_speed.value:.3g} m/s, smallest singular value "
        f"{proof.singular_value:.3g} at {proof.t_singular_value:.3f} s, {SMOOTH[proof.continuous]}"
    )
    if proof.energy is not None:
        out_console.print(describe_effort(proof, plan.robot, arms))
    if proof.clearance is not None:
        out_console.print(describe_clearance(proof.clearance))
    if plan.slowed > 1.0:
        stretch = 100.0 * (plan.slowed - 1.0)
        out_console.print(f"duration stretched by {stretch:.3g} % to meet the limits")
    beyond = [f for f in limits if f not in proof.enforced and proof.worst(f)[0] > 1.0]
    if beyond:
        words = ", ".join(f"{f.replace('_', ' ')} {format_excess(proof.worst(f)[0])}" for f in beyond)
        out_console.print(f"exceeded, since not enforced by {plan.law}: {words}", style="yellow")
    if proof.is_valid:
        kept = (
            "every limit that the law enforces is respected at every instant"
            if proof.enforced
            else f"joint ranges and path are respected; {plan.law} enforces no other limit"
        )
        out_console.print(f"certificate valid: {kept}", style="green")
    else:
        out_console.print("certificate NOT valid: " + translate("; ".join(proof.reasons)), style="yellow")


def _print_corners(plan: Any) -> None:
    """Print the rounded corners of a program, and those that are narrower than their zone, or stops."""
    corners = getattr(plan, "corners", ())
    if corners:
        away, turned = (max(corner.deviation[k] for corner in corners) for k in (0, 1))
        rounded = format_count(sum(corner.end > corner.begin for corner in corners), "rounded corner")
        most = f"at most {1e3 * away:.3g} mm and {np.degrees(turned):.3g}° from the sharp path (proved)"
        out_console.print(f"{rounded}, {most}", soft_wrap=True)
    reduced = [corner for corner in corners if corner.reduced]
    for corner in reduced[:MOST_CORNERS]:
        name = plan.parts[corner.part].name
        what = (
            f"{1e3 * corner.deviation[0]:.3g} of {1e3 * corner.zone[0]:.3g} mm"
            if corner.end > corner.begin
            else "a stop"
        )
        words = f"  after part {corner.part + 1}{f' {name!r}' if name else ''}: {what}: {corner.reduced}"
        out_console.print(words, soft_wrap=True)
    if len(reduced) > MOST_CORNERS:
        out_console.print(f"  and {len(reduced) - MOST_CORNERS} more; --json lists them")


def print_choice(plan: Any) -> None:
    """Print what a plan chose: the freedoms of its path, and how it avoided obstacles."""
    from planners.paths.free_path import FreePath
    from planners.paths.point_to_point import PointToPoint

    chosen, search = plan.freedom, plan.search
    _print_corners(plan)
    if plan.resolution is not None:
        out_console.print(translate(str(plan.resolution)).strip(), soft_wrap=True)
    if search is not None:
        words = f"{format_count(search.rounds, 'round')} of path and timing"
        if not isinstance(plan.path, FreePath):  # which is not searched
            paths = format_count(search.paths, "initial path")
            words = f"{search.planner} with {search.samples} random configurations, {paths}, {words}"
        out_console.print(f"search: {words}", soft_wrap=True)
    if chosen is None:
        return
    words = f"free path: {chosen.outcome}"
    if chosen.gain > 0.0:
        words += f", {100.0 * chosen.gain:.3g} % shorter than {chosen.fixed_duration:.4f} s along the initial path"
    tried = f"{chosen.starts} initial guess{'es' * (chosen.starts != 1)}, {chosen.steps} Newton steps"
    out_console.print(f"{words} ({tried})" if chosen.starts else words, soft_wrap=True)
    for one in chosen.ranges if chosen.gain > 0.0 else ():
        factor, unit = (180.0 / np.pi, "°") if one.unit == "rad" else (1e3, " mm")
        low, high = (f"{factor * x:.3g}" for x in one.reached)
        allowed = "no bounds"
        if np.isfinite(one.allowed).all():
            allowed = f"allowed {factor * one.allowed[0]:.3g} to {factor * one.allowed[1]:.3g}{unit}"
        out_console.print(f"  {one.name}: {low} to {high}{unit} (proved; {allowed})", soft_wrap=True)
    if isinstance(plan.path, PointToPoint) and plan.path.vias and plan:
        away, turned = plan.path.via_errors.max(axis=0)
        words = f"at most {1e3 * away:.3g} mm and {np.degrees(turned):.3g}° away"
        out_console.print(f"  via points: {len(plan.path.vias)}, passed in order, {words}", soft_wrap=True)
    if chosen.gain > 0.0 and np.isfinite(chosen.distance):
        off = f"{1e3 * chosen.distance:.3g} mm and {np.degrees(chosen.angle):.3g}°"
        out_console.print(f"  tool at most {off} from the given path (proved)", soft_wrap=True)
