"""Claims about the line: quintic segments give smooth joint motion; the tool stays on the line, orientation constant."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.experiments.base import FAILS, HOLDS, PARTLY, UNTESTED, Finding
from benchmarks.records import RunFolder

BARELY = 1e-9
"""Jumps of q [rad], q̇ [rad/s] and q̈ [rad/s²] at knots up to this size are rounding."""

ROUNDING = 1e-12
"""Jumps up to this [rad, rad/s, rad/s²] are rounding of double precision: reports write ≤ this."""

ON_LINE_M, ON_LINE_RAD = 1e-4, np.deg2rad(0.01)
"""Largest distance [m] and angle [rad] at which the tool counts as on the line at constant orientation."""


def quintic_row(folder: RunFolder) -> dict[str, Any] | None:
    """Return the row of the first motion with the time law of the paper, along a line that is shown in detail."""
    blocks = [one for one in folder.manifest()["settings"].get("timing", []) if one.get("detail")]
    for block in blocks:
        rows = folder.rows("timing", block["id"])
        found = [] if rows is None else rows.filter(method="quintic", status="solved").head(1).to_dicts()
        if found:
            return found[0] | {"samples": block.get("samples", 151)}
    return None


def smooth_joints(folder: RunFolder) -> Finding:
    """Claim (f): quintic segments give smooth joint motion."""
    claim = "Quintic segments between the samples give smooth joint motion without jumps."
    rule = (
        "Exact one-sided values at the knots. Holds if position, velocity and acceleration are continuous, and velocity, "
        "acceleration and jerk are within the limits of the robot. Holds when smooth means continuous acceleration if they are "
        "continuous but exceed a limit. Does not hold if one of them is discontinuous."
    )
    plan = quintic_row(folder)
    if plan is None:
        return Finding("f", claim, UNTESTED, "The run has no solved line with the quintic law.", rule)
    jumps = dict(zip(("position", "velocity", "acceleration", "jerk"), plan["jumps"], strict=True))
    smooth = all(jumps[k] <= BARELY for k in ("position", "velocity")) and plan["continuous"] >= 2
    worst = {f: _worst(plan, f) for f in ("velocity", "acceleration", "jerk")}
    figures = (
        ("discontinuity of position at knots", _jump(jumps["position"], "rad")),
        ("discontinuity of velocity at knots", _jump(jumps["velocity"], "rad/s")),
        ("discontinuity of acceleration at knots", _jump(jumps["acceleration"], "rad/s²")),
        ("discontinuity of jerk at knots and at the start", f"{jumps['jerk']:.0f} rad/s³"),
        *((f"peak {f} / limit", words) for f, (_, words) in worst.items()),
    )
    text = (
        f"Position, velocity and acceleration are continuous to rounding. But going from rest to full speed within one "
        f"sample takes {worst['acceleration'][0]:.1f} times the acceleration limit and {worst['jerk'][0]:.0f} times the jerk "
        f"limit. The jerk changes at the knots by up to {jumps['jerk']:.0f} rad/s³."
    )
    if not smooth:
        return Finding("f", claim, FAILS, "The motion is discontinuous at its knots.", rule, figures)
    if all(ratio <= 1.0 for ratio, _ in worst.values()):
        return Finding("f", claim, HOLDS, "Continuous and within every limit.", rule, figures)
    return Finding("f", claim, f"{PARTLY} smooth means continuous acceleration", text, rule, figures)


def on_the_line(folder: RunFolder) -> Finding:
    """Claim (g): the tool stays on the line at constant orientation."""
    claim = "The tool stays on the straight line at constant orientation."
    rule = (
        "The largest deviation of the tool from line and orientation, a bound that holds at every instant. Holds within 0.1 mm "
        "and 0.01°. Holds when only the samples count if the tool is that near at the samples but not between them. "
        "Otherwise it does not hold."
    )
    plan = quintic_row(folder)
    if plan is None:
        return Finding("g", claim, UNTESTED, "The run has no solved line with the quintic law.", rule)
    figures = (
        ("largest distance from the line", f"{1e6 * plan['distance']:.3g} µm at t = {plan['distance_time']:.3f} s"),
        (
            "largest rotation from the constant orientation",
            f"{1e6 * plan['angle']:.3g} µrad at t = {plan['angle_time']:.3f} s",
        ),
        (
            "largest IK error at samples, before refinement",
            f"{1e6 * plan['ik_position_error']:.3g} µm, {1e6 * plan['ik_rotation_error']:.3g} µrad",
        ),
    )
    text = (
        f"The tool is never more than {1e6 * plan['distance']:.2g} µm off the line and {1e6 * plan['angle']:.2g} µrad off its "
        f"orientation over {1e3 * plan['length']:.0f} mm, with {plan['samples']} samples."
    )
    if plan["distance"] <= ON_LINE_M and plan["angle"] <= ON_LINE_RAD:
        verdict = HOLDS
    else:
        near = plan["ik_position_error"] <= ON_LINE_M and plan["ik_rotation_error"] <= ON_LINE_RAD
        verdict = f"{PARTLY} only the samples count" if near else FAILS
    return Finding("g", claim, verdict, text, rule, figures)


def _jump(size: float, unit: str) -> str:
    """Format a discontinuity with its unit; one up to `ROUNDING` is not a result."""
    return f"≤ 1e-12 {unit}" if size <= ROUNDING else f"{size:.1g} {unit}"


def _worst(plan: dict[str, Any], field: str) -> tuple[float, str]:
    ratio = float("nan") if plan[field] is None else float(plan[field])
    return ratio, f"{ratio:.3g} ({plan[f'{field}_joint']} at t = {plan[f'{field}_time']:.4f} s)"
