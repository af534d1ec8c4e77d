"""Summaries of plans and certificates for people: at most fifteen lines of plain text, the status first."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from planners.certificate.certificate import Certificate
    from planners.plan import Plan

MOST_LIMITS = 7
"""Largest number of limits in a summary; those nearest to their bounds are shown."""


def plan_summary(plan: Plan, proof: Certificate | None) -> str:
    """Return a summary of a plan: its status, where and why planning failed, and its certificate if there is a motion."""
    path = plan.path
    what = f"{plan.robot.name}, {type(path).__name__} of {path.end:.3g} {path.unit}, {plan.solver} + {plan.law}"
    lines = [f"{plan.status}: {what}"]
    if plan.failure is not None:
        share = f" ({100.0 * plan.failure.s / path.end:.3g} % of the path)" if path.end > 0.0 else ""
        joint = f", {plan.failure.joint}" if plan.failure.joint else ""
        lines.append(f"stopped at s = {plan.failure.s:.3g} {path.unit}{share}{joint}")
        lines.append(f"reason: {shortened(plan.failure.reason)}")
        lines.append(f"try: {shortened(plan.failure.advice)}")
    if proof is not None:
        lines += certificate_lines(proof)[plan.failure is not None :]
        if plan.slowed > 1.0:
            lines.append(f"duration stretched by {100.0 * (plan.slowed - 1.0):.3g} % to meet the limits")
    return "\n".join(lines)


def certificate_lines(proof: Certificate) -> list[str]:
    """Return a summary of a certificate, at most eleven lines: validity, limits, path, tool, clearance."""
    if proof.is_valid:
        enforced = ", ".join(name for name in proof.enforced if not np.isnan(proof.worst(name)[0]))
        status = f"certificate valid; enforced: {enforced or 'joint ranges and path only'}"
    else:
        more = f" (and {len(proof.reasons) - 1} more violations)" if len(proof.reasons) > 1 else ""
        status = f"certificate NOT valid: {shortened(proof.reasons[0])}{more}"
    return [status, f"duration {proof.duration:.3g} s", *_limit_lines(proof), *_tool_lines(proof)]


def _limit_lines(proof: Certificate) -> list[str]:
    """Return the peak / limit lines, at most those with the largest ratios."""
    from planners.limits import ALL_LIMITS

    found = {name: proof.worst(name) for name in (*ALL_LIMITS, *proof.extra)}
    bounded = sorted((name for name in found if not np.isnan(found[name][0])), key=lambda name: -found[name][0])
    shown, lines = bounded[:MOST_LIMITS], []
    for name in (name for name in found if name in shown):
        ratio, subject, t = found[name]
        enforced = "" if name in proof.enforced else ", not enforced"
        lines.append(f"peak / limit, {name}: {ratio:.3g} ({subject} at {t:.3g} s{enforced})")
    if len(bounded) > MOST_LIMITS:
        lines[-1] += f"; {len(bounded) - MOST_LIMITS} more limits with smaller ratios"
    return lines


def _tool_lines(proof: Certificate) -> list[str]:
    """Return the lines on path error, tool speed and clearance."""
    off, lines = proof.path_error, []
    tool = f"tool speed at most {proof.tool_speed.value:.3g} m/s, smallest singular value {proof.singular_value:.3g}"
    if np.isfinite(off.distance):
        tool = f"path error at most {1e3 * off.distance:.3g} mm and {off.angle:.3g} rad, {tool}"
    lines.append(tool)
    if proof.clearance is not None and np.isfinite(proof.clearance.found):
        near = proof.clearance
        words = f"at least {1e3 * near.value:.3g} mm" if np.isfinite(near.value) else "not proved"
        first, second = near.pair
        lines.append(f"clearance {words}; found {1e3 * near.found:.3g} mm ({first} and {second} at {near.time:.3g} s)")
    return lines


def shortened(words: str, most: int = 300) -> str:
    """Return text on one line, cut to at most a number of characters."""
    line = " ".join(words.split())
    return line if len(line) <= most else f"{line[: most - 1]}…"
