"""The line as the report takes it: its plans, and the table of time laws from their certificates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.blocks.arms import JOINT_LIMITS
from benchmarks.blocks.timing.plans import PLAN_REPEATS, LinePlans
from benchmarks.report.base import Run
from benchmarks.report.boards import Control
from benchmarks.report.figures import noise_floor
from benchmarks.report.numbers import number
from benchmarks.report.numbers import ratio as ratio_of
from benchmarks.report.tables import Column, Table
from optik.arm.limits import LIMIT_TOLERANCE
from planners.limits import DERIVATIVES, LOADED

DEFAULT_LAW = "optimal"
"""The law that a control selects first: the default of `planners.plan`."""


def law_control(laws: Sequence[str], *more: str) -> Control:
    """Return the control of laws; it selects the default law first, if the run has it."""
    return Control.of("law", "Time law", (*laws, *more), DEFAULT_LAW if DEFAULT_LAW in laws else "")


def line_plans(run: Run) -> LinePlans | None:
    """Return the plans of the line."""
    found: list[LinePlans] = run.of("plans")
    return found[0] if found else None


LIMIT_UNITS = {
    "velocity": "rad/s", "acceleration": "rad/s²", "jerk": "rad/s³", "torque": "N·m", "torque_rate": "N·m/s",
}  # fmt: skip
"""Units of limits."""

SAME_DURATION = 1e-9
"""Relative difference of durations up to which two motions count as equally long: rounding of a longer computation."""


@dataclass(frozen=True)
class Worst:
    """The largest ratio of a derivative to its limit, with its joint and time."""

    ratio: float | None
    """Value over limit, infinite at a jump; None where no joint has a limit."""
    value: float
    joint: str
    time: float

    @property
    def infinite(self) -> bool:
        """Whether the next lower derivative is discontinuous."""
        return self.value == float("inf")

    @property
    def broken(self) -> bool:
        """Whether the limit is exceeded."""
        return self.ratio is not None and self.ratio > 1.0


def worst(certificate: dict[str, Any], field: str) -> Worst:
    """Return the largest ratio of one of velocity, acceleration and jerk, read from a certificate in a file.

    In the file, None in a value means infinity. None in a ratio means infinity where the value is infinite, else no limit.
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
    """Describe the limits that a motion violates, enforced or not; empty if there are none."""
    out = []
    for field in (f for f in JOINT_LIMITS if f in DERIVATIVES or limits_torque(certificate, f)):
        w = worst(certificate, field)
        if w.broken:
            words = field.replace("_", " ")
            out.append(f"{words} ∞" if w.infinite else f"{words} {ratio_words(w)}×")
    if min(certificate["position_margin"]) < -LIMIT_TOLERANCE:
        out.append("joint range")
    return out


def ratio_words(w: Worst) -> str:
    """Format a ratio to a limit; near 1 with enough digits to show the difference."""
    return "no limit" if w.ratio is None else ratio_of(w.ratio)


def limits_torque(certificate: dict[str, Any], field: str) -> bool:
    """Return whether a motion had a limit on torque, or on its rate."""
    extreme = certificate.get(field) or {"time": []}
    return any(time is not None for time in extreme["time"])  # a value may be infinite, which a file has as None


LAW_COLUMNS = (
    Column("label", "Time law", show="text"),
    Column("duration", "duration", "s", "less", "precise", among="place"),
    Column("breaks", "limits exceeded", show="text"),
    *(Column(field, f"{field.replace('_', ' ')} / limit", show="text") for field in JOINT_LIMITS),
    Column("distance", "path deviation", "µm", "less"),
    Column("milliseconds", "planning", "ms", "less"),
    Column("place", "rank", show="text", aside=True),
    *(
        Column(f"{field}_at", f"{field.replace('_', ' ')}: joint and time", show="text", aside=True)
        for field in JOINT_LIMITS
    ),
    Column("energy", "energy without recovery", "J", aside=True),
    Column("power", "peak power", "W", aside=True),
    Column("scene", "clearance to the scene, proved", "mm", "more"),
    Column("own", "clearance between links, proved", "mm", "more"),
    Column("sampled", "sampled jerk", "rad/s³", aside=True),
    Column("angle", "path deviation", "µrad", aside=True),
    Column("speed", "tool speed", "mm/s", aside=True),
    Column("continuous", "continuity", show="text", aside=True),
    Column("rest", "rest at start, end", show="text", aside=True),
    Column("enforced", "enforces", show="text", aside=True),
    Column("holds", "certificate valid", show="text", aside=True),
    Column("end_error", "end error", "rad", aside=True),
)
"""Columns of the table of time laws; those of torque, energy and clearance only where a motion has them."""


def laws(run: Run) -> dict[str, Any] | None:
    """Return a row for each law, and the influence of the IK method."""
    found = line_plans(run)
    if found is None:
        return None
    return {"tables": run.tables_of("plans"), "after": [words for words in (ik_matters(found),) if words]}


