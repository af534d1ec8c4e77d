"""Long runs, by make soak: 50,000 records killed at 10 moments and stopped at 3, and no row is lost, repeated or changed."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from polars.testing import assert_frame_equal

from benchmarks.records import RunFolder
from benchmarks.run import run_suite
from benchmarks.suite import load_suite
from optik.file_io import LOCK
from tests.benchmarks.test_run_workers import until
from tests.oracles import REPOSITORY

pytestmark = pytest.mark.soak

SUITE = """
seed = 11
[[budgets]]
id = "budgets"
robot = "paper6r"
set = "near_start"
budgets = [1, 3, 10, 30]
options = { count = 6250 }
methods = [{ solver = "dls", label = "dls 0.01", options = { damping = 0.01 } }, { solver = "dls" }]
"""
"""Of iteration budgets 50,000 records in 26 parts."""

KILLS, INTERRUPTS = 10, 3
"""How often it is stopped."""

TABLES = 1 + 26
"""Of problem sets, and of iteration budgets."""


def finished(out: Path) -> dict[str, tuple[int, int]]:
    files = [f for top in ("rows/budgets", "problems") for f in (out / top).glob("*.parquet") if f.name[0] != "."]
    return {f.relative_to(out).as_posix(): (f.stat().st_ino, f.stat().st_mtime_ns) for f in files}


def stopped_at(suite: Path, out: Path, number: int, tables: int, pause: float, workers: int) -> None:
    """Start the command, and send a signal to all of its group some time after its folder has so many tables.

    A table less than none are the imports, of which Ctrl-C shows a traceback.
    """
    command = [sys.executable, "-m", "benchmarks.cli", "bench", "run", str(suite), "--out", str(out)]
    process = subprocess.Popen(
        [*command, "--workers", str(workers)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True, cwd=REPOSITORY, env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
    )  # fmt: skip

    def arrived() -> bool:
        lock = out / LOCK
        works = lock.is_file() and f'"process": {process.pid},' in lock.read_text()
        return process.poll() is not None or (works and len(finished(out)) >= tables)

    if tables >= 0:
        until(arrived, 300.0)
    time.sleep(pause)
    assert process.poll() is None, "it ended before it was stopped"
    if number == signal.SIGKILL:
        process.kill()  # the first process alone: its workers must end by themselves
        process.communicate(timeout=60)  # a worker that was about to start shows that nobody told it what to do
        assert process.returncode == -signal.SIGKILL
        return
    os.killpg(process.pid, number)
    words = process.communicate(timeout=60)[1]
    assert "Traceback" not in words, words
    assert process.returncode == 130


def test_a_run_that_is_killed_and_stopped_equals_one_that_was_not(tmp_path: Path) -> None:
    suite = tmp_path / "suite.toml"
    suite.write_text(SUITE)
    rng = random.Random(5)
    signals = [signal.SIGKILL] * KILLS + [signal.SIGINT] * INTERRUPTS
    rng.shuffle(signals)
    out = tmp_path / "run"
    seen: dict[str, tuple[int, int]] = {}
    for turn, number in enumerate(signals):
        early = number == signal.SIGKILL and turn % 6 == 0
        tables = max(len(seen) + 1, turn * TABLES // (len(signals) + 1))
        stopped_at(suite, out, number, -1 if early else tables, rng.uniform(0.3, 1.5) if early else 0.0, 1 + turn % 2)
        now = finished(out) if out.exists() else {}
        assert seen.items() <= now.items(), "a finished part was lost, or done again"
        print(f"{signal.Signals(number).name}: {len(now)} tables, {len(now) - len(seen)} more")
        seen = now
    folder = run_suite(load_suite(str(suite)), out, workers=2)
    assert seen.items() <= finished(out).items()
    assert len(finished(out)) == TABLES
    assert not list(out.rglob("*.part"))
    assert folder.manifest()["complete"] is True
    whole = run_suite(load_suite(str(suite)), tmp_path / "whole", workers=1)
    compare(whole, folder)


def compare(one: RunFolder, other: RunFolder) -> None:
    """The tables of two runs are the same, times aside."""
    assert finished(one.path).keys() == finished(other.path).keys()
    count = 0
    for name in finished(one.path):
        left, right = one.read(name), other.read(name)
        times = [column for column in left.columns if column == "seconds"]
        assert_frame_equal(left.drop(times), right.drop(times), check_exact=True)
        count += len(left) if not name.startswith("problems/") else 0
    print(f"{count} records are equal")
    assert count == 50_000
