"""What a plan keeps, as the command line prints it for people."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.cli.shared import out_console


def much(ratio: float) -> str:
    """How far a ratio is beyond 1, in words."""
    return f"{ratio:.3g} times its limit" if np.isfinite(ratio) else "without bound"


def effort_words(planned: Any) -> str:
    """What the torques of a plan stand on, and what the motion takes."""
    proof, payload = planned.certificate, planned.robot.payload
    load = "without a payload" if payload is None else f"with {payload}"
    words = (
        f"for this model of the masses, {load}: energy {proof.energy.net:.4g} J, {proof.energy.drawn:.4g} J if braking gives "
        f"nothing back, largest power found {proof.energy.power:.4g} W"
    )
    if proof.friction_steps:
        most = max(step.size for step in proof.friction_steps)
        steps = f"; Coulomb friction steps {len(proof.friction_steps)} times, by {most:.3g} at most"
        words += f"{steps}, which the torque rate does not count"
    return words


SMOOTH = {
    -1: "positions jump",
    0: "velocities jump",
    1: "accelerations jump",
    2: "accelerations continuous",
    3: "jerks continuous",
}
"""What `Certificate.continuous` says, in words."""


def clearance_line(found: Any) -> str:
    """Say how near the arm comes to the scene and to itself."""
    lines = []
    for words, kind in (("to the scene", found.scene), ("between links", found.own)):
        if kind is not None:
            proved = f"at least {1e3 * kind.value:.4g} mm for every instant" if np.isfinite(kind.value) else "no bound"
            first, second = kind.pair
            where = f"{1e3 * kind.found:.4g} mm between {first} and {second} at {kind.time:.3f} s"
            lines.append(f"clearance {words}: {proved} (proved for these shapes), found {where}")
    return "\n".join([*lines, f"{len(found.left_out)} pairs are left out: certificate.clearance.left_out names them"])


def print_certificate(planned: Any) -> None:
    """Print what a plan keeps, for people."""
    from planners.limits import ALL_LIMITS, DERIVATIVES

    proof, off = planned.certificate, planned.certificate.path_error
    way = f"{1e3 * planned.path.end:.1f} mm" if planned.path.unit == "m" else f"{planned.path.end:.4g} rad"
    table = Table(
        "", "peak / limit", "joint", "at, s", "required",
        title=f"{planned.ik} + {planned.law}: {way} in {proof.duration:.4f} s",
    )  # fmt: skip
    for field in ALL_LIMITS:
        ratio, joint, t = proof.worst(field)
        name, required = field.replace("_", " "), "yes" if field in proof.enforced else "no"
        if not np.isnan(ratio):
            table.add_row(name, f"{ratio:.8g}", joint, f"{t:.4f}", required)
        elif field in DERIVATIVES:
            table.add_row(name, "no limit", "", "", required)
    out_console.print(table)
    out_console.print(
        f"tool off the path at most {1e6 * off.distance:.3g} µm and {1e6 * off.angle:.3g} µrad (proved for every instant), "
        f"tool speed at most {proof.tool_speed.value:.3g} m/s, smallest singular value {proof.singular_value:.3g} "
        f"at {proof.t_singular_value:.3f} s, {SMOOTH[proof.continuous]}",
        highlight=False,
    )
    if proof.energy is not None:
        out_console.print(effort_words(planned), highlight=False)
    if proof.clearance is not None:
        out_console.print(clearance_line(proof.clearance), highlight=False)
    if planned.slowed > 1.0:
        slowed = f"slowed by {planned.slowed:.9g} until it kept what the law promises"
        out_console.print(slowed, highlight=False)
    beyond = [f for f in ALL_LIMITS if f not in proof.enforced and proof.worst(f)[0] > 1.0]
    if beyond:
        words = ", ".join(f"{f.replace('_', ' ')} {much(proof.worst(f)[0])}" for f in beyond)
        out_console.print(f"not enforced by {planned.law}, and exceeded: {words}", style="yellow", highlight=False)
    if proof.is_valid:
        kept = (
            "every required limit is respected at every instant"
            if proof.enforced
            else f"joint ranges and path only; no limit is required of {planned.law}"
        )
        out_console.print(f"certificate valid: {kept}", style="green", highlight=False)
    else:
        out_console.print("certificate NOT valid: " + "; ".join(proof.reasons), style="yellow", highlight=False)
