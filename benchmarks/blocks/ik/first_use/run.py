"""Time fresh processes that import the package and solve one problem."""

from __future__ import annotations

from tempfile import TemporaryDirectory

from benchmarks.blocks._fresh import fresh
from benchmarks.records import RunFolder

FILE = "speed/first-use.json"
"""Seconds of every process by measure."""

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
"""What a fresh process runs: it prints the seconds of importing and of the first solve."""


def run_first_use(robot: str, solver: str, repeats: int, folder: RunFolder) -> None:
    """Time fresh processes: one with an empty cache, then some that find what it compiled."""
    with TemporaryDirectory() as cache:
        compiling = _process(robot, solver, cache)
        warm = [_process(robot, solver, cache) for _ in range(repeats)]
    folder.write_json(
        FILE,
        {
            "compile_s": [compiling[1]],
            "import_s": [w[0] for w in warm],
            "first_solve_s": [w[1] for w in warm],
        },
    )


def _process(robot: str, solver: str, cache: str) -> list[float]:
    """Seconds of importing and of the first solve."""
    seconds: list[float] = fresh(["-c", CODE, robot, solver], "first use", NUMBA_CACHE_DIR=cache)
    return seconds
