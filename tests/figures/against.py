"""`optik bench run --against`: equal code is never better or worse, and a kernel with 20 % more work is worse.

Each case is a pair of runs by two interpreters with one suite: two methods of ours, whose code is equal, and a plug-in, whose
kernel works 20 % longer in this interpreter. The other one is a script that clears the variable by which the plug-in knows.
"""

from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.figures.figure import ROOT, Row, Value, main

SUITE = """
seed = {case}
[[calls]]
id = "warm"
robot = "paper6r"
set = "near_start"
rounds = 3
options = {{ count = 100 }}
methods = [{{ solver = "lm" }}, {{ solver = "dls" }}, {{ solver = "working.py" }}]
"""
PLUG_IN = """
import os
from optik.compiled import compiled
from optik.ik.dls import DLS

@compiled
def work(steps):
    x = 0.5
    for _ in range(steps):
        x = 3.7 * x * (1.0 - x)
    return x

class Working(DLS):
    def attempt(self, target, start, trace, time_limit):
        assert work(int(20_000 * float(os.environ.get("MORE_WORK", "1")))) > 0.0
        return super().attempt(target, start, trace, time_limit)

METHOD = Working
"""
OTHER = """#!/bin/sh
unset MORE_WORK
PYTHONPATH={root} exec {python} "$@"
"""
PAIRS = 30


def measure(case: int) -> Row:
    """The verdicts of a pair of runs."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "suite.toml").write_text(SUITE.format(case=case))
        (folder / "working.py").write_text(PLUG_IN)
        other = folder / "python"
        other.write_text(OTHER.format(root=ROOT, python=sys.executable))
        other.chmod(other.stat().st_mode | stat.S_IXUSR)
        command = [sys.executable, "-P", "-m", "benchmarks.cli", "bench", "run", str(folder / "suite.toml")]
        command += ["--out", str(folder / "run"), "--against", str(other), "--allow-plugins", "--json"]
        env = os.environ | {"PYTHONPATH": str(ROOT), "MORE_WORK": "1.2"}
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=env)
        found = json.loads(done.stdout)["differences"]
        processes = len(list((folder / "run/processes/calls-warm").iterdir()))
    keys = ("label", "measure", "change", "low", "high", "verdict")
    return {"load": os.getloadavg()[0], "processes": processes, "found": [[one[key] for key in keys] for one in found]}


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    equal = [one for row in rows for one in row["found"] if one[0] != "working"]
    wrong = [one for one in equal if one[-1] in ("better", "worse")]
    plugin = [[one for one in row["found"] if one[0] == "working" and one[1].startswith("time")] for row in rows]
    worse = sum(any(one[-1] == "worse" for one in some) for some in plugin)
    better = sum(any(one[-1] == "better" for one in some) for some in plugin)
    loads, most = [row["load"] for row in rows], max(row["processes"] for row in rows)
    least = -(-28 * len(rows) // 30)
    print(f"  load {min(loads):.1f} to {max(loads):.1f} on {os.cpu_count()} cores; at most {most} processes of each")
    return [
        Value("equal code, better or worse", "0", f"{len(wrong)} of {len(equal)} in {len(rows)} pairs", not wrong),
        Value("20 % more work: worse", f"≥ {least} of {len(rows)}", str(worse), worse >= least),
        Value("20 % more work: better", "0", str(better), not better),
    ]


if __name__ == "__main__":
    main("against", measure, PAIRS, judge, part=1 / 3)
