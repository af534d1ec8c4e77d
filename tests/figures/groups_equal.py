"""Plans of groups equal to the last bit beside busy processes; plans of single arms equal to those before groups, as fast.

Case 0 plans ten groups in a fresh process on the machine as it is, and again beside four processes that only count. The others
plan a line, torques, a program or a seam of an arm in two processes: with the code of the last commit, and with that of the
commit before the one that added groups, both from folders beside each other, because the place of the files alone changes the
time by 3 %. CPU seconds are the least of three of each, taken in turn.
Measured: 10 of 10 groups and 60 of 60 arms equal, CPU 1.001.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import optik
import planners
from optik.errors import OptikError
from planners import MotionLimits, free
from planners.program import Move, Part, Program
from tests.figures.figure import ROOT, Row, Value, main
from tests.figures.moving import LOADED, limits_of, near, path_on, seam, span

SINGLE, TIMES, BUSY = 60, 3, 4
ARMS = ("iiwa14", "kr6", "panda", "paper6r", "puma560", "ur5e")
KINDS = ("line", "torque", "program", "seam")


def plan_single(case: int) -> Any:
    """A plan of one arm."""
    kind, rng = KINDS[case % len(KINDS)], np.random.default_rng([case, 586])
    names = [name for name in ARMS if kind != "torque" or name in LOADED]
    robot = optik.load(names[case // len(KINDS) % len(names)])
    robot = robot.with_payload(0.5 * LOADED[robot.name]) if kind == "torque" else robot
    low, high = span(robot)
    q = low + (high - low) * rng.uniform(0.3, 0.7, robot.n)
    if kind == "program":
        parts = [
            Part(near(robot, q, 0.3, rng)),
            *(Part(Move(rng.normal(0.0, 0.05, 3), "tool"), blend=x) for x in (0.01, 0.0)),
        ]
        return planners.plan(robot, Program(parts), q, limits=MotionLimits(2.0, 10.0, 100.0))
    path = path_on(robot, q, case // 4 % 3, rng) if kind == "torque" else path_on(robot, q, 0, rng)
    if kind == "seam":
        given = planners.Polyline(seam(robot.fk(q), 8, 0.2, rng), blend=0.002, blend_rotation=0.02)
        path = free(given, turn=True)
    return planners.plan(robot, path, q, limits=limits_of(robot, "optimal", kind == "torque", rng))


def plan_groups() -> list[Any]:
    """Ten plans of groups: seams on a table with and without the redundancy, carried bars, and goals around each other."""
    from tests.figures import groups_carry, groups_seams
    from tests.planners.chains import draw_seam

    found = list[Any]()
    for case in range(3):
        group = groups_seams.make_group("ur5e", 2)
        path = draw_seam(np.random.default_rng([case, 587]), 0.75)
        found += [planners.plan(group, one, tool="arm", frame="table") for one in (path, free(path, elbow=True))]
        path = groups_carry.draw(np.random.default_rng([case, 588]))
        found.append(planners.plan(groups_carry.make_group("ur5e"), path, tool=("left", "right")))
    arm = groups_carry.make_group("ur5e").members["left"].with_tool(np.eye(4))
    group = optik.Group(left=arm, right=arm.with_base(optik.se3.pose(np.diag([-1.0, -1.0, 1.0]), [0.8, 0.0, 0.0])))
    q = np.array([np.pi, -1.6, 1.6, -1.9, -1.57, 0.0])
    start, goal = ({name: q + way * 0.6 * np.eye(6)[0] for name in group.members} for way in (1.0, -1.0))
    return [*found, planners.plan(group, goal, start, scene=optik.Scene(), avoid=True)]


def digest(found: Any) -> str:
    """A digest of the polynomials of a motion, or the status of a plan without one."""
    view = getattr(found, "view", found)
    if not view.has_motion:
        return str(found.status)
    motion = view.trajectory
    return hashlib.sha256(motion.padded.tobytes() + motion.knots.tobytes()).hexdigest()


def serve() -> None:
    """Answer each number of a case by the digest of its plan and its CPU seconds; "groups" by the digests of all groups."""
    for line in sys.stdin:
        began = time.process_time()
        try:
            out = (
                [digest(one) for one in plan_groups()] if line.strip() == "groups" else [digest(plan_single(int(line)))]
            )
        except OptikError as error:
            out = [f"{type(error).__name__}: {error}"]
        print(json.dumps([out, time.process_time() - began]), flush=True)


def begin(root: Path) -> subprocess.Popen[str]:
    """A process that serves with the packages of a folder."""
    code = f"import runpy; runpy.run_path({str(Path(__file__).resolve())!r})['serve']()"
    env = os.environ | {"PYTHONPATH": str(root), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-P", "-c", code], env=env, cwd=root, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )


def ask(process: subprocess.Popen[str], words: Any) -> tuple[list[str], float]:
    """The answer of such a process."""
    assert process.stdin is not None and process.stdout is not None
    print(words, file=process.stdin, flush=True)
    answer, seconds = json.loads(process.stdout.readline())
    return answer, seconds


@cache
def both() -> tuple[subprocess.Popen[str], subprocess.Popen[str]]:
    """Processes with the code before groups and with that of the last commit, whose files are put beside the results."""

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True).stdout

    added, out = git("log", "--diff-filter=A", "--format=%H", "--", "optik/arm/group.py").split()[-1], []
    for words, commit in (("before", f"{added}~1"), ("after", "HEAD")):
        copy = ROOT / ".figures" / f"code-{words}-{git('rev-parse', commit)[:12]}"
        if not copy.exists():
            git("worktree", "add", "--detach", str(copy), commit)
            kernels = Path("optik/compiled/_kernels")
            if (ROOT / kernels).exists():
                shutil.copytree(ROOT / kernels, copy / kernels, dirs_exist_ok=True)
        out.append(begin(copy))
    return out[0], out[1]


def measure(case: int) -> Row:
    if case == 0:
        idle = ask(begin(ROOT), "groups")[0]
        busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(BUSY)]
        try:
            beside = ask(begin(ROOT), "groups")[0]
        finally:
            for one in busy:
                one.kill()
        return {
            "groups": sum(len(one) == 64 for one in idle),
            "equal": sum(map(str.__eq__, idle, beside)),
            "of": len(idle),
        }
    processes = both()
    first = [ask(one, case)[0][0] for one in processes]
    seconds = [[ask(processes[k], case)[1] for k in (0, 1)[:: (-1) ** turn]][:: (-1) ** turn] for turn in range(TIMES)]
    least = np.min(seconds, axis=0)
    return {
        "same": first[0] == first[1],
        "what": first[1],
        "ratio": float(least[1] / least[0]),
        "seconds": least.tolist(),
    }


def judge(rows: list[Row]) -> list[Value]:
    single = [row for row in rows if "same" in row]
    same, ratios = sum(row["same"] for row in single), [row["ratio"] for row in single]
    moved = sum(len(row["what"]) == 64 for row in single)
    groups = rows[0]
    words = f"{groups['equal']} of {groups['of']}, {groups['groups']} with a motion"
    return [
        Value("groups: equal beside four busy processes", "all", words, groups["equal"] == groups["of"]),
        Value(
            "arms: equal to before groups",
            "all",
            f"{same} of {len(single)}, {moved} with a motion",
            same == len(single),
        ),
        Value("arms: CPU over before, median", "1.02", f"{np.median(ratios):.4f}", bool(np.median(ratios) <= 1.02)),
    ]


if __name__ == "__main__":
    main("groups_equal", measure, 1 + SINGLE, judge)
