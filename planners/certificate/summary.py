"""Summaries of plans for people: at most fifteen lines of plain text, the status first."""

from __future__ import annotations

from planners.certificate.certificate import Certificate, shorten, summary_lines
from planners.paths.base import Path


def plan_summary(
    headline: str,
    path: Path,
    failure: tuple[float, str | None, str, str] | None,
    proof: Certificate | None,
    slowed: float,
) -> str:
    """Return a summary of a plan: its failure (path parameter, joint, reason, advice), and the certificate of its motion."""
    lines = [headline]
    if failure is not None:
        s, name, reason, advice = failure
        share = f" ({100.0 * s / path.end:.3g} % of the path)" if path.end > 0.0 else ""
        joint = f", {name}" if name else ""
        lines.append(f"stopped at s = {s:.3g} {path.unit}{share}{joint}")
        lines.append(f"reason: {shorten(reason)}")
        lines.append(f"try: {shorten(advice)}")
    if proof is not None:
        lines += summary_lines(proof)[failure is not None :]
        if slowed > 1.0:
            lines.append(f"duration stretched by {100.0 * (slowed - 1.0):.3g} % to meet the limits")
    return "\n".join(lines)
