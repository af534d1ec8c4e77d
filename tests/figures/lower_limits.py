"""Lower limits while moving: an answer that exceeds the new limits only before `within_limits_from`, and the old ones never."""

from __future__ import annotations

import numpy as np

from optik.errors import OptikError
from planners import replan
from tests import oracles
from tests.figures.figure import Row, Value, main
from tests.figures.moving import valid_plan

COUNT, PER_PLAN = 500, 5


def measure(case: int) -> Row:
    """One call with velocity, acceleration, jerk and tool speed of 0.3 to 0.9 of the plan's."""
    made = valid_plan(case // PER_PLAN)
    if made is None:
        return {"plan": False}
    rng = np.random.default_rng([9, case])
    factor, t = float(rng.uniform(0.3, 0.9)), float(rng.uniform(0.02, 0.98)) * made.trajectory.duration
    names = [n for n in ("velocity", "acceleration", "jerk", "tool_speed") if n in made.certificate.enforced]
    lower = made.limits.scale(factor, tuple(names))
    try:
        again = replan(made, t, limits=lower)
    except OptikError as error:
        return {"plan": True, "refused": str(error)}
    row: Row = {"plan": True, "valid": bool(again), "law": made.law, "factor": factor, "names": names}
    if not again:
        return row | {"reason": "" if again.failure is None else again.failure.reason}
    since = again.within_limits_from
    row |= {"since": since, "old": ratio(again, made.limits, names, 0.0), "new": ratio(again, lower, names, since)}
    return row


def ratio(again: object, limits: object, names: list[str], since: float) -> float:
    """Largest ratio of samples at 2 kHz and more to limits on the joints, from a time on."""
    motion, n = again.trajectory, again.robot.n  # type: ignore[attr-defined]
    if since >= motion.duration:
        return 0.0
    t = np.linspace(since, motion.duration, max(500, int(2000 * (motion.duration - since))))[1:20000]
    joints, bound, worst = oracles.Joints(motion), limits.arrays(n), 0.0  # type: ignore[attr-defined]
    for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
        if name in names:
            worst = max(worst, float((np.abs(joints(t, order)) / bound[name]).max()))
    return worst


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    asked = [r for r in rows if r["plan"]]
    refused = [r for r in asked if "refused" in r or not r.get("valid", True)]
    valid = [r for r in asked if r.get("valid")]
    old, new = (max((r[k] for r in valid), default=np.nan) for k in ("old", "new"))
    later = sum(r["since"] > 0.0 for r in valid)
    return [
        Value("refused or not valid", f"0 of {COUNT}", f"{len(refused)} of {len(asked)}", not refused),
        Value("old limits exceeded (ratio of samples)", "≤ 1", f"{old:.9g}", old <= 1.0 + 1e-9),
        Value("new limits exceeded after within_limits_from", "≤ 1", f"{new:.9g}", new <= 1.0 + 1e-6),
        Value("slowed down first", "stated", f"{later} of {len(valid)}", True),
    ]


if __name__ == "__main__":
    main("lower_limits", measure, COUNT, judge)
