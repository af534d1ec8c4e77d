"""CPU time of a stop with `time_limit=0`, its certificate included: panda with torque and ur5e, polylines of 15 and 150 points.

Run it alone on the machine. Each stop is computed three times in turn with the other arms and paths; the least time counts.
"""

from __future__ import annotations

from functools import lru_cache
from time import process_time

import numpy as np

import optik
from planners import MotionLimits, Plan, Polyline, plan, replan
from tests.figures.figure import Row, Value, main
from tests.figures.moving import seam, span

KINDS = tuple((arm, points) for arm in ("ur5e", "panda") for points in (15, 150))
COUNT, PER_PLAN, REPEATS = 400, 10, 3


@lru_cache(maxsize=len(KINDS))
def polyline(arm: str, points: int, number: int) -> Plan:
    """A valid plan on a random polyline of 0.25 m; panda carries 2 kg under limits on its torques."""
    robot = optik.load(arm)
    robot = robot.with_payload(2.0) if arm == "panda" else robot
    low, high = span(robot)
    for trial in range(100):
        rng = np.random.default_rng([10, points, number, trial, len(arm)])
        q = low + (high - low) * rng.uniform(0.3, 0.7, robot.n)
        path = Polyline(seam(robot.fk(q), points, 0.25, rng), blend=0.001, blend_rotation=0.01)
        limits = MotionLimits(2.0, 10.0, 100.0)
        if arm == "panda":
            limits = MotionLimits(robot.limits.velocity, None, 2000.0, torque=robot.limits.torque)
        if made := plan(robot, path, q, limits=limits):
            for warm in (0.2, 0.6):
                replan(made, warm * made.trajectory.duration, stop=True, time_limit=0.0)
            return made
    raise AssertionError("no plan")


def measure(case: int) -> Row:
    """The same instant, as a fraction of the duration, of all four kinds."""
    times: dict[str, float] = {}
    at = float(np.random.default_rng([11, case]).uniform(0.02, 0.98))
    for _ in range(REPEATS):
        for arm, points in KINDS:
            made = polyline(arm, points, case // (PER_PLAN * len(KINDS)))
            begin = process_time()
            found = replan(made, at * made.trajectory.duration, stop=True, time_limit=0.0)
            took = process_time() - begin
            key = f"{arm} {points}"
            times[key] = min(times.get(key, np.inf), took)
            times[f"{key} valid"] = float(bool(found))
    return times


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    out, median = [], {}
    for arm, points in KINDS:
        key = f"{arm} {points}"
        ms = 1e3 * np.array([row[key] for row in rows])
        median[arm, points], late = float(np.median(ms)), float(np.quantile(ms, 0.99))
        valid = sum(row[f"{key} valid"] for row in rows)
        out.append(Value(f"{key} points, median [ms]", "≤ 4", f"{median[arm, points]:.3g}", median[arm, points] <= 4.0))
        out.append(Value(f"{key} points, p99 [ms]", "≤ 15", f"{late:.3g}", late <= 15.0))
        out.append(Value(f"{key} points, valid", "all", f"{valid:.0f} of {len(rows)}", valid == len(rows)))
    for arm in ("ur5e", "panda"):
        ratio = median[arm, 150] / median[arm, 15]
        out.append(Value(f"{arm}, 150 over 15 points", "0.8 to 1.2", f"{ratio:.3g}", 0.8 <= ratio <= 1.2))
    return out


if __name__ == "__main__":
    main("stop_cpu", measure, COUNT, judge, part=0.25)
