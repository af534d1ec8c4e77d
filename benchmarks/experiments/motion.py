"""Claims about the line: quintic segments give smooth joint motion; the tool stays on the line, orientation constant."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.experiments.base import FAILS, HOLDS, PARTLY, UNTESTED, Finding
from benchmarks.records import RunFolder, rows_file

BARELY = 1e-9
"""Jumps of q [rad], q̇ [rad/s] and q̈ [rad/s²] at knots up to this size are rounding."""

ROUNDING = 1e-12
"""Jumps up to this [rad, rad/s, rad/s²] are rounding of double precision: reports write ≤ this."""

ON_LINE_M, ON_LINE_RAD = 1e-4, np.deg2rad(0.01)
"""Largest distance [m] and angle [rad] at which the tool counts as on the line at constant orientation."""


def quintic_plan(folder: RunFolder) -> dict[str, Any] | None:
    """Return the first solved plan with the time law of the paper."""
    plans = (folder.read_json(rows_file("plans", "line", "json")) or {"plans": []})["plans"]
    return next((p for p in plans if p["law"] == "quintic" and p["status"] == "solved"), None)


def smooth_joints(folder: RunFolder) -> Finding:
    """Claim (f): quintic segments give smooth joint motion."""
    claim = "Quintic segments between the samples give smooth joint motion without jumps."
    rule = (
        "Exact one-sided values at the knots. Holds if position, velocity and acceleration are continuous, and velocity, "
        "acceleration and jerk are within the limits of the robot. Holds when smooth means continuous acceleration if they are "
        "continuous but exceed a limit. Does not hold if one of them is discontinuous."
    )
    plan = quintic_plan(folder)
    if plan is None:
        return Finding("f", claim, UNTESTED, "The run has no solved line with the quintic law.", rule)
    certificate = plan["certificate"]
    jumps = {k: max(v) for k, v in plan["jumps"].items()}
    smooth = all(jumps[k] <= BARELY for k in ("position", "velocity")) and certificate["continuous"] >= 2
    worst = {f: _worst(certificate, f) for f in ("velocity", "acceleration", "jerk")}
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
    plan = quintic_plan(folder)
    if plan is None:
        return Finding("g", claim, UNTESTED, "The run has no solved line with the quintic law.", rule)
    off = plan["certificate"]["path_error"]
    figures = (
        ("largest distance from the line", f"{1e6 * off['distance']:.3g} µm at t = {off['t_distance']:.3f} s"),
        (
            "largest rotation from the constant orientation",
            f"{1e6 * off['angle']:.3g} µrad at t = {off['t_angle']:.3f} s",
        ),
        (
            "largest IK error at samples, before refinement",
            f"{1e6 * plan['ik_position_error']:.3g} µm, {1e6 * plan['ik_rotation_error']:.3g} µrad",
        ),
    )
    text = (
        f"The tool is never more than {1e6 * off['distance']:.2g} µm off the line and {1e6 * off['angle']:.2g} µrad off its "
        f"orientation over {1e3 * plan['length']:.0f} mm, with {plan['samples']} samples."
    )
    if off["distance"] <= ON_LINE_M and off["angle"] <= ON_LINE_RAD:
        verdict = HOLDS
    else:
        near = plan["ik_position_error"] <= ON_LINE_M and plan["ik_rotation_error"] <= ON_LINE_RAD
        verdict = f"{PARTLY} only the samples count" if near else FAILS
    return Finding("g", claim, verdict, text, rule, figures)


def _jump(size: float, unit: str) -> str:
    """Format a discontinuity with its unit; one up to `ROUNDING` is not a result."""
    return f"≤ 1e-12 {unit}" if size <= ROUNDING else f"{size:.1g} {unit}"


def _worst(certificate: dict[str, Any], field: str) -> tuple[float, str]:
    extreme, joints = certificate[field], certificate["joint_names"]
    ratios = [
        np.inf if v is None else (-np.inf if r is None else r)
        for v, r in zip(extreme["value"], extreme["ratio"], strict=True)
    ]
    i = int(np.argmax(ratios))
    return float(ratios[i]), f"{ratios[i]:.3g} ({joints[i]} at t = {extreme['time'][i]:.4f} s)"
