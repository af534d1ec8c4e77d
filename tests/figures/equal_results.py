"""Whether motions and the rows of suites are those of an earlier commit: for changes that remove, merge and rename.

Needs `git` and a clone with history. This file runs in both commits, one after the other, with the code of each.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tomllib
from collections import Counter
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import polars as pl

import optik
from optik.errors import OptikError
from planners import MotionLimits, plan, replan
from tests.figures.figure import ROOT, Row, Value, main
from tests.figures.moving import LOADED, limits_of, near, path_on, seam, span


def find(name: str, *modules: str) -> Any:
    """A public name from the first module that has it: what moves between the commits is asked for here, and nowhere else."""
    for module in modules:
        try:
            return getattr(import_module(module), name)
        except (ImportError, AttributeError):
            continue
    raise ImportError(f"{name} is in none of {modules}")


Arc, Polyline = (find(name, "planners", "planners.paths") for name in ("Arc", "Polyline"))
free = find("free", "planners", "planners.paths", "planners.paths.free_path")
make_law = find("make_law", "planners", "planners.timing")
Part, Program, Move, Dwell, ToolChange = (
    find(name, "planners.program", "planners") for name in ("Part", "Program", "Move", "Dwell", "ToolChange")
)
Chunk, stream = (find(name, "planners.streams", "planners.retarget", "planners") for name in ("Chunk", "stream"))
Cell, PanTiltLaser = (find(name, "planners.cell") for name in ("Cell", "PanTiltLaser"))
BASELINE = os.environ.get("BASELINE", "HEAD~1")
"""The commit to compare with."""
ARMS = ("iiwa14", "kr6", "panda", "paper6r", "puma560", "ur5e")
LAWS = ("constant_speed", "optimal", "quintic", "ruckig", "smooth", "toppra")
SUITES = (*sorted(file.stem for file in ROOT.glob("benchmarks/**/*-quick.toml")), "paper")
SENTENCE = ":reason"
"""A column of sentences, whose words may differ."""
PLANS, ALL, PER_CASE = 200, 300, 20
CASES = ALL // PER_CASE


def arc(T: np.ndarray, angle: float) -> Any:
    """An arc through the pose, of 0.1 m."""
    via, goal = T.copy(), T.copy()
    via[:3, 3] += [0.05 * np.sin(angle), 0.05, 0.05]
    goal[:3, 3] += [0.1 * np.sin(angle), 0.0, 0.1]
    return Arc.through(T, via, goal)


def start_of(robot: Any, rng: np.random.Generator) -> np.ndarray:
    low, high = span(robot)
    return np.asarray(low + (high - low) * rng.uniform(0.3, 0.7, robot.n))


def plan_of(case: int, rng: np.random.Generator) -> Row:
    """A plan of a random path by a random law."""
    robot, law = optik.load(ARMS[case % len(ARMS)]), LAWS[case // len(ARMS) % len(LAWS)]
    torque, kind = case % 3 == 0, int(rng.integers(6))
    if torque and robot.name in LOADED:
        robot = robot.with_payload(LOADED[robot.name] * float(rng.uniform(0.2, 1.0)))
    torque = torque and robot.limits.torque is not None and robot.name in LOADED
    q = start_of(robot, rng)
    goals = {3: lambda: near(robot, q, 0.5, rng), 4: lambda: arc(robot.fk(q), float(rng.uniform(-1.0, 1.0)))}
    goals[5] = lambda: robot.fk(near(robot, q, 0.2, rng))
    scene = optik.Scene(
        planes=[((0.0, 0.0, -0.2), (0.0, 0.0, 1.0))], boxes=[(optik.se3.pose(p=[1.0, 0.0, 0.4]), (0.2, 0.6, 0.4))]
    )
    path = goals.get(kind, lambda: path_on(robot, q, kind, rng))()
    found = plan(
        robot, path, q, limits=limits_of(robot, law, torque, rng), timing=make_law(law),
        scene=scene if case % 4 == 0 else None,
    )  # fmt: skip
    return sampled(found, law)


def sampled(found: Any, law: str) -> Row:
    """Status, duration and configurations of a motion."""
    row: Row = {"status": found.status.name, "law": law, "path": found.path.name, "valid": bool(found)}
    if found.has_motion:
        t = np.linspace(0.0, found.trajectory.duration, 100)
        row |= {"duration": found.trajectory.duration, "q": found.trajectory(t).ravel().tolist()}
    return row


def program_of(case: int, rng: np.random.Generator) -> Row:
    """A program with rounded corners, waits, tool speeds and changes of the tool, and every second one replanned."""
    robot = optik.load(ARMS[case % len(ARMS)])
    q, parts, tool = start_of(robot, rng), [], robot.tool
    kinds = rng.integers(6, size=int(rng.integers(2, 8)))
    for kind, after in zip(kinds, [*kinds[1:], 5], strict=True):  # 4 waits and 5 changes the tool: the arm stops there
        blend = float(rng.choice([0.0, 0.005, 0.02])) if after < 4 else 0.0
        vector = Move(rng.normal(0.0, 0.05, 3), str(rng.choice(["tool", "base"])))
        goal = near(robot, q, 0.3, rng) if kind < 2 else vector
        if kind == 5:
            tool = tool @ optik.se3.pose(p=[0.0, 0.0, float(rng.uniform(0.01, 0.05))])
        part = Part(goal, blend=blend, tool_speed=rng.choice([None, 0.05, 0.3]))
        parts.append(Dwell(0.2) if kind == 4 else ToolChange(tool) if kind == 5 else part)
    found = plan(robot, Program(parts), q, limits=MotionLimits(2.0, 10.0, 100.0))
    row = sampled(found, "program")
    if found and case % 2:
        row |= sampled(replan(found, float(rng.uniform(0.1, 0.6)) * found.trajectory.duration), "program, replanned")
    return row


def seam_of(case: int, rng: np.random.Generator) -> Row:
    """A seam with freedoms of the tool."""
    robot = optik.load(ARMS[case % len(ARMS)])
    q, freedoms = start_of(robot, rng), ({"turn": True}, {"tilt": 0.3}, {"turn": 0.5, "tilt": 0.2})[case % 3]
    given = Polyline(seam(robot.fk(q), 8, 0.2, rng), blend=0.002, blend_rotation=0.02)
    return sampled(plan(robot, free(given, **freedoms), q, limits=limits_of(robot, "optimal", False, rng)), "seam")


def stream_of(case: int, rng: np.random.Generator) -> Row:
    """The set-points of a stream of chunks, every second one of poses."""
    robot = optik.load(ARMS[case % len(ARMS)])
    q, size = start_of(robot, rng), rng.uniform(-0.1, 0.1, (2, robot.n))
    t = np.arange(0.0, 3.0, 0.05)[:, None]
    points = q + size[0] * (1.0 - np.cos(2.0 * t)) + size[1] * (1.0 - np.cos(3.0 * t))
    waiting = [Chunk((robot.fk(points) if case % 2 else points)[k : k + 12], 20.0, k / 20) for k in range(0, 48, 4)]

    def policy(now: Any) -> Any:
        return waiting.pop(0) if waiting and waiting[0].observed <= now.t else None

    opened = stream(robot, policy, q, realtime=False, rate=100.0, limits=MotionLimits(2.0, 10.0, 100.0))
    states = [now.q for now in opened]
    joined = opened.report().joined
    return {
        "status": f"joined {joined}",
        "law": "stream",
        "duration": len(states) / 100.0,
        "q": np.ravel(states).tolist(),
    }


def task_of(case: int, rng: np.random.Generator) -> Row:
    """A task of the cell with noise, an error of the unit's pose and corrections; every fourth one by the simulated drive."""
    robot, q = optik.load("paper6r"), np.deg2rad([20.0, -35.0, 40.0, 25.0, 50.0, -30.0])
    laser = PanTiltLaser(optik.se3.pose(p=[-0.6, 0.2, 0.1]), angle_noise=1e-4, range_noise=1e-3)
    unit = laser.with_pose(optik.se3.pose(p=np.array([-0.6, 0.2, 0.1]) + rng.normal(0.0, 2e-3, 3)))
    cell = Cell(robot, laser, "mujoco" if case % 4 == 3 else "ideal", unit=unit, seed=case, q=q)
    spot = robot.fk(q)[:3, 3] + rng.uniform(-0.2, 0.2, 3)
    outcome = cell.move_to_spot(cell.read(spot), corrections=case % 3)
    row: Row = {"status": f"{outcome.status.name} {len(outcome.executions)}", "law": "task", "valid": bool(outcome)}
    if outcome.executions:
        ways = [each.q for each in outcome.executions]
        row |= {"duration": outcome.executions[-1].motion.end, "q": np.ravel(np.concatenate(ways)).tolist()}
    return row


