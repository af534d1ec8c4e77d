"""`replan` with the plan's own limits and law, at random instants and just before the end, by time and as measured."""

from __future__ import annotations

import numpy as np

from optik.errors import OptikError
from planners import replan
from tests.figures.figure import Row, Value, main
from tests.figures.moving import STOPS_PER_PLAN, valid_plan

COUNT, NOISE = 3000, 1e-7


def measure(case: int) -> Row:
    """One call: anywhere, or 1 µs to 1 ms before the end; every other one with a measured state."""
    made = valid_plan(case // STOPS_PER_PLAN)
    if made is None:
        return {"plan": False}
    rng, end = np.random.default_rng([8, case]), made.trajectory.duration
    t = end - 10.0 ** rng.uniform(-6.0, -3.0) if case % 3 == 0 else float(rng.uniform(0.0, end))
    t = min(max(t, 0.0), end - 1e-6)
    state = tuple(made.trajectory(t, k) + rng.normal(0.0, NOISE, made.robot.n) for k in range(3)) if case % 2 else t
    try:
        again = replan(made, state)
    except OptikError as error:
        return {"plan": True, "refused": str(error), "left": end - t, "law": made.law, "measured": bool(case % 2)}
    row: Row = {"plan": True, "left": end - t, "law": made.law, "valid": bool(again), "measured": bool(case % 2)}
    if again:
        row["later"] = again.trajectory.duration - (end - t)
        row["start"] = max(float(np.abs(again.trajectory(0.0, k) - made.trajectory(t, k)).max()) for k in range(2))
    else:
        row["reason"] = "" if again.failure is None else again.failure.reason
    return row


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    asked = [r for r in rows if r["plan"]]
    refused, valid = [r for r in asked if "refused" in r], [r for r in asked if r.get("valid")]
    later, noisy = (max((r["later"] for r in valid if r["measured"] is m), default=np.nan) for m in (False, True))
    start = max((r["start"] for r in valid), default=np.nan)
    return [
        Value("refused", f"0 of {COUNT}", f"{len(refused)} of {len(asked)}", not refused),
        Value("not valid", "0", str(len(asked) - len(refused) - len(valid)), len(valid) + len(refused) == len(asked)),
        Value(
            "delay relative to the running motion, state given by its time [s]", "≤ 1e-6", f"{later:.3g}", later <= 1e-6
        ),
        Value("delay, measured states [s]", "not judged", f"{noisy:.3g}", True),
        Value("start off the motion's state [rad, rad/s]", "≤ 1e-5", f"{start:.3g}", start <= 1e-5),
    ]


if __name__ == "__main__":
    main("replans", measure, COUNT, judge)
