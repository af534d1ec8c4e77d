"""Published seams without a start: CppFlow's and TORM's among boxes, and IKLink's with reconfigurations.

The environment variables ``CPPFLOW`` and ``IKLINK`` name checkouts of jstmn/cppflow and uwgraphics/IKLink, ``FETCH`` a folder
with the files of Fetch of KavrakiLab/vamp, resources/fetch. Cases of which a folder is missing are left out.
"""

from __future__ import annotations

import csv
import os
import warnings
from functools import cache
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

import optik
import planners
from optik.errors import InvalidInput
from optik.types import Array
from planners import MotionLimits, Part, Polyline, Program
from tests.figures.figure import Row, Value, main

BLEND = 2e-3
"""Largest distance from a waypoint [m]."""
PATHS = {"panda": "1cube 2cubes flappy_bird 1cube_mini square", "fetch": "circle hello rot_yz rot_yz2 s square"}
PATHS["fetch_arm"] = f"{PATHS['fetch']} hello_mini"
IKLINK = ("iklink, 2 cuts", "iklink, turn", "iklink, shapes")
CASES = (*(f"{arm}__{path}" for arm, paths in PATHS.items() for path in paths.split()), *IKLINK)
OUT_OF_REACH = "panda__square"
TORSO = np.array([-0.086875, 0.0, 0.37743])
"""Fetch's torso_lift_link in its base [m], with the lift at 0."""
HAND = Rotation.from_euler("z", 45, degrees=True).as_matrix()
"""Our flange of the Panda in the frame of its hand, which both sets name."""


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


def read_poses(file: Path, order: tuple[int, ...]) -> Array:
    """Return the poses (k, 4, 4) of a file with time, position and quaternion, whose columns x, y, z, w have this order."""
    rows = np.array(list(csv.reader(file.read_text().splitlines()))[1:], dtype=float)[:, 1:]
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, 3], poses[:, :3, :3] = rows[:, :3], Rotation.from_quat(rows[:, order]).as_matrix()
    return poses


def read_cppflow(name: str) -> tuple[optik.Robot, Array, optik.Scene]:
    """Return arm, poses of its tool, and boxes of a problem."""
    folder = Path(os.environ["CPPFLOW"]) / "cppflow"
    given = yaml.safe_load((folder / "problems" / f"{name}.yaml").read_text())
    poses, boxes = read_poses(folder / "paths" / f"{given['path_name']}.csv", (4, 5, 6, 3)), []
    base = TORSO if given["robot"] == "fetch_arm" else np.zeros(3)
    poses[:, :3, :3] = poses[:, :3, :3] @ np.array(given["path_R_offset"], dtype=float)
    poses[:, :3, 3] += np.array(given["path_xyz_offset"]) - base
    if given["path_offset_frame"] == "torso_lift_link":
        poses[:, :3, 3] += TORSO
    if given["robot"] == "panda":
        poses[:, :3, :3] = poses[:, :3, :3] @ HAND
    for listed in given.get("obstacles", ()):
        box: dict[str, float] = {key: value for entry in listed for key, value in entry.items()}
        T = np.eye(4)
        T[:3, 3] = np.array([box[key] for key in "xyz"]) + given["obstacle_xyz_offset"] - base
        boxes.append((T, tuple(box[f"size_{key}"] for key in "xyz")))
    return arm(given["robot"]), poses, optik.Scene(boxes=boxes)


@cache
def warm(robot: optik.Robot) -> None:
    """Compile what the first problem of an arm needs."""
    ends = robot.fk(robot.limits.middle + np.array([[0.1], [0.12]]))
    for path in (Polyline(ends), Program([Part(Polyline(ends)), Part(Polyline(ends[::-1]))])):
        planners.plan(robot, path, limits=limits_of(robot), scene=None if robot.shapes is None else optik.Scene())


def ask(case: str) -> tuple[Any, ...]:
    """Return arm, path or program, scene and the most reconfigurations of a case."""
    if not case.startswith("iklink"):
        robot, poses, scene = read_cppflow(case)
        try:
            return robot, Polyline(poses, blend=BLEND), scene, 0
        except InvalidInput:
            return robot, Program.of(poses, blend=BLEND), scene, 0
    (file,) = (Path(os.environ["IKLINK"]) / "input_trajectories").glob("panda_*.csv")
    poses = read_poses(file, (3, 4, 5, 6))
    poses[:, :3, :3] = poses[:, :3, :3] @ HAND
    path, plain = Polyline(poses, blend=BLEND), arm("panda").with_shapes(None)
    if case.endswith("shapes"):
        return arm("panda"), path, optik.Scene(), 0
    return (plain, path, None, 2) if case.endswith("cuts") else (plain, planners.free(path, turn=np.pi), None, 0)


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
