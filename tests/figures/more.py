"""More is never less: motions lost or longer with more freedom, their own start, more time or a far obstacle; and the CPU time.

Cases 1 to 300 are random lines, arcs and polylines on seven arms: half of them from a start, half among boxes where the arm has
shapes. Case 0 is the CPU time of the examples of docs/paths.md and docs/seams.md over that of another checkout, in alternating
processes, whose folder the environment variable OLD names; the oracle of the other cases is the plan with less itself.
"""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import numpy as np

from optik import Scene
from planners import Plan, free, plan
from tests.figures.figure import ROOT, Row, Value, main
from tests.planners.test_more_is_never_less import LIMITS, LONGER, draw, far_box, widened

SEED, CASES, RUNS = 20261129, 300, 7
EXAMPLES = """
import time
import numpy as np, optik, planners
from planners import Line, MotionLimits, Polyline, free
robot, limits = optik.load("paper6r"), MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)
q = np.deg2rad([20, -35, 40, 25, 50, -30])
at = lambda *p: optik.se3.pose(robot.fk(q)[:3, :3], robot.fk(q)[:3, 3] + p)
corners = Polyline([at(0, 0, 0), at(-0.1, 0, 0.05), at(-0.1, 0.1, 0.1)], blend=0.005)
cases = [
    (free(corners, tilt=0.2, turn=(-1.5, 1.5)), q), (free(Line(at(0, 0, 0), at(0.4, 0, 0.3)), turn=2.0, tilt=0.6), q),
    (free(corners, tilt=0.2, turn=(-1.5, 1.5)), None), (free(corners, turn=(-1.5, 1.5)), None),
    (free(Line(at(0, 0, 0), at(0.4, 0, 0.3)), turn=2.0, tilt=0.6), None),
]
for path, start in cases:
    planners.plan(robot, path, start, limits=limits)
for path, start in cases:
    begin = time.process_time()
    planners.plan(robot, path, start, limits=limits)
    print(time.process_time() - begin)
"""
HELD = 2
"""Examples, the first ones, that the pages show; the others are the same without a start."""


def boxes(robot: Any, before: Plan, rng: np.random.Generator) -> Scene:
    return Scene(boxes=[far_box(robot, before, rng) for _ in range(2)])


def measure(case: int) -> Row:
    if case == 0:
        return measure_cpu()
    seed = SEED + case
    robot, path, q = draw(seed)
    rng = np.random.default_rng([seed, 1])
    start = q if case % 2 else None
    scene = None
    if case % 4 > 1 and robot.shapes is not None:
        first = plan(robot, path, start, limits=LIMITS, scene=Scene())
        scene = boxes(robot, first, rng) if first else None
    row: Row = {"arm": robot.name, "path": path.name, "held": start is not None, "boxes": scene is not None}
    found = [plan(robot, wider, start, limits=LIMITS, scene=scene) for wider in widened(path, rng)]
    pairs = [(name, a, b) for name, a, b in zip(("turn", "wider", "tilt", "wide tilt"), found, found[1:], strict=False)]
    freed = free(path, turn=1.0)
    without = plan(robot, freed, limits=LIMITS, scene=scene)
    if without:
        given = plan(robot, freed, without.trajectory(0.0), limits=LIMITS, scene=scene)
        pairs.append(("own start", without, given))
        pairs.append(("time", plan(robot, freed, limits=LIMITS, scene=scene, time_limit=0.05), without))
        if scene is not None:
            more = Scene(boxes=[*scene.boxes, far_box(robot, without, rng)])
            pairs.append(("far box", without, plan(robot, freed, limits=LIMITS, scene=more)))
    row["ratios"] = {name: (b.duration / a.duration if b else "lost") for name, a, b in pairs if a}
    return row


def measure_cpu() -> Row:
    if "OLD" not in os.environ:
        return {"cpu": []}
    times: dict[str, list[list[float]]] = {"new": [], "old": []}
    for _ in range(RUNS):
        for which, folder in (("old", os.environ["OLD"]), ("new", str(ROOT))):
            done = subprocess.run(
                [sys.executable, "-c", EXAMPLES], env=os.environ | {"PYTHONPATH": folder}, cwd=folder, check=True,
                capture_output=True, text=True,
            )  # fmt: skip
            times[which].append([float(line) for line in done.stdout.split()])
    new, old = (np.array(times[which][1:]) for which in ("new", "old"))  # the first run compiles
    return {
        "cpu": (np.median(new, axis=0) / np.median(old, axis=0)).tolist(),
        "seconds": np.median(new, axis=0).tolist(),
    }


def judge(rows: list[Row]) -> list[Value]:
    ratios = [(row["case"], name, ratio) for row in rows for name, ratio in row.get("ratios", {}).items()]
    lost = [each for each in ratios if each[2] == "lost"]
    longer = [each for each in ratios if each[2] != "lost" and each[2] > LONGER]
    for each in lost + longer:
        print("  case {}, {}: {}".format(*each))
    most = max((ratio for _, _, ratio in ratios if ratio != "lost"), default=0.0)
    count = f"of {len(ratios)} pairs on {len(rows)} paths"
    values = [
        Value("lost", "0", f"{len(lost)} {count}", not lost),
        Value("longer than 0.2 %", "0", f"{len(longer)} {count}, most {most:.4f}", not longer),
    ]
    for row in (row for row in rows if row.get("cpu")):
        cpu, words = row["cpu"][:HELD], ", ".join(f"{x:.2f}" for x in row["cpu"])
        asked = f"{np.median(cpu):.2f}, most {max(cpu):.2f} (all: {words})"
        good = np.median(cpu) <= 1.3 and max(cpu) <= 2.0
        values.append(Value("CPU of the docs' examples over OLD, median and most", "≤ 1.3, ≤ 2", asked, bool(good)))
    return values


if __name__ == "__main__":
    main("more", measure, CASES + 1, judge, part=0.2)