def law_table(found: LinePlans) -> Table:
    """Return the table of the time laws, planned with the first IK method that solved the line."""
    solver = found.solver
    plans = [p for p in found.plans if p["solver"] == solver]
    within = [p for p in plans if p["status"] == "solved" and not broken_limits(p["certificate"])]
    ranks = {p["law"]: str(k) for k, p in enumerate(sorted(within, key=lambda p: p["duration"]), start=1)}
    first = found.solved[0] if found.solved else None
    note = (
        f"Line of {number(1e3 * first['length'])} mm, inverse kinematics by {solver}. Limits: {_limit_words(first['limits'])}. "
        "Ratios to the limits are exact, also between samples; ∞: the acceleration is discontinuous. A motion that exceeds a "
        "limit is not ranked. The path deviation is a proved bound. Planning time includes the certificate, "
        f"median of {PLAN_REPEATS}. Sampled jerk: differences of the accelerations at a controller's rate."
        if first
        else ""
    )
    rows = tuple(_row(p) | {"place": ranks.get(p["law"])} for p in plans)
    optional = {*LOADED, *(f"{field}_at" for field in LOADED), "energy", "power", "scene", "own"}
    columns = [c for c in LAW_COLUMNS if c.key not in optional or any(row.get(c.key) is not None for row in rows)]
    return Table("laws", "Time laws along the line", tuple(columns), rows, note)


def _row(p: dict[str, Any]) -> dict[str, Any]:
    row: dict[str, Any] = {"label": p["law"], "milliseconds": 1e3 * p["seconds"]}
    if p["status"] != "solved":
        where = f" at {number(1e3 * p['s'])} mm: {p['reason']}" if "reason" in p else ""
        return row | {"breaks": f"no motion: {p['status'].replace('_', ' ')}{where}"}
    c = p["certificate"]
    at = {f: worst(c, f) for f in JOINT_LIMITS if f in DERIVATIVES or limits_torque(c, f)}
    energy, clearance = c.get("energy"), c.get("clearance") or {}
    if energy:
        row |= {"energy": energy["drawn"], "power": energy["power"]}
    kinds = {name: clearance.get(name) for name in ("scene", "own")}
    row |= {name: 1e3 * kind["value"] for name, kind in kinds.items() if kind and kind["value"] is not None}
    return row | {
        "duration": p["duration"], "breaks": ", ".join(broken_limits(c)) or "none",
        **{f: ratio_words(w) for f, w in at.items()},
        **{f"{f}_at": f"{w.joint}, {w.time:.3f} s" for f, w in at.items()},
        "sampled": max(c["sampled_jerk"]), "distance": 1e6 * c["path_error"]["distance"],
        "angle": 1e6 * c["path_error"]["angle"], "speed": 1e3 * c["tool_speed"]["value"], "continuous": f"C{c['continuous']}",
        "rest": ", ".join("yes" if r else "no" for r in c["rest"]), "enforced": ", ".join(c["enforced"]) or "nothing",
        "holds": ("yes" if c["enforced"] else "nothing enforced") if c["is_valid"] else f"no: {'; '.join(c['reasons'])}",
        "end_error": p["end_error"],
    }  # fmt: skip


def ik_matters(found: LinePlans) -> str:
    """Describe in one sentence how much the motions depend on the IK method."""
    by_law: dict[str, list[dict[str, Any]]] = {}
    for p in found.solved:
        by_law.setdefault(p["law"], []).append(p)
    several = {law: plans for law, plans in by_law.items() if len(plans) > 1}
    if not several:
        return ""
    others = ", ".join(
        dict.fromkeys(p["solver"] for plans in several.values() for p in plans if p["solver"] != found.solver)
    )
    spread = {law: max(p["duration"] for p in ps) / min(p["duration"] for p in ps) - 1.0 for law, ps in several.items()}
    law = max(spread, key=lambda name: spread[name])
    off = max(abs(p["certificate"]["path_error"]["distance"] - q["certificate"]["path_error"]["distance"])
              for ps in several.values() for p in ps for q in ps)  # fmt: skip
    much = f"by at most {number(100 * spread[law], 2)} % ({law})" if spread[law] > SAME_DURATION else "not at all"
    return (
        f"With {others} in place of {found.solver}, durations change {much}, and path deviations by at most "
        f"{_small(1e6 * off)} µm: Newton polishing refines every sample after the IK method."
    )


def _small(micrometres: float) -> str:
    """Format a length; below the least result, as an upper bound."""
    floor = noise_floor("µm")
    return number(floor, 1).removeprefix("1·") if micrometres <= floor else number(micrometres, 2)


def _limit_words(limits: dict[str, Any]) -> str:
    words = []
    for field, unit in LIMIT_UNITS.items():
        if not isinstance(limits.get(field), list):
            continue
        given = limits[field]
        values = list(zip(*given, strict=True)) if isinstance(given[0], list) else [(None, v) for v in given]
        same = len(set(values)) == 1
        text = ", ".join(
            "free" if high is None else f"{high:g}" if low is None else f"{low:g} to {high:g}"
            for low, high in values[: 1 if same else None]
        )
        words.append(f"{field.replace('_', ' ')} {text} {unit}" + (" on every joint" if same else " (joint by joint)"))
    return "; ".join(words)
