"""MotionBenchMaker's Panda and UR5: how often a path is found, its CPU time and length; all paths are sampled by coal.

The environment variable ``MBM`` names a folder with the problems, ``panda.tar.bz2`` and ``ur5.tar.bz2``, and the sphere models
of VAMP's published figures, ``NAME_spherized.urdf`` and ``NAME.srdf``, as in github:KavrakiLab/vamp, ``resources``.
"""

from __future__ import annotations

import os
import warnings
from collections import defaultdict
from functools import cache
from itertools import pairwise
from pathlib import Path
from time import process_time

import numpy as np

import optik
from benchmarks.problems.motionbench import MotionProblem, read_problem
from optik import Robot
from optik.scene.contact import find_nearest_pairs
from planners import find_path
from planners.search import JointSpace, SearchStatus
from tests.figures.figure import Row, Value, main
from tests.planners.contacts import COAL_ERROR, Oracle

ARMS = {"panda": "panda_grasptarget", "ur5": "tool0", "panda_hand": ""}
"""Arms and their last links in the sphere models; `panda_hand` has our capsules, and may touch the object that it grasps."""
KINDS = ("bookshelf_small", "bookshelf_tall", "bookshelf_thin", "box", "cage", "table_pick", "table_under_pick")
GRASPING = ("hand", "fingers")
NUMBERS, SAMPLED, BY_COAL, CHECKS = 100, 200, 15, 4000
VAMP = 5.18
"""Mean length of VAMP's simplified paths of the Panda [rad]: its resources/README.md at f6de6a7."""


@cache
def folder() -> Path:
    return Path(os.environ["MBM"])


@cache
def arm(name: str) -> Robot:
    if not ARMS[name]:
        return optik.load(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # masses, which are not used
        model = folder() / f"{name}_spherized.urdf"
        return Robot.from_urdf(model, tip=ARMS[name], shapes=True, srdf=folder() / f"{name}.srdf")


def problem(name: str, kind: str, number: int) -> MotionProblem:
    """The scene, the start and the goal."""
    file = folder() / f"{name.removesuffix('_hand')}.tar.bz2"
    return read_problem(file, kind, number, arm(name), () if ARMS[name] else GRASPING)


def measure(case: int) -> Row:
    name, kind = list(ARMS)[case % len(ARMS)], KINDS[case // len(ARMS) % len(KINDS)]
    robot = arm(name)
    scene, start, goal, _ = problem(name, kind, 1 + case // (len(ARMS) * len(KINDS)))
    row: Row = {"arm": name, "kind": kind, "objects": len(scene.names)}
    if not robot.limits.contains(np.array([start, goal])).all():
        return row | {"status": "outside limits"}
    begin = process_time()
    rough = find_path(robot, start, goal, scene=scene, paths=1, shortcuts=0)
    between = process_time()
    found = find_path(robot, start, goal, scene=scene)
    row |= {"status": str(found.status), "rough": between - begin, "cpu": process_time() - between}
    row |= {"samples": found.samples, "reason": found.reason}
    if not ARMS[name]:
        space, q = JointSpace(robot, scene), np.ascontiguousarray(start)
        begin = process_time()
        for _ in range(CHECKS):
            space.is_free(q)
        row["check"] = (process_time() - begin) / CHECKS
    if found:
        edges = list(pairwise(found.vertices))
        q, few = (np.concatenate([np.linspace(a, b, count) for a, b in edges]) for count in (SAMPLED, BY_COAL))
        near = Oracle(robot, scene).near(few, 0.05, 0.05)
        row |= {"rough_length": rough.length if rough else None, "length": found.length}
        row["least"] = float(find_nearest_pairs(robot, scene, q)[0].min())
        row["coal"] = float(min(near.scene.min(), near.own.min()))
    return row


def judge(rows: list[Row]) -> list[Value]:
    values = []
    for name in ARMS:
        mine = [row for row in rows if row["arm"] == name]
        asked = [row for row in mine if row["status"] in (SearchStatus.FOUND, SearchStatus.NO_PATH_FOUND)]
        found = [row for row in asked if row["status"] == SearchStatus.FOUND]
        print(
            f"  {name}: {len(mine) - len(asked)} of {len(mine)} problems with an end in contact or outside the limits"
        )
        of_kind: dict[str, list[Row]] = defaultdict(list)
        for row in asked:
            of_kind[row["kind"]].append(row)
        for kind, some in of_kind.items():
            cpu, rough = (1e3 * np.array([row[key] for row in some]) for key in ("cpu", "rough"))
            lengths = [row["length"] for row in some if "length" in row]
            solved, length = f"{len(lengths)} of {len(some)}", f"{np.mean(lengths):.2f} rad" if lengths else "-"
            late = f"95 %: {np.quantile(cpu, 0.95):.0f}"
            words = f"one path {np.median(rough):.1f} ms, with shortcuts {np.median(cpu):.1f} ms ({late})"
            print(f"    {kind}: {solved}, {words}, {length}")
        rate, cpu = len(found) / max(len(asked), 1), [row["cpu"] for row in asked]
        rough = [row["rough"] for row in asked]
        wrong = [row for row in found if row["least"] <= 0.0 or row["coal"] < -COAL_ERROR]
        lengths = [row["length"] for row in found]
        values += [
            Value(f"{name}: path found, ends free", "≥ 99 %", f"{100 * rate:.1f} % of {len(asked)}", rate >= 0.99),
            Value(
                f"{name}: CPU time of a path, median",
                "≤ 50 ms",
                f"{1e3 * np.median(rough):.1f} ms",
                np.median(rough) <= 0.05,
            ),
            Value(
                f"{name}: with three searches and shortcuts",
                "≤ 50 ms",
                f"{1e3 * np.median(cpu):.1f} ms",
                np.median(cpu) <= 0.05,
            ),
            Value(f"{name}: paths with a contact at samples", "0", f"{len(wrong)} of {len(found)}", not wrong),
        ]
        if name != "ur5":
            mean, median = np.mean(lengths), np.median(lengths)
            words = f"mean {mean:.2f}, median {median:.2f} rad"
            values.append(Value(f"{name}: length", f"≤ {1.05 * VAMP:.2f} rad", words, max(mean, median) <= 1.05 * VAMP))
        if not ARMS[name]:
            check = np.median([row["check"] for row in asked if "check" in row and row["objects"] >= 20])
            values.append(
                Value(f"{name}, 20 objects: one check", "≤ 12 µs", f"{1e6 * check:.1f} µs", bool(check <= 12e-6))
            )
    return values


if __name__ == "__main__":
    main("search", measure, len(ARMS) * len(KINDS) * NUMBERS, judge)
