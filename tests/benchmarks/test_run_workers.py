"""Worker processes that die, hang, or lose their parent; Ctrl-C; and work that kills the first process itself."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from benchmarks.records import RunFolder
from benchmarks.run import pool, run_suite
from tests.benchmarks.test_run_folder import state, toy
from tests.benchmarks.toy import TOY_COMMAND
from tests.oracles import REPOSITORY


def started(out: Path, *options: str, **block: Any) -> subprocess.Popen[str]:
    """`optik bench run` of the toy suite, in a process group of its own, as a shell starts it."""
    suite = out.parent / "suite.toml"
    table = "\n".join(f"{key} = {json.dumps(value)}" for key, value in block.items() if key != "bad")
    bad = ", ".join(f"{key} = {json.dumps(how)}" for key, how in block.get("bad", {}).items())
    suite.write_text(f'[[toy]]\nid = "squares"\n{table}\nbad = {{ {bad} }}\n')
    command = [*TOY_COMMAND, "bench", "run", str(suite), "--out", str(out)]
    return subprocess.Popen(
        [*command, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        cwd=REPOSITORY, env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
    )  # fmt: skip


def until(condition: Any, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def children(process: int) -> list[int]:
    return [int(c) for t in Path(f"/proc/{process}/task").glob("*/children") for c in t.read_text().split()]


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


STILLBORN = """
import os, sys
for i in range({failures} if "--multiprocessing-fork" in sys.orig_argv else 0):
    try:
        os.close(os.open(__file__ + str(i), os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        continue
    os._exit(3)
"""
"""What Python imports when it starts: it ends as many worker processes."""


@pytest.mark.parametrize("failures", [3 - 1, pool.MOST_STARTS])
def test_workers_that_do_not_start_are_started_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failures: int
) -> None:
    (tmp_path / "sitecustomize.py").write_text(STILLBORN.format(failures=failures))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    workers = pool.Processes(1, [])
    try:
        if failures < pool.MOST_STARTS:
            assert workers.run_apart(abs, -3) == 3
        else:
            with pytest.raises(pool.PoolLost, match="could not start: its process ended: exit status 3"):
                workers.run_apart(abs, -3)
    finally:
        workers.close()
    assert len(list(tmp_path.glob("sitecustomize.py?"))) == failures


def test_a_death_and_a_hang_cost_one_retry_and_then_their_rows(tmp_path: Path) -> None:
    suite = toy(count=10, part=1, bad={"5": "dies", "8": "hangs"})
    folder = run_suite(suite, tmp_path / "run", workers=2, part_timeout=1.0)
    rows = folder.rows("toy", "squares")
    assert rows["problem"].to_list() == list(range(10))
    assert rows.filter(pl.col("square").is_infinite())["problem"].to_list() == [5, 8]
    manifest = folder.manifest()
    assert {one["file"]: one["why"] for one in manifest["failed"]} == {
        "rows/toy/squares--005.parquet": "its process ended: SIGSEGV", "rows/toy/squares--008.parquet": "no result within 1 s",
    }  # fmt: skip
    assert manifest["complete"] is True


def test_ctrl_c_ends_workers_at_once_without_a_traceback(tmp_path: Path) -> None:
    out = tmp_path / "run"
    process = started(out, "--workers", "2", count=200, part=4, bad=dict.fromkeys(range(200), "waits"))
    until(lambda: len(state(out)) >= 3)
    workers = children(process.pid)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of them
    begin = time.monotonic()
    words = process.communicate(timeout=20)[1]
    assert time.monotonic() - begin < 5.0
    assert process.returncode == 130
    assert "repeat the command" in words
    assert "Traceback" not in words
    until(lambda: not any(map(alive, workers)), 5.0)
    assert not list(out.rglob("*.part"))
    assert RunFolder(out).manifest()["complete"] is False


@pytest.mark.soak
def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    out = tmp_path / "run"
    process = started(out, "--workers", "2", count=8, part=4, bad={"0": "hangs", "4": "hangs"})
    until(lambda: len(children(process.pid)) >= 3)  # two workers, and what tracks their resources
    time.sleep(1.0)
    workers = children(process.pid)
    process.kill()
    process.communicate()
    until(lambda: not any(map(alive, workers)), 5.0)


@pytest.mark.soak
def test_what_kills_the_first_process_twice_is_done_in_another(tmp_path: Path) -> None:
    out = tmp_path / "run"
    for _ in range(2):
        process = started(out, count=6, part=2, bad={"3": "dies"})
        process.communicate(timeout=60)
        assert process.returncode == -signal.SIGSEGV
        assert len(state(out)) == 1
    process = started(out, count=6, part=2, bad={"3": "dies"})
    words = process.communicate(timeout=60)[1]
    assert process.returncode == 0, words
    assert "failed: squares (rows/toy/squares--001.parquet): its process ended: SIGSEGV" in words
    rows = RunFolder(out).rows("toy", "squares")
    assert rows.filter(pl.col("square").is_infinite())["problem"].to_list() == [3]


@pytest.mark.soak
def test_a_block_that_kills_the_first_process_is_done_apart_and_recorded_and_the_others_are_done(
    tmp_path: Path,
) -> None:
    suite = tmp_path / "suite.toml"
    suite.write_text('[[alone]]\nid = "bad"\nbad = { 3 = "dies" }\n[[alone]]\nid = "good"\n')
    command = [*TOY_COMMAND, "bench", "run", str(suite), "--out", str(tmp_path / "run")]
    done = [
        subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
        for _ in range(3)  # the last one again not in the first process
    ]
    assert [d.returncode for d in done] == [-signal.SIGSEGV, 1, 1]
    assert str(tmp_path / "run") in done[0].stderr
    assert "failed: Squares: bad (rows/alone/bad.parquet): its process ended: SIGSEGV" in done[1].stderr
    folder = RunFolder(tmp_path / "run")
    assert folder.has("rows/alone/good--0000.parquet")
    assert folder.manifest()["complete"] is False
