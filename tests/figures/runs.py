"""Whether rows of a run are the same however it went: killed, by several workers, beside a deadly method.

The oracle is an undisturbed run by one process. A column that differs between two undisturbed runs is a time, and is named.
"""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import polars as pl

from benchmarks.records import RunFolder
from optik.file_io import LOCK
from tests.benchmarks.test_journal import DEADLY
from tests.benchmarks.test_run_workers import until
from tests.figures.figure import ROOT, Row, Value, main

SUITE = """
seed = 11
[[budgets]]
id = "budgets"
robot = "paper6r"
set = "near_start"
budgets = [1, 3, 10, 30]
options = { count = 6000 }
methods = [{ solver = "dls", label = "dls 0.01", options = { damping = 0.01 } }, { solver = "dls" }]
[[cell]]
id = "spots"
robot = "paper6r"
drive = "ideal"
set = "graph_paper"
count = 12
budgets = [1, 3]
options = { start_deg = [20, -35, 40, 25, 50, -30], offsets_m = [0.0], half_size_m = 0.3, spacing_m = 0.15 }
methods = [{ solver = "dls" }, { solver = "lm" }]
"""
"""Of two kinds, whose parts any worker may do."""

TIMED = """
[[calls]]
id = "calls"
robot = "paper6r"
set = "near_start"
options = { count = 60 }
rounds = 2
methods = [{ solver = "lm" }, { solver = "dls" }]
[[timing]]
id = "lines"
rounds = 1
lines = [{ robot = "paper6r", kind = "regular", count = 8 }]
limits = [{ velocity = 2.0, acceleration = 10.0, jerk = 100.0 }]
laws = [{ law = "quintic" }, { law = "ruckig" }]
"""
"""Of two kinds that one process times alone."""

SOLVER = """
import os
from optik.ik.base import IKSolver

class Deadly(IKSolver):
    def attempt(self, target, start, trace, time_limit):
        os._exit(3)

METHOD = Deadly
"""

EVERYWHERE = """
seed = 11
[[budgets]]
id = "budgets"
robot = "paper6r"
set = "near_start"
budgets = [1, 10]
options = {{ count = 40 }}
methods = [{{ solver = "dls" }}{solver}]
[[calls]]
id = "warm"
robot = "paper6r"
set = "near_start"
options = {{ count = 40 }}
methods = [{{ solver = "lm" }}]
peers = [{{ peer = "plain_casadi", label = "plain" }}{peer}]
[[calls]]
id = "hard"
robot = "paper6r"
set = "hard"
options = {{ count = 40 }}
methods = [{{ solver = "lm" }}]
peers = [{{ peer = "plain_casadi", label = "plain" }}{peer}]
[[timing]]
id = "lines"
lines = [{{ robot = "paper6r", kind = "regular", count = 3 }}]
limits = [{{ velocity = 2.0, acceleration = 10.0, jerk = 100.0 }}]
laws = [{{ law = "quintic" }}]
peers = [{{ peer = "toppra_spline", label = "splines" }}{law}]
"""
"""Of four kinds, each with a place for a method that ends its process."""

KILLS, MOST_TRIES = 10, 20
COUNTS = {"2 workers": 2, "4 workers": 4}
CASES = (
    "killed 10 times, 1 worker", "killed 10 times, 2 workers", *COUNTS, "os._exit in every block",
)  # fmt: skip