OTHERS = (program_of, seam_of, stream_of, task_of)


def motion(case: int) -> Row:
    """What a commit gives, the same for the same case."""
    other, kind = divmod(case - PLANS, len(OTHERS))
    make, number = (plan_of, case) if case < PLANS else (OTHERS[kind], other)
    try:
        return make(number, np.random.default_rng([20261123, case]))
    except OptikError as error:
        return {"status": type(error).__name__, "law": make.__name__.removesuffix("_of")}


def suite_rows(root: Path, name: str) -> Row:
    """Digest of every column of every table that a suite writes with the code in a folder, and the outcomes of its targets."""
    digests: Row = {}
    module, entry = tomllib.loads((root / "pyproject.toml").read_text())["project"]["scripts"]["optik"].split(":")
    with TemporaryDirectory() as folder:
        for command in (("run", name, "--out", folder, "--workers", "2"), ("report", folder, "--format", "csv")):
            run_in(root, f"import sys; from {module} import {entry}; sys.argv[1:] = {['bench', *command]}; {entry}()")
        tables: dict[str, list[Path]] = {}
        for file in sorted(Path(folder).rglob("*.parquet")):
            tables.setdefault(str(file.relative_to(folder)).partition("--")[0].removesuffix(".parquet"), []).append(
                file
            )
        frames = {
            name: pl.concat(map(pl.read_parquet, files), how="vertical_relaxed") for name, files in tables.items()
        }
        asked = Path(folder) / "tables" / "asked.csv"
        frames |= {"targets": pl.read_csv(asked).select("where", "held")} if asked.exists() else {}
        for table, rows in frames.items():
            for column in rows:
                text = json.dumps(column.to_list(), default=str).encode()
                digests[f"{table}:{column.name}"] = hashlib.sha256(text).hexdigest()[:16]
    return digests


