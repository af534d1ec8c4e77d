"""Published seams without a start: CppFlow's and TORM's among boxes, and IKLink's with reconfigurations.

The environment variables ``CPPFLOW`` and ``IKLINK`` name checkouts of jstmn/cppflow and uwgraphics/IKLink, ``FETCH`` a folder
with the files of Fetch of KavrakiLab/vamp, resources/fetch. Cases of which a folder is missing are left out.
"""

from __future__ import annotations

import os
import warnings
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

import optik
import planners
from benchmarks.problems.seam_files import read_seam
from planners import MotionLimits, Part, Polyline, Program
from tests.figures.figure import Row, Value, main

PATHS = {"panda": "1cube 2cubes flappy_bird 1cube_mini square", "fetch": "circle hello rot_yz rot_yz2 s square"}
PATHS["fetch_arm"] = f"{PATHS['fetch']} hello_mini"
IKLINK = ("iklink, 2 cuts", "iklink, turn", "iklink, shapes")
CASES = (*(f"{arm}__{path}" for arm, paths in PATHS.items() for path in paths.split()), *IKLINK)
OUT_OF_REACH = "panda__square"


@cache
def arm(name: str) -> optik.Robot:
    if name == "panda":
        return optik.load(name)
    folder, base = Path(os.environ["FETCH"]), "&base=torso_lift_link" if name == "fetch_arm" else ""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # masses, which are not used
        file = folder / "fetch_spherized.urdf"
        return optik.load(f"{file}#tip=gripper_link&shapes=yes&srdf={folder / 'fetch.srdf'}{base}")


def limits_of(robot: optik.Robot) -> MotionLimits:
    panda = robot.name == "panda"
    return MotionLimits(2.0, 10.0, 100.0) if panda else MotionLimits(robot.limits.velocity, 5.0, 50.0)


@cache
def warm(robot: optik.Robot) -> None:
    """Compile what the first problem of an arm needs."""
    ends = robot.fk(robot.limits.middle + np.array([[0.1], [0.12]]))
    for path in (Polyline(ends), Program([Part(Polyline(ends)), Part(Polyline(ends[::-1]))])):
        planners.plan(robot, path, limits=limits_of(robot), scene=None if robot.shapes is None else optik.Scene())


def ask(case: str) -> tuple[optik.Robot, Any, optik.Scene | None, int]:
    """Return arm, path or program, scene and the most reconfigurations of a case."""
    if not case.startswith("iklink"):
        seam = read_seam(Path(os.environ["CPPFLOW"]) / "cppflow" / "problems" / f"{case}.yaml")
        return arm(seam.robot), seam.path, seam.scene, 0
    (file,) = (Path(os.environ["IKLINK"]) / "input_trajectories").glob("panda_*.csv")
    seam, plain = read_seam(file), arm("panda").with_shapes(None)
    if case.endswith("shapes"):
        return arm("panda"), seam.path, seam.scene, 0
    if case.endswith("cuts"):
        return plain, seam.path, None, 2
    assert isinstance(seam.path, Polyline)
    return plain, planners.free(seam.path, turn=np.pi), None, 0


def measure(case: int) -> Row:
    name = CASES[case]
    needed = ("IKLINK",) if name.startswith("iklink") else ("CPPFLOW", "FETCH")[: 1 + name.startswith("fetch")]
    if any(folder not in os.environ for folder in needed):
        return {"name": name, "left_out": True}
    robot, path, scene, cuts = ask(name)
    warm(robot)
    begin = process_time()
    found = planners.plan(robot, path, limits=limits_of(robot), scene=scene, reconfigurations=cuts)
    row: Row = {"name": name, "cpu": process_time() - begin, "certified": bool(found), "status": str(found.status)}
    if found:
        row["T"] = found.trajectory.duration
    else:
        assert found.failure is not None
        row |= {"s": found.failure.s, "why": found.failure.reason}
    return row if found.resolution is None else row | found.resolution._asdict()


def judge(rows: list[Row]) -> list[Value]:
    rows = [row for row in rows if not row.get("left_out")]
    for row in rows:
        how = f"T {row['T']:.3f} s" if row["certified"] else f"{row['status']} at s = {row['s']:.4g}: {row['why']}"
        print(f"  {row['name']}: {row['cpu']:.2f} s, {row.get('layers', 0)} layers, {how}")
    values, seconds = [], []
    for row in rows:
        name, cuts = row["name"], len(row.get("cuts", ()))
        if name in (OUT_OF_REACH, "iklink, shapes"):
            words = ("s = ", "joint5", "joint7") if name.startswith("iklink") else ("s = ",)
            named = not row["certified"] and all(word in row["why"] for word in words)
            values.append(Value(name, f"refused, with {', '.join(words)}", row["status"], named))
        elif name.startswith("iklink"):
            most = 2 if name.endswith("cuts") else 0
            reached = row["certified"] and cuts <= most
            values.append(Value(name, f"certified, ≤ {most} cuts", f"{row['status']}, {cuts}", reached))
        else:
            seconds.append(row["cpu"] if row["certified"] else np.inf)
    if seconds:
        certified, median, most = int(np.isfinite(seconds).sum()), float(np.median(seconds)), max(seconds)
        words = f"{certified} of {len(seconds)}"
        values.append(Value("CppFlow and TORM, certified", "all in reach", words, certified == len(seconds)))
        values.append(Value("CPU of one, median [s]", "≤ 1.2", f"{median:.2f}", median <= 1.2))
        values.append(Value("CPU of one, most [s]", "≤ 6", f"{most:.2f}", most <= 6.0))
    return values


if __name__ == "__main__":
    main("resolve_public", measure, len(CASES), judge)