def command(suite: str, out: Path, *options: str) -> subprocess.Popen[bytes]:
    """Start a run of a suite."""
    file = out.with_suffix(".toml")
    file.write_text(suite)
    started = [sys.executable, "-P", "-m", "benchmarks.cli", "bench", "run", str(file), "--out", str(out), *options]
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(started, cwd=ROOT, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def finished(suite: str, *options: str) -> Path:
    """The folder of a run that was not disturbed."""
    out = Path(mkdtemp()) / "run"
    status = command(suite, out, *options).wait()
    assert status == 0, status
    return out


def table_files(out: Path) -> list[Path]:
    return [file for top in ("rows", "problems") for file in (out / top).rglob("[!.]*.parquet")]


def differing(one: Path, other: Path) -> list[str]:
    """Columns that differ between two runs, and tables that one of them lacks."""
    left, right = (
        {f.relative_to(out).as_posix(): pl.read_parquet(f) for f in table_files(out)} for out in (one, other)
    )
    found = sorted(left.keys() ^ right.keys())
    for name in left.keys() & right.keys():
        a, b = left[name], right[name]
        found += [f"{name}:{column}" for column in a.columns if column not in b or not a[column].equals(b[column])]
    return found


@cache
def undisturbed(suite: str) -> tuple[Path, frozenset[str]]:
    """A run by one process, and the columns in which a second one differs from it."""
    first, second = finished(suite), finished(suite)
    return first, frozenset(differing(first, second))


def compared(suite: str, out: Path) -> Row:
    """How a run differs from an undisturbed one."""
    whole, times = undisturbed(suite)
    columns = sum(len(pl.read_parquet_schema(file)) for file in table_files(whole))
    rows = sum(len(pl.read_parquet(file)) for file in table_files(whole) if "rows" in file.parts)
    return {
        "complete": RunFolder(out).manifest()["complete"],
        "unequal": sorted(set(differing(whole, out)) - times),
        "columns": columns - len(times),
        "rows": rows,
        "times": sorted({name.rpartition(":")[2] for name in times}),
    }


def killed(workers: int) -> Row:
    """A run that is killed each time that it has a further share of its tables, and resumed."""
    suite = SUITE + TIMED
    total, out, hits = len(table_files(undisturbed(suite)[0])), Path(mkdtemp()) / "run", 0
    for kill in range(KILLS):
        process = command(suite, out, "--workers", str(workers))

        def arrived(pid: int = process.pid, share: float = (kill + 0.5) / KILLS) -> bool:
            lock = out / LOCK
            works = lock.is_file() and f'"process": {pid},' in lock.read_text()
            return works and len(table_files(out)) >= share * total

        until(lambda: process.poll() is not None or arrived(), 300.0)  # noqa: B023
        process.kill()
        hits += process.wait() == -9
    assert command(suite, out, "--workers", str(workers)).wait() == 0
    return {"kills": hits} | compared(suite, out)


def deadly() -> Row:
    """A suite with a method in every block that ends its process, repeated until it is complete; and without the method."""
    folder = Path(mkdtemp())
    (folder / "solver.py").write_text(SOLVER)
    for name, kind, base in (("peer", "ik", "SolverPeer"), ("law", "laws", "TimingPeer")):
        (folder / f"{name}.py").write_text(
            DEADLY.format(kind=kind, base=base, how="os._exit(3)", nth=5 if kind == "ik" else 2)
        )
    places = {name: f', {{ {name} = "{folder / name}.py", label = "deadly" }}' for name in ("solver", "peer")}
    places["law"] = f', {{ peer = "{folder / "law"}.py", label = "deadly" }}'
    out, tries, options = folder / "run", 0, ("--allow-plugins", "--workers", "2")
    status = -1
    while status != 0 and tries < MOST_TRIES:
        tries += 1
        status = command(EVERYWHERE.format(**places), out, *options).wait()
    without = EVERYWHERE.format(**dict.fromkeys(places, ""))
    whole, times = undisturbed(without)
    names = {name.rpartition(":")[2] for name in times}
    unequal, crashed, others = [], {}, 0
    for kind, block in (("budgets", "budgets"), ("calls", "warm"), ("calls", "hard"), ("timing", "lines")):
        pair = [RunFolder(run).rows(kind, block) for run in (whole, out)]
        assert pair[0] is not None and pair[1] is not None
        mine = pl.col("method") == "deadly"
        crashed[block] = (
            pair[1].filter(mine).height,
            pair[1].filter(mine & pl.any_horizontal(pl.col("^status|outcome$") == "crashed")).height,
        )
        keys = [key for key in ("problem", "method", "budget") if key in pair[0].columns]
        kept = [name for name in pair[0].columns if name not in names]
        of_others = [rows.filter(~mine).with_columns(pl.col("method").cast(pl.String)) for rows in pair]
        one, two = (rows.sort(keys).select(kept) for rows in of_others)
        others += one.height
        unequal += [f"{block}:{name}" for name in kept if not one[name].equals(two[name])]
    return {
        "status": status,
        "tries": tries,
        "crashed": crashed,
        "unequal": unequal,
        "rows": others,
        "times": sorted(names),
    }


def measure(case: int) -> Row:
    """A way in which a run may go."""
    name = CASES[case]
    if name.startswith("killed"):
        return killed(case + 1)
    if name in COUNTS:
        return compared(SUITE + TIMED, finished(SUITE + TIMED, "--workers", str(COUNTS[name])))
    return deadly()


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    values = []
    for name, row in zip(CASES, rows, strict=False):
        if "columns" in row:
            words = f"{len(row['unequal'])} of {row['columns']}, {row['rows']} rows; times: {', '.join(row['times'])}"
            if "kills" in row:
                words += f"; {row['kills']} kills"
            fine = not row["unequal"] and row["complete"] and row.get("kills", KILLS) == KILLS
            values.append(Value(f"{name}: columns that differ", "0", words, fine))
        else:
            words = f"{len(row['unequal'])}, {row['rows']} rows, complete at attempt {row['tries']}"
            values.append(Value(f"{name}: columns of other methods that differ", "0", words, not row["unequal"]))
            every = row["status"] == 0 and all(count == ended > 0 for count, ended in row["crashed"].values())
            values.append(Value(f"{name}: its rows, and those that say so", "equal", str(row["crashed"]), every))
    return values


if __name__ == "__main__":
    main("runs", measure, len(CASES), judge)
