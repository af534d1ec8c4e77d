"""Motion files with huge coefficients: refused, or judged in half a second and with little memory.

Motions along lines and joint lines are written with their coefficients times 1e2 to 1e300, with limits on the joints alone, or
also on torques and the tool's speed. Each is read and certified in a process that has certified the unchanged motion before.
"""

from __future__ import annotations

import json
import resource
import tempfile
from pathlib import Path
from time import process_time

import numpy as np

import optik
from optik.errors import OptikError
from planners import JointLine, Line, MotionLimits, load_motion, plan
from tests import oracles
from tests.figures.figure import Row, Value, main

FACTORS = (1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e12, 1e20, 1e100, 1e300)
KINDS = ("line", "joints", "line, torque", "joints, torque")
COUNT = 2 * len(KINDS) * len(FACTORS)


def measure(case: int) -> Row:
    """One file."""
    kind, factor = KINDS[case % len(KINDS)], FACTORS[case // len(KINDS) % len(FACTORS)]
    robot, rng = optik.load("ur5e"), np.random.default_rng([37, case // (len(KINDS) * len(FACTORS))])
    q = np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 0.0]) + rng.uniform(-0.2, 0.2, 6)
    tool = robot.fk(q)
    limits = MotionLimits(2.0, 5.0, 50.0)
    if "torque" in kind:
        limits = MotionLimits(2.0, 5.0, 50.0, tool_speed=0.5, torque=[150.0, 150.0, 150.0, 28.0, 28.0, 28.0])
    path = JointLine(robot, q, q + 0.3) if "joints" in kind else Line(tool, oracles.moved(tool, [0.0, 0.05, -0.1]))
    made = plan(robot, path, q, limits=limits)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "motion.json"
        made.save(file)
        load_motion(file).certify()
        data = json.loads(file.read_text())
        del data["sha256"]
        with np.errstate(over="ignore"):
            scaled = factor * np.array(data["coefficients"])
        data["coefficients"] = np.clip(scaled, -1e308, 1e308).tolist()
        file.write_text(json.dumps(data))
        before, begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, process_time()
        try:
            proof = load_motion(file).certify()
            answer = "valid" if proof.is_valid else "invalid"
        except OptikError as error:
            answer = f"refused: {error}"
        took = process_time() - begin
    return {
        "kind": kind, "factor": factor, "answer": answer[:120], "seconds": took,
        "megabytes": (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0,
    }  # fmt: skip


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    valid = [row for row in rows if row["answer"] == "valid"]
    seconds, memory = (max(row[key] for row in rows) for key in ("seconds", "megabytes"))
    refused = sum(row["answer"].startswith("refused") for row in rows)
    return [
        Value("refused or judged invalid", "all", f"{refused} refused, {len(valid)} valid of {len(rows)}", not valid),
        Value("longest CPU time of a file", "≤ 0.5 s", f"{seconds:.2f} s", seconds <= 0.5),
        Value("memory above the process before", "≤ 100 MB", f"{memory:.0f} MB", memory <= 100.0),
    ]


if __name__ == "__main__":
    main("hostile_numbers", measure, COUNT, judge)
