"""CPU time of stops on paths of 1,000 points with `time_limit=0`, against the code of an earlier commit.

Two processes in turn, one for each code, plan the same paths and stop at the same instants: smooth curves of 0.1 to 0.4 m, on
ur5e, and on panda with limits on its torques. Each stop is computed three times in turn; the least time counts. The earlier
code is extracted by ``git archive``, and compiles its kernels once. Run it alone on the machine.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

EARLIER = "d3dcf0de"
COUNT, PER_PLAN, REPEATS, POINTS = 100, 10, 3, 1000


@lru_cache(maxsize=1)
def curve_plan(number: int) -> Any:
    """A valid plan on a smooth curve of 1,000 points."""
    import optik
    from planners import MotionLimits, Polyline, plan, replan
    from tests.figures.moving import span

    robot = optik.load(("ur5e", "panda")[number % 2])
    robot = robot.with_payload(2.0) if number % 2 else robot
    low, high = span(robot)
    for trial in range(100):
        rng = np.random.default_rng([12, number, trial])
        q = low + (high - low) * rng.uniform(0.3, 0.7, robot.n)
        length, scale = float(rng.uniform(0.1, 0.4)), 10.0 ** rng.uniform(-0.3, 0.3, 2)
        curve = make_interp_spline(np.arange(5.0), np.cumsum(rng.normal(size=(5, 3)), axis=0), k=3)(
            np.linspace(0.0, 4.0, 20001)
        )
        along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1)))
        at = np.linspace(0.0, along[-1], POINTS)
        poses = np.tile(robot.fk(q), (POINTS, 1, 1))
        way = np.stack([np.interp(at, along, curve[:, i] - curve[0, i]) for i in range(3)], axis=1)
        poses[:, :3, 3] += way * length / along[-1]
        path = Polyline(poses, blend=0.3 * length / POINTS, blend_rotation=0.01)
        limits = MotionLimits(2.0, *([10.0, 100.0] * scale))
        if number % 2:
            limits = MotionLimits(robot.limits.velocity, None, 2000.0 * scale[1], torque=robot.limits.torque)
        try:
            made = plan(robot, path, q, limits=limits)
        except ValueError:
            continue
        if made:
            for warm in (0.2, 0.6):
                replan(made, warm * made.trajectory.duration, stop=True, time_limit=0.0)
            return made
    raise AssertionError("no plan")


def answer() -> None:
    """Answer requests, a plan and an instant each, by the CPU time of the stop, its duration and whether it is valid."""
    from planners import replan

    for line in sys.stdin:
        number, at = json.loads(line)
        made = curve_plan(number)
        begin = process_time()
        found = replan(made, at * made.trajectory.duration, stop=True, time_limit=0.0)
        took = process_time() - begin
        print(json.dumps([took, found.trajectory.duration, bool(found)]), flush=True)


@lru_cache(maxsize=1)
def processes() -> tuple[subprocess.Popen[str], subprocess.Popen[str]]:
    """The processes of the earlier and of the present code."""
    root = Path(__file__).resolve().parents[2]
    earlier = Path(os.environ.get("FIGURES", root / ".figures")).absolute() / EARLIER
    if not earlier.exists():
        packed = subprocess.run(["git", "archive", EARLIER], cwd=root, capture_output=True, check=True).stdout
        with tarfile.open(fileobj=BytesIO(packed)) as archive:
            archive.extractall(earlier, filter="data")
    first, second = (
        subprocess.Popen(
            [sys.executable, __file__, "answer"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": str(tree)},
        )
        for tree in (earlier, root)
    )  # fmt: skip
    return first, second


def measure(case: int) -> dict[str, Any]:
    """One stop by both codes."""
    at = float(np.random.default_rng([13, case]).uniform(0.02, 0.98))
    row: dict[str, Any] = {}
    for _ in range(REPEATS):
        for name, process in zip(("earlier", "now"), processes(), strict=True):
            assert process.stdin is not None and process.stdout is not None
            process.stdin.write(json.dumps([case // PER_PLAN, at]) + "\n")
            process.stdin.flush()
            took, duration, valid = json.loads(process.stdout.readline())
            row[name] = min(row.get(name, np.inf), took)
            row |= {f"{name}_duration": duration, f"{name}_valid": valid}
    return row


def judge(rows: list[dict[str, Any]]) -> list[Any]:
    """The figures."""
    from tests.figures.figure import Value

    out = []
    times = {name: 1e3 * np.array([row[name] for row in rows]) for name in ("earlier", "now")}
    for what, level in (("median", 0.5), ("p99", 0.99)):
        before, after = (float(np.quantile(times[name], level)) for name in ("earlier", "now"))
        measured = f"{after / before:.3g} ({after:.3g} of {before:.3g} ms)"
        out.append(Value(f"CPU time over that of {EARLIER}, {what}", "≤ 0.3", measured, after <= 0.3 * before))
    longer = np.array([row["now_duration"] / row["earlier_duration"] for row in rows])
    valid = sum(row["now_valid"] for row in rows)
    out.append(Value("stops valid", "all", f"{valid} of {len(rows)}", valid == len(rows)))
    spread = f"{np.median(longer):.4g}, {longer.min():.4g} to {longer.max():.4g}"
    out.append(Value("duration over the earlier one, median and range", "stated", spread, True))
    return out


if __name__ == "__main__":
    if sys.argv[1:] == ["answer"]:
        answer()
    else:
        from tests.figures.figure import main

        main("long_stops", measure, COUNT, judge)
