"""Methods that end the process they are timed in: recorded as crashed, while the others keep what they have finished."""

from __future__ import annotations

import signal
import subprocess
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import optik
from benchmarks.blocks.block import Entry
from benchmarks.blocks.contest import Contestant, Rounds, timed_part
from benchmarks.peers.ik.base import Solutions
from benchmarks.problems.near_start import near_start
from benchmarks.records import Journal, RunFolder
from benchmarks.report import write_report
from tests.benchmarks.conftest import optik_process
from tests.benchmarks.test_report import page_of

ARM = optik.load("paper6r")
PROBLEMS = near_start(ARM, 5, count=4)


# ---------------------------------------------------------------- the journal


def test_the_next_process_is_told_in_whose_work_the_last_one_died(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    with Journal(folder, "x.journal") as journal:
        with journal.at_work("a longer label"):
            assert Journal(folder, "x.journal").left == "a longer label"
        with journal.at_work("λ\n2"):
            assert Journal(folder, "x.journal").left == "λ\n2"
        assert not Journal(folder, "x.journal").left
    assert not (tmp_path / "x.journal").exists()


def test_what_is_kept_is_read_again_unless_it_is_damaged_and_crashes_outlive_the_block(tmp_path: Path) -> None:
    folder, rows = RunFolder(tmp_path), pl.DataFrame({"ns": [1.0, float("inf")]})
    with Journal(folder, "x.journal") as journal:
        journal.keep("long", rows, 1.0)
        journal.keep("short", rows, 0.1)
        assert journal.kept("short") is None
        kept = Journal(folder, "x.journal").kept("long")
        assert kept.equals(rows)
        (tmp_path / "x.journal" / "long.arrow").write_bytes(b"no table")
        assert journal.kept("long") is None
        journal.blame("a", "its process ended: SIGSEGV")
    assert not (tmp_path / "x.journal").exists()
    assert Journal(folder, "x.journal").crashed == {"a": "its process ended: SIGSEGV"}


# ---------------------------------------------------------------- single calls


def called(label: str, seen: list[str], **more: Any) -> Contestant:
    def call(target: Any, q0: Any) -> Any:
        seen.append(label)
        return q0

    return Contestant(Entry(label, label, {}), {}, call, lambda raw: Solutions(raw[None], None, 1, 2), **more)


def test_a_method_that_has_ended_the_process_is_not_called_and_all_its_problems_count_as_crashed() -> None:
    seen: list[str] = []
    callers = [called("a", seen), called("b", seen, ended="its process ended: exit status 3"), called("c", seen)]
    rows = timed_part(ARM, PROBLEMS, np.arange(4), callers, 2)
    whole = timed_part(ARM, PROBLEMS, np.arange(4), [called(label, []) for label in "abc"], 2)
    assert set(seen) == {"a", "c"}
    assert rows.schema == whole.schema
    assert rows.select("problem", "method", "method_index").equals(whole.select("problem", "method", "method_index"))
    crashed = rows.filter(pl.col("outcome") == "crashed")
    assert crashed["method"].to_list() == ["b"] * 4
    assert not crashed["solved"].any()
    assert crashed["error"].unique().to_list() == ["its process ended: exit status 3"]


def test_a_round_that_is_kept_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.records.WORTH_KEEPING", 0.0)
    folder, seen = RunFolder(tmp_path), []  # type: ignore[var-annotated]
    callers = [called("a", seen), called("b", seen)]
    with pytest.raises(KeyboardInterrupt), Journal(folder) as journal:  # stopped: the block is not finished
        first = timed_part(ARM, PROBLEMS, np.arange(4), callers, 2, kept=Rounds(journal, "0000"))
        raise KeyboardInterrupt
    (tmp_path / "journal" / "0000-01-01.arrow").unlink()
    seen.clear()
    with Journal(folder) as journal:
        again = timed_part(ARM, PROBLEMS, np.arange(4), callers, 2, kept=Rounds(journal, "0000"))
    assert Counter(seen) == {"a": 4, "b": 8}  # four calls that warm each up, and the one round
    mine = pl.col("method") == "a"
    assert again.filter(mine).equals(first.filter(mine))
    assert again.schema == first.schema


# ---------------------------------------------------------------- whole runs, in processes of their own

DEADLY = """
import os
from pathlib import Path
from benchmarks.peers.ik.base import Solutions
from benchmarks.peers.{kind}.base import {base}
from optik.errors import InvalidInput

class Deadly({base}):
    distribution = package = "numpy"
    settings = "ends its process"
    enforced = ()
    calls = 0

    def __init__(self, given):
        pass

    def call(self, *given):
        Deadly.calls += 1
        if Deadly.calls == {nth}:
            {how}
        return given

    def read(self, *given):
        if len(given) == 2:
            raise InvalidInput("motion", "none", "one")
        return Solutions(given[0][1][None])

METHOD = Deadly
"""

COUNTS = """
import time
from pathlib import Path
from benchmarks.peers.ik.base import SolverPeer, Solutions

class Counts(SolverPeer):
    distribution = package = "numpy"
    settings = "counts its calls"

    def __init__(self, robot):
        pass

    def call(self, target, q0):
        with Path(__file__).with_name("calls.txt").open("a") as log:
            log.write("x")
        time.sleep(0.15)
        return q0

    def read(self, raw):
        return Solutions(raw[None])

METHOD = Counts
"""

CALLS = """
[[calls]]
id = "warm"
robot = "paper6r"
set = "near_start"
options = {{ count = 4, spreads = [0.1] }}
rounds = 2
methods = [{{ solver = "lm" }}]
peers = [{{ peer = "{counts}" }}, {{ peer = "{deadly}" }}]
[[calls]]
id = "after"
robot = "paper6r"
set = "near_start"
options = {{ count = 4 }}
methods = [{{ solver = "lm" }}]
"""

LAWS = """
[[timing]]
id = "lines"
lines = [{{ robot = "paper6r", kind = "regular", count = 2 }}]
limits = [{{ velocity = 2.0, acceleration = 10.0, jerk = 100.0 }}]
laws = [{{ law = "quintic" }}]
peers = [{{ peer = "{deadly}" }}]
"""


def run(tmp_path: Path, suite: str) -> subprocess.CompletedProcess[str]:
    (tmp_path / "suite.toml").write_text(suite)
    out = str(tmp_path / "run")
    return optik_process("bench", "run", str(tmp_path / "suite.toml"), "--out", out, "--allow-plugins")


def deadly(tmp_path: Path, how: str, nth: int, kind: str = "ik", base: str = "SolverPeer") -> Path:
    file = tmp_path / "deadly.py"
    file.write_text(DEADLY.format(kind=kind, base=base, how=how, nth=nth))
    return file


@pytest.mark.soak
@pytest.mark.parametrize(
    ("how", "nth", "status", "why", "calls"),
    [
        # in the calls that warm up: all is done once more, twice for the retry
        ("os._exit(3)", 3, 3, "exit status 3", 3 * 4 + 8),
        # in its second round: the two rounds of the slow one before it are kept
        ("os.kill(os.getpid(), 11)", 11, -signal.SIGSEGV, "SIGSEGV", 3 * 4 + 8),
    ],
)  # fmt: skip
def test_a_peer_that_ends_the_process_costs_its_own_rows_alone(
    tmp_path: Path, how: str, nth: int, status: int, why: str, calls: int
) -> None:
    peer, counts = deadly(tmp_path, how, nth), tmp_path / "counts.py"
    counts.write_text(COUNTS)
    suite = CALLS.format(counts=counts, deadly=peer)
    first = run(tmp_path, suite)
    assert first.returncode == status, first.stderr
    second = run(tmp_path, suite)
    assert second.returncode == 0, second.stderr
    assert f"failed: deadly (rows/calls/warm.parquet): its process ended: {why}" in second.stderr
    folder = RunFolder(tmp_path / "run")
    rows = folder.rows("calls", "warm")
    assert rows.group_by("method", "outcome").len().sort("method").rows() == [
        ("counts", "answered", 4), ("deadly", "crashed", 4), ("lm", "answered", 4)
    ]  # fmt: skip
    assert rows.filter(pl.col("method") == "deadly")["error"].unique().to_list() == [f"its process ended: {why}"]
    assert folder.rows("calls", "after") is not None
    assert folder.manifest()["complete"] is True
    assert len((tmp_path / "calls.txt").read_text()) == calls
    third = run(tmp_path, suite)
    assert third.returncode == 0
    assert "deadly" in third.stderr
    assert len((tmp_path / "calls.txt").read_text()) == calls
    assert f"deadly crashed in 4 of 4 calls: its process ended: {why}" in page_of(folder).text


@pytest.mark.soak
def test_a_law_that_ends_the_process_costs_its_own_rows_alone(tmp_path: Path) -> None:
    suite = LAWS.format(deadly=deadly(tmp_path, "os._exit(3)", 3, "laws", "TimingPeer"))
    assert run(tmp_path, suite).returncode == 3
    second = run(tmp_path, suite)
    assert second.returncode == 0, second.stderr
    folder = RunFolder(tmp_path / "run")
    rows = folder.rows("timing", "lines")
    assert rows.select("method", "status").unique().sort("method").rows() == [
        ("deadly", "crashed"), ("quintic", "solved")
    ]  # fmt: skip
    assert rows.filter(pl.col("method") == "deadly")["reason"].to_list() == ["its process ended: exit status 3"] * 2
    assert folder.manifest()["complete"] is True
    assert "deadly" in write_report(folder).read_text(encoding="utf-8")
