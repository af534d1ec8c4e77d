"""Whether motions and the rows of suites are those of an earlier commit: for changes that remove, merge and rename.

Needs `git` and a clone with history. Both commits run here, one after the other, each with its own version of this module.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl

import optik
from optik.errors import OptikError
from planners import Arc, make_law, plan
from planners import Path as ToolPath
from tests.figures.figure import ROOT, Row, Value, main
from tests.figures.moving import LOADED, limits_of, near, path_on, span

BASELINE = os.environ.get("BASELINE", "a2832ad")
"""The commit to compare with."""
ARMS = ("iiwa14", "kr6", "panda", "paper6r", "puma560", "ur5e")
LAWS = ("constant_speed", "optimal", "quintic", "ruckig", "smooth", "toppra")
SUITES = (
    "ik-speed-quick", "timing-quick", "payload-quick", "clearance-quick", "cell-quick", "cycle-quick", "moves-quick",
    "seam-quick", "motionbench-quick", "paper",
)  # fmt: skip
RENAMED = {
    "rows/laws/": "rows/timing/",
    "rows/plans/line.motion:": "rows/timing/line.joints:",
    "rows/plans/": "rows/timing/",
}
"""Beginnings of names in the earlier commit, which have other names now."""
GONE = (
    "rows/plans/line:",
    "rows/plans/line.samples:",
    "rows/timing/line.joints:solver",
    "rows/timing/line.tool:solver",
    "rows/cell/iso",
    "rows/cell/laws",
)
"""Tables and columns that are no longer written, or whose rows are others."""
SENTENCE = ":reason"
"""A column of sentences, whose words may differ."""
KERNELS = "optik/compiled/_kernels"
PLANS, PER_CASE = 200, 20
CASES = PLANS // PER_CASE


def arc(T: np.ndarray, angle: float) -> ToolPath:
    """An arc through the pose, of 0.1 m."""
    via, goal = T.copy(), T.copy()
    via[:3, 3] += [0.05 * np.sin(angle), 0.05, 0.05]
    goal[:3, 3] += [0.1 * np.sin(angle), 0.0, 0.1]
    return Arc.through(T, via, goal)


def motion(case: int) -> Row:
    """Status, duration and configurations of a plan, the same for the same case."""
    rng = np.random.default_rng([20261123, case])
    robot, law = optik.load(ARMS[case % len(ARMS)]), LAWS[case // len(ARMS) % len(LAWS)]
    torque, kind = case % 3 == 0, int(rng.integers(6))
    if torque and robot.name in LOADED:
        robot = robot.with_payload(LOADED[robot.name] * float(rng.uniform(0.2, 1.0)))
    torque = torque and robot.limits.torque is not None and robot.name in LOADED
    low, high = span(robot)
    q = low + (high - low) * rng.uniform(0.3, 0.7, robot.n)
    goals = {3: lambda: near(robot, q, 0.5, rng), 4: lambda: arc(robot.fk(q), float(rng.uniform(-1.0, 1.0)))}
    goals[5] = lambda: robot.fk(near(robot, q, 0.2, rng))
    scene = optik.Scene(
        planes=[((0.0, 0.0, -0.2), (0.0, 0.0, 1.0))], boxes=[(optik.se3.pose(p=[1.0, 0.0, 0.4]), (0.2, 0.6, 0.4))]
    )
    try:
        path = goals.get(kind, lambda: path_on(robot, q, kind, rng))()
        made = plan(
            robot, path, q, limits=limits_of(robot, law, torque, rng), timing=make_law(law),
            scene=scene if case % 4 == 0 else None,
        )  # fmt: skip
    except OptikError as error:
        return {"status": type(error).__name__}
    row: Row = {"status": made.status.name, "law": law, "path": type(made.path).__name__}
    if made.has_motion:
        t = np.linspace(0.0, made.trajectory.duration, 100)
        row |= {"duration": made.trajectory.duration, "q": made.trajectory(t).ravel().tolist(), "valid": bool(made)}
    return row


def suite_rows(root: Path, name: str) -> Row:
    """Digest of every column of every table that a suite writes with the code in a folder, and the outcomes of its targets."""
    digests: Row = {}
    with TemporaryDirectory() as folder:
        for command in (("run", name, "--out", folder, "--workers", "2"), ("report", folder, "--format", "csv")):
            started = [sys.executable, "-P", "-m", "benchmarks.cli", "bench", *command]
            env = os.environ | {"PYTHONPATH": str(root)}
            subprocess.run(started, check=True, capture_output=True, cwd=root, env=env)
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
    code = f"from tests.figures.equal_results import worker; worker({case})"
    env = os.environ | {"PYTHONPATH": str(root), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", code], env=env, cwd=root, check=True, capture_output=True, text=True)
    out: list[Row] = json.loads(done.stdout)
    return out


def baseline_folder() -> Path:
    """Folder with the files of the earlier commit."""
    old = ROOT / ".figures" / f"code-{BASELINE}"
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
    steady = [key for key in before if before[key] == again[key] and not renamed(key).startswith(GONE)]
    return {
        "suite": SUITES[case - CASES],
        "columns": len(steady),
        "times": len(before) - len(steady),
        "unequal": [key for key in steady if now.get(renamed(key)) != before[key] and not key.endswith(SENTENCE)],
    }


def renamed(key: str) -> str:
    """The present name of a column of the earlier commit."""
    begins = next((old for old in RENAMED if key.startswith(old) and not key.startswith(GONE)), "")
    return RENAMED.get(begins, "") + key.removeprefix(begins)


def compared(before: Row, now: Row) -> Row:
    """The kind of a plan, and how far two versions of it differ."""
    same = all(before.get(key) == now.get(key) for key in ("status", "law", "path", "valid"))
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
        words = f"{len(row['unequal'])} of {row['columns']} columns, {row['times']} with times {' '.join(row['unequal'][:5])}"
        out.append(Value(f"columns of {row['suite']} that differ", "0", words, not row["unequal"]))
    return out


if __name__ == "__main__":
    main("equal_results", measure, CASES + len(SUITES), judge)
