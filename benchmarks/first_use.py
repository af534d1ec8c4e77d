"""First use: what importing and the first solve cost a fresh process, with and without what an earlier one compiled."""

from __future__ import annotations

from tempfile import TemporaryDirectory

from benchmarks.fresh import fresh
from benchmarks.records import RunFolder
from benchmarks.speed_suite import FirstUse

FILE = "speed/first-use.json"

CODE = """
import json, sys, time
begin = time.perf_counter()
import optik
imported = time.perf_counter()
robot = optik.load(sys.argv[1])
q = 0.75 * robot.limits.lower.clip(-3) + 0.25 * robot.limits.upper.clip(max=3)
result = optik.solve_ik(robot, robot.fk(q), robot.limits.clip(q + 0.1), solver=sys.argv[2])
solved = time.perf_counter()
print(json.dumps([imported - begin, solved - imported]))
"""


def run_first_use(task: FirstUse, folder: RunFolder) -> None:
    """Time fresh processes: one with an empty cache, then some that find what it compiled.

    Raises
    ------
    ProcessFailed
        A process ended without figures; its last words are told.
    """
    if folder.has(FILE):
        return
    with TemporaryDirectory() as cache:
        compiling = _process(task, cache)
        warm = [_process(task, cache) for _ in range(task.repeats)]
    folder.write_json(
        FILE,
        {
            "compile_s": [compiling[1]],
            "import_s": [w[0] for w in warm],
            "first_solve_s": [w[1] for w in warm],
        },
    )


def first_use_rows(folder: RunFolder) -> dict[str, list[float]] | None:
    """Seconds of every process by measure; None where it was not run."""
    rows: dict[str, list[float]] | None = folder.read_json(FILE)
    return rows


def _process(task: FirstUse, cache: str) -> list[float]:
    seconds: list[float] = fresh(["-c", CODE, task.robot, task.solver], "first use", NUMBA_CACHE_DIR=cache)
    return seconds
