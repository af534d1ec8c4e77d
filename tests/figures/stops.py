"""Stops of random plans at random instants: each has an answer, is valid, begins exactly, and is early.

The oracle of validity samples the polynomials (Horner's rule) at 2 kHz and more; the best of ten optima with fixed ends says
how early.
"""

from __future__ import annotations

from time import process_time

import numpy as np

from optik.errors import OptikError
from planners import Plan, replan
from planners.motion.fit import match_start
from planners.replan.state import build_moving_state
from planners.timing.optimal import Optimal
from tests import oracles
from tests.figures.figure import Row, Value, main
from tests.figures.moving import STOPS_PER_PLAN, valid_plan

COUNT, COMPARED = 3000, 10
FACTORS = (0.7, 0.8, 0.88, 0.94, 0.97, 1.0, 1.03, 1.08, 1.15, 1.3)


def measure(case: int) -> Row:
    """One stop: with `time_limit=0`, with the default, and for every tenth the best of ten optima with fixed ends."""
    made = valid_plan(case // STOPS_PER_PLAN)
    if made is None:
        return {"plan": False}
    rng = np.random.default_rng([7, case])
    t = float(rng.uniform(0.0, 1.0)) * made.trajectory.duration
    begin = process_time()
    try:
        sweep, refined = replan(made, t, stop=True, time_limit=0.0), replan(made, t, stop=True)
    except OptikError as error:
        return {"plan": True, "refused": str(error)}
    row: Row = {"plan": True, "law": made.law, "cpu": process_time() - begin, "left": made.trajectory.duration - t}
    for name, found in (("sweep", sweep), ("refined", refined)):
        row[f"{name}_valid"] = bool(found)
        if found:
            row |= {f"{name}_duration": found.trajectory.duration, f"{name}_kind": str(found.stop_kind)}
            row[f"{name}_start"] = exact(made, t, found)
            row[f"{name}_wrong"] = wrong(found)
        else:
            row[f"{name}_reason"] = "" if found.failure is None else found.failure.reason
    if case % COMPARED == 0 and refined and "jerk" in made.certificate.enforced:
        row["best"] = best_of_ten(made, t, refined)
    return row


def exact(made: Plan, t: float, found: Plan) -> float:
    """Largest difference of the stop's first state from that of the running motion."""
    return max(float(np.abs(found.trajectory(0.0, k) - made.trajectory(t, k)).max()) for k in range(3))


def wrong(found: Plan) -> list[str]:
    """What samples of the stop contradict."""
    joints = oracles.Joints(found.trajectory)
    at = np.linspace(0.0, joints.t[-1], max(400, int(2000 * joints.t[-1])))[:20000]
    return [word for word in oracles.joint_extremes(found, joints, at)]


def best_of_ten(made: Plan, t: float, found: Plan) -> float | None:
    """Shortest valid duration of ten optima that end around where the stop ends."""
    start = build_moving_state(made, made.trajectory, t)
    assert found.span is not None
    best: list[float] = []
    for factor in FACTORS:
        end = start.at.s + factor * (found.span[1] - start.at.s)
        if start.at.s < end < made.joint_path.end:
            motion = Optimal(intervals=100).run_to(made.joint_path, made.limits, start.at, end)
            if motion is not None:
                best.append(match_start(motion, start.joints, made.limits).duration)
    return min(best, default=None)  # type: ignore[type-var]


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    asked = [r for r in rows if r["plan"]]
    valid = [r for r in asked if r.get("refined_valid") and r.get("sweep_valid")]
    refused = sum("refused" in r or r.get("refined_reason", "") != "" for r in asked)
    late = [r["refined_duration"] / min(r["best"], r["left"]) for r in valid if r.get("best")]
    swept = [r["sweep_duration"] / min(r["best"], r["left"]) for r in valid if r.get("best")]
    kinds = {k: sum(r["refined_kind"] == k for r in valid) for k in ("optimum", "sweep", "end")}
    off = max((r["refined_start"] for r in valid), default=np.nan)
    contradicted = sum(bool(r["refined_wrong"] or r["sweep_wrong"]) for r in valid)
    later = float(np.mean(np.array(late) > 1.1)) if late else np.nan
    median = float(np.median(swept)) if swept else np.nan
    return [
        Value("stops refused", f"0 of {COUNT}", f"{refused} of {len(asked)}", refused == 0),
        Value("stops not valid", "0", str(len(asked) - len(valid)), len(valid) == len(asked)),
        Value("contradicted by samples", "0", str(contradicted), contradicted == 0),
        Value("start not exact", "0", f"largest difference {off:.3g}", off <= 1e-9),
        Value("later than 1.1 × the best of ten", "≤ 1 %", f"{100 * later:.2f} % of {len(late)}", later <= 0.01),
        Value("the sweep over the best of ten, median", "≤ 1.5", f"{median:.4g}", median <= 1.5),
        Value("kinds", "stated", str(kinds), True),
    ]


if __name__ == "__main__":
    main("stops", measure, COUNT, judge)