def worker(case: int) -> None:
    """Print the plans of a case by this version."""
    print(json.dumps([motion(k) for k in range(case * PER_CASE, (case + 1) * PER_CASE)]))


def results(root: Path, case: int) -> list[Row] | Row:
    """What the version in a folder gives."""
    if case >= CASES:
        return suite_rows(root, SUITES[case - CASES])
    code = f"import runpy; runpy.run_path({str(Path(__file__).resolve())!r})['worker']({case})"
    out: list[Row] = json.loads(run_in(root, code))
    return out


def run_in(root: Path, code: str) -> str:
    """What a process with the packages of a folder prints."""
    env = os.environ | {"PYTHONPATH": str(root), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], env=env, cwd=root, check=True, stdout=subprocess.PIPE, text=True
    )
    return done.stdout


def baseline_folder() -> Path:
    """Folder with the files of the earlier commit."""
    named = subprocess.run(["git", "rev-parse", BASELINE], cwd=ROOT, check=True, capture_output=True, text=True)
    old = ROOT / ".figures" / f"code-{named.stdout.strip()[:12]}"
    if not old.exists():
        subprocess.run(
            ["git", "worktree", "add", "--detach", str(old), BASELINE], cwd=ROOT, check=True, capture_output=True
        )
    return old


def measure(case: int) -> Row:
    """Results of both versions; of a suite, the earlier one runs twice: what then differs is a time."""
    old = baseline_folder()
    before, now = results(old, case), results(ROOT, case)
    if isinstance(before, list) and isinstance(now, list):
        return {"plans": [compared(*pair) for pair in zip(before, now, strict=True)]}
    assert isinstance(before, dict) and isinstance(now, dict)
    again = results(old, case)
    steady = [key for key in before if before[key] == again[key]]
    return {
        "suite": SUITES[case - CASES],
        "columns": len(steady),
        "times": len(before) - len(steady),
        "unequal": [key for key in steady if now.get(key) != before[key] and not key.endswith(SENTENCE)],
    }


def compared(before: Row, now: Row) -> Row:
    """The kind of a plan, and how far two versions of it differ."""
    same = all(before.get(key) == now.get(key) for key in ("status", "law", "path", "valid"))
    same = same and len(before.get("q", ())) == len(now.get("q", ()))
    row = {key: before.get(key) for key in ("status", "law", "path")} | {"same": same, "duration": 0.0, "q": 0.0}
    if same and "q" in before:
        row["duration"] = abs(before["duration"] - now["duration"]) / before["duration"]
        row["q"] = float(np.abs(np.subtract(before["q"], now["q"])).max())
    return row


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    plans = [each for row in rows for each in row.get("plans", ())]
    kinds = Counter(each["status"] for each in plans)
    other = sum(not each["same"] for each in plans)
    out = [Value(f"plans with another status ({dict(kinds)})", "0", f"{other} of {len(plans)}", not other)]
    for key, most in (("duration", 1e-9), ("q", 1e-8)):
        worst = max(each[key] for each in plans)
        out.append(
            Value(
                f"largest difference of {key}", f"≤ {most:g}, 0 where only names change", f"{worst:.3g}", worst <= most
            )
        )
    for row in rows[CASES:]:
        words = (
            f"{len(row['unequal'])} of {row['columns']} columns, {row['times']} with times {' '.join(row['unequal'])}"
        )
        out.append(Value(f"columns of {row['suite']} that differ", "0", words, not row["unequal"]))
    return out


if __name__ == "__main__":
    main("equal_results", measure, CASES + len(SUITES), judge)
