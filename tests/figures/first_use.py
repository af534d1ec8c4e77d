"""What a first use costs: with the kernels of `make kernels` and nothing cached, and as a fresh clone that compiles.

Needs `make wheel`. Run it alone on the machine; the minimum over the cases counts for the README's example and
the imports. Everything else is measured in case 0 only.
"""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
import time
from tempfile import TemporaryDirectory

from tests.figures.figure import ROOT, Row, Value, main

COUNT = 5
IMPORTS = """
import time
a = time.process_time()
import optik
b = time.process_time()
import planners
print(b - a, time.process_time() - b)
"""


def cost(*arguments: str, **environment: str) -> tuple[float, float, str]:
    """CPU and wall time [s] of a Python process and its children with nothing cached, and what it prints."""
    with TemporaryDirectory() as empty:
        env = os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": empty} | environment
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        done = subprocess.run(
            [sys.executable, "-P", *arguments], env=env, cwd=empty, capture_output=True, text=True, check=True
        )
        after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic() - begin
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall, done.stdout


def measure(case: int) -> Row:
    """One process of each."""
    (lines,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.S)
    alone = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    row: Row = {"lines": cost("-c", lines, OPTIK_COMPILES="error", **alone)[0]}
    cost("-c", IMPORTS)
    row["optik"], row["planners"] = map(float, cost("-c", IMPORTS, **alone)[2].split())
    if case == 0:
        row["demo"] = cost("-m", "benchmarks.cli", "demo", "--out", "demo", OPTIK_COMPILES="error")[1]
        row["clone"] = cost("-c", lines, OPTIK_COMPILES="native", **alone)[0]
        row["ahead"] = cost("-m", "benchmarks.cli", "kernels", "--compile", "--native", "--jobs", "2", **alone)[:2]
        row["wheel"] = max(file.stat().st_size for file in (ROOT / "dist").glob("*.whl"))
    return row


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    lines, optik, planners = (min(row[name] for row in rows) for name in ("lines", "optik", "planners"))
    first = rows[0]
    cpu, wall = first["ahead"]
    part = 100.0 * wall / cpu
    return [
        Value(
            "README example, shipped kernels, nothing cached or compiled, CPU [s]",
            "≤ 2.0",
            f"{lines:.2f}",
            lines <= 2.0,
        ),
        Value("demo, shipped kernels, nothing compiled [s]", "≤ 20", f"{first['demo']:.1f}", first["demo"] <= 20.0),
        Value("README example, all compiled, CPU [s]", "≤ 38", f"{first['clone']:.1f}", first["clone"] <= 38.0),
        Value(
            "compiled in advance by two processes, wall over CPU [%]",
            "≤ 60",
            f"{part:.0f} of {cpu:.0f} s",
            part <= 60.0,
        ),
        Value("import optik, CPU [s]", "≤ 0.30", f"{optik:.2f}", optik <= 0.30),
        Value("import planners after it, CPU [s]", "≤ 0.25", f"{planners:.2f}", planners <= 0.25),
        Value("wheel [MB]", "≤ 12", f"{first['wheel'] / 1e6:.1f}", first["wheel"] <= 12e6),
    ]


if __name__ == "__main__":
    main("first_use", measure, COUNT, judge)
