"""Section: the time laws side by side, from their certificates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.kinds.plans.report.look import line_plans
from benchmarks.report.numbers import number
from benchmarks.report.numbers import ratio as ratio_of
from benchmarks.report.run import Run
from optik.arm.limits import LIMIT_TOLERANCE
from planners.limits import DERIVATIVES


@dataclass(frozen=True)
class Worst:
    """The worst value of a derivative over its limit: of which joint, and when.

    Attributes
    ----------
    ratio : float or None
        Value over limit, infinite at a jump; None where no joint has a limit.
    value : float
        The value itself.
    """

    ratio: float | None
    value: float
    joint: str
    time: float

    @property
    def infinite(self) -> bool:
        """Whether the next lower derivative jumps."""
        return self.value == float("inf")

    @property
    def broken(self) -> bool:
        """Whether it is beyond the limit."""
        return self.ratio is not None and self.ratio > 1.0


def worst(certificate: dict[str, Any], field: str) -> Worst:
    """Worst of one of velocity, acceleration and jerk, read from a certificate in a file.

    In the file, None in a value means infinity. None in a ratio means infinity where the value is infinite, else no limit.

    Parameters
    ----------
    certificate : dict
        As files have it.
    field : str
        ``velocity``, ``acceleration`` or ``jerk``.

    Returns
    -------
    Worst
        The worst of all joints that have a limit; of all joints where none has.
    """
    extreme = certificate[field]
    inf = float("inf")
    found: list[Worst] = []
    for joint, value, ratio, time in zip(
        certificate["joint_names"], *(extreme[k] for k in ("value", "ratio", "time")), strict=True
    ):
        size = inf if value is None else float(value)
        found.append(Worst(inf if value is None else ratio, size, joint, time))
    limited = [w for w in found if w.ratio is not None]
    if limited:
        return max(limited, key=lambda w: w.ratio if w.ratio is not None else 0.0)
    return max(found, key=lambda w: w.value)


def broken_limits(certificate: dict[str, Any]) -> list[str]:
    """Limits that a motion breaks, promised or not, in words; empty where it keeps all.

    Parameters
    ----------
    certificate : dict
        As files have it.

    Returns
    -------
    list of str
        Limits in words.
    """
    out = []
    for field in DERIVATIVES:
        w = worst(certificate, field)
        if w.broken:
            out.append(f"{field} ∞" if w.infinite else f"{field} {ratio_words(w)}×")
    if min(certificate["position_margin"]) < -LIMIT_TOLERANCE:
        out.append("joint range")
    return out


def ratio_words(w: Worst) -> str:
    """Value over limit; near 1 with as many digits as show how near.

    Parameters
    ----------
    w : Worst
        The worst value.

    Returns
    -------
    str
        Such as 1.0000057.
    """
    return "no limit" if w.ratio is None else ratio_of(w.ratio)


def laws(run: Run) -> dict[str, Any] | None:
    """One row for each IK method and law; motions that keep every limit are ranked on duration, the others are not.

    Parameters
    ----------
    run : Run
        The run.

    Returns
    -------
    dict or None
        What the template shows; None where the run has no data for it.
    """
    found = line_plans(run)
    if found is None:
        return None
    rows = [_row(p, run) for p in found.plans]
    for ik in {p["ik"] for p in found.plans}:
        within = [r for r in rows if r["ik"] == ik and r["solved"] and not r["breaks"]]
        for place, r in enumerate(sorted(within, key=lambda r: r["duration"]), start=1):
            r["rank"] = str(place)
    first = found.solved[0] if found.solved else None
    return {
        "rows": rows, "fields": DERIVATIVES,
        "length": first and first["length"],
        "limits": _limit_words(first["limits"]) if first else "",
    }  # fmt: skip


def _row(p: dict[str, Any], run: Run) -> dict[str, Any]:
    row: dict[str, Any] = {
        "ik": p["ik"], "law": p["law"], "name": p["name"], "solved": p["status"] == "solved", "rank": "–",
        "colour": run.colour(p["law"]), "milliseconds": number(1e3 * p["seconds"]),
    }  # fmt: skip
    if not row["solved"]:
        why = (
            f"{p['status'].replace('_', ' ')} at {number(1e3 * p['s'])} mm: {p['reason']}"
            if "reason" in p
            else p["status"]
        )
        return row | {"why": why}
    c = p["certificate"]
    sampled = max(range(len(c["sampled_jerk"])), key=lambda i: c["sampled_jerk"][i])
    return row | {
        "duration": p["duration"],
        "worst": {f: worst(c, f) for f in DERIVATIVES},
        "ratios": {f: ratio_words(worst(c, f)) for f in DERIVATIVES},
        "sampled_jerk": number(c["sampled_jerk"][sampled]), "sampled_joint": c["joint_names"][sampled], "rate": c["rate"],
        "distance": number(1e6 * c["path_error"]["distance"]), "angle": number(1e6 * c["path_error"]["angle"]),
        "speed": number(1e3 * c["tool_speed"]["value"]), "continuous": c["continuous"], "rest": c["rest"],
        "keeps": c["keeps"], "holds": c["holds"], "broken": c["broken"], "breaks": broken_limits(c),
        "end_error": number(p["end_error"]),
    }  # fmt: skip


def _limit_words(limits: dict[str, list[float | None]]) -> str:
    units = {"velocity": "rad/s", "acceleration": "rad/s²", "jerk": "rad/s³"}
    words = []
    for field, unit in units.items():
        values = list(dict.fromkeys(limits[field]))
        text = ", ".join("free" if v is None else f"{v:g}" for v in values)
        words.append(
            f"{field} {text} {unit}"
            + (" on every joint" if len(values) == 1 else " (joint by joint, repeats left out)")
        )
    return "; ".join(words)
