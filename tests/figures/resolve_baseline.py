"""Lines and polylines without freedoms, and lines with a free turn, against an earlier commit: solved, durations, CPU seconds.

Needs `git` and a clone with history. Both commits plan the same problems, each in a process of its own, one after the other.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from tempfile import gettempdir
from time import process_time
from typing import Any

import numpy as np

import optik
from optik.errors import OptikError
from planners import Line, MotionLimits, Polyline, free, plan
from tests.figures.figure import ROOT, Row, Value, main

BASELINE = os.environ.get("BASELINE", "d3dcf0de")
"""The commit to compare with."""
SEED, BATCHES, LINES, TURNS = 20261130, 10, 50, 10
ARMS = ("gen3lite", "iiwa14", "irb120", "kr6", "panda", "panda_hand", "paper6r", "puma560", "ur10e", "ur5", "ur5e")
LIMITS = MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)


def draw(robot: optik.Robot, rng: np.random.Generator, length: float, waypoints: int) -> tuple[Any, np.ndarray]:
    """Return a line or a polyline of about a length from a random configuration, and that configuration."""
    q = robot.limits.sample(rng, 1)[0] * 0.8 + 0.2 * robot.limits.middle
    poses = [robot.fk(q)]
    for _ in range(waypoints):
        step = rng.normal(size=3)
        T = poses[-1].copy()
        T[:3, 3] += length / waypoints * step / np.linalg.norm(step)
        poses.append(T)
    return (Line(*poses) if waypoints == 1 else Polyline(np.array(poses), blend=2e-3)), q


def solve(robot: optik.Robot, path: Any, q: Any) -> dict[str, Any]:
    begin = process_time()
    try:
        found = plan(robot, path, q, limits=LIMITS)
    except OptikError as error:
        return {"solved": False, "T": 0.0, "cpu": process_time() - begin, "why": str(error)[:100]}
    T = found.trajectory.duration if found else 0.0
    why = "" if found.failure is None else found.failure.reason[:100]
    return {"solved": bool(found), "T": T, "cpu": process_time() - begin, "why": why}


def torch() -> optik.Robot:
    """The paper's arm with a torch at 45°."""
    c = np.sqrt(0.5)
    tool = optik.se3.pose(np.array([[c, 0.0, c], [0.0, 1.0, 0.0], [-c, 0.0, c]]), (0.1, 0.0, 0.1))
    return optik.load("paper6r").with_tool(tool, add=True)


def batch(case: int) -> Row:
    """Plan the problems of a batch with the code that is imported."""
    rng, rows = np.random.default_rng([SEED, case]), []
    for i in range(LINES):
        name = ARMS[i % len(ARMS)]
        robot, held = optik.load(name), i // len(ARMS) % 2 == 0
        path, q = draw(robot, rng, rng.uniform(0.1, 0.4), 1 if i % 3 else 4)
        solve(robot, path, q if held else None)  # warm
        rows.append({"arm": name, "n": robot.n, "held": held, **solve(robot, path, q if held else None)})
    turns, robot = [], torch()
    for _ in range(TURNS):
        path, q = draw(robot, rng, 0.25, 1)
        turns.append(solve(robot, free(path, turn=2.0, coefficients=8), None))
    return {"lines": rows, "turns": turns}


def clone() -> Path:
    folder = Path(gettempdir()) / f"optik-{BASELINE}"
    if not folder.exists():
        subprocess.run(["git", "clone", "-q", str(ROOT), str(folder)], check=True)
        subprocess.run(["git", "-C", str(folder), "checkout", "-q", BASELINE], check=True)
    # it does not have this module
    target = folder / "tests" / "figures"
    target.mkdir(parents=True, exist_ok=True)
    for name in ("figure.py", Path(__file__).name):
        (target / name).write_text((ROOT / "tests" / "figures" / name).read_text(encoding="utf-8"), encoding="utf-8")
    return folder


def measure(case: int) -> Row:
    out: Row = {}
    for label, root in (("old", clone()), ("new", ROOT)):
        code = f"import json; from tests.figures.resolve_baseline import batch; print(json.dumps(batch({case})))"
        env = os.environ | {"PYTHONPATH": str(root)}
        done = subprocess.run(
            [sys.executable, "-P", "-c", code], check=True, capture_output=True, text=True, cwd=root, env=env
        )
        out[label] = json.loads(done.stdout.splitlines()[-1])
    return out


def pairs(rows: list[Row], kind: str) -> list[tuple[Row, Row]]:
    return [pair for row in rows for pair in zip(row["new"][kind], row["old"][kind], strict=True)]


def judge(rows: list[Row]) -> list[Value]:
    lines, values = pairs(rows, "lines"), []
    lost = [new for new, old in lines if old["solved"] and not new["solved"]]
    for new in lost:
        print(f"  lost: {new}")
    more = sum(new["solved"] and not old["solved"] for new, old in lines)
    values.append(
        Value("lines solved before, lost", "0", f"{len(lost)} of {len(lines)} ({more} more solved)", not lost)
    )
    both = [(new, old) for new, old in lines if new["solved"] and old["solved"]]
    T = np.array([new["T"] / old["T"] for new, old in both])
    words = f"median {np.median(T):.4f}, {T.min():.3f} to {T.max():.3f}"
    values.append(
        Value(
            "durations over those before", "median ≤ 1, ≤ 1.12", words, np.median(T) <= 1.0 + 1e-6 and T.max() <= 1.12
        )
    )
    near = [new["cpu"] / old["cpu"] for new, old in both if old["held"] or old["n"] <= 6]
    far = [new["cpu"] / old["cpu"] for new, old in both if not old["held"] and old["n"] > 6]
    for what, ratios, most in (("held or six joints", near, 1.05), ("more joints, free start", far, 2.5)):
        ratio = float(np.median(ratios))
        values.append(Value(f"CPU over that before, {what}", f"≤ {most}", f"{ratio:.3f}", ratio <= most))
    turns = pairs(rows, "turns")
    new, old = (sum(pair[i]["solved"] for pair in turns) for i in (0, 1))
    lost = [pair for pair in turns if pair[1]["solved"] and not pair[0]["solved"]]
    values.append(
        Value(
            "free turns solved, over those before",
            "≥ 1.3, none lost",
            f"{new} / {old}, {len(lost)} lost",
            new >= 1.3 * old and not lost,
        )
    )
    T = np.array([a["T"] / b["T"] for a, b in turns if a["solved"] and b["solved"]])
    words = f"median {np.median(T):.3f}, {T.min():.3f} to {T.max():.4f}"
    values.append(
        Value("their durations", "median ≤ 0.97, never longer", words, np.median(T) <= 0.97 and T.max() <= 1.001)
    )
    cpu = float(np.median([pair[0]["cpu"] for pair in turns if pair[0]["solved"]]))
    values.append(Value("CPU, median [s]", "≤ 0.7", f"{cpu:.2f}", cpu <= 0.7))
    return values


if __name__ == "__main__":
    main("resolve_baseline", measure, BATCHES, judge, part=0.2)
