"""A Dask cluster does the parts: equal to one process, also where a worker is killed; a wrong address is one line."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

import pytest
from polars.testing import assert_frame_equal

from benchmarks.run import run_suite
from benchmarks.run.cluster import warn_of_plain_text
from benchmarks.suite import load_suite
from optik.errors import InvalidInput
from tests.benchmarks.test_cli import optik_command
from tests.benchmarks.test_run_folder import state, toy
from tests.benchmarks.test_run_workers import until
from tests.oracles import REPOSITORY

distributed = pytest.importorskip("distributed")

ANSWERS = """
seed = 3
[[answers]]
id = "arm"
robot = "paper6r"
set = "near_start"
count = 600000
part = 10000
methods = [{ solver = "lm" }]
"""
"""Enough work for a ratio of times: about a minute by one worker."""


def dask(*command: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "distributed.cli." + command[0], *command[1:]], stderr=subprocess.PIPE, text=True,
        cwd=REPOSITORY, env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
    )  # fmt: skip


@contextmanager
def cluster(workers: int) -> Iterator[tuple[str, list[int]]]:
    """Address of a scheduler on loopback, and the processes of its workers: one thread each, nothing restarts them."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    processes = [dask("dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard", "--no-show")]
    for _ in range(workers):
        processes.append(dask("dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"))
    for process in processes:  # what nobody reads would fill the pipe
        Thread(target=process.stderr.read, daemon=True).start()  # type: ignore[union-attr]
    try:
        with distributed.Client(address, timeout=30, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=60)
        yield address, [process.pid for process in processes[1:]]
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.mark.filterwarnings("ignore")
def test_a_cluster_gives_the_rows_of_one_process_and_a_part_that_raises_its_own(tmp_path: Path) -> None:
    suite = toy(count=60, part=4, bad={"9": "raises"})
    with cluster(1) as (address, _):
        there = run_suite(suite, tmp_path / "there", dask=address)
    here = run_suite(suite, tmp_path / "here")
    one, other = there.parts("toy", "squares"), here.parts("toy", "squares")
    assert one is not None
    assert other is not None
    assert_frame_equal(one, other)
    assert there.manifest()["failed"] == here.manifest()["failed"]


def test_an_address_where_nobody_answers_is_one_line_within_seconds(tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    begin = time.monotonic()
    for wrong in (f"127.0.0.1:{port}", "tls://127.0.0.1:1", "nonsense://x", "host"):
        with pytest.raises(InvalidInput, match=re.escape(wrong)) as caught:
            run_suite(toy(), tmp_path / "run", dask=wrong)
        assert "\n" not in str(caught.value)
    assert time.monotonic() - begin < 20.0
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("address", "warned"),
    [
        ("tcp://127.0.0.1:8786", False), ("localhost:8786", False), ("tcp://[::1]:8786", False), ("10.0.0.2:8786", True),
        ("tcp://cluster:8786", True), ("tls://10.0.0.2:8786", False), ("tcp://127.0.0.1.evil.example:1", True),
    ],
)  # fmt: skip
def test_plain_text_to_another_machine_is_warned_of(address: str, warned: bool) -> None:
    assert bool(warn_of_plain_text(address)) == warned


@pytest.mark.soak
@pytest.mark.filterwarnings("ignore")
def test_a_worker_that_is_killed_in_the_middle_changes_nothing(tmp_path: Path) -> None:
    block = {"count": 200, "part": 2, "bad": {str(i): "waits" for i in range(200)}}
    with cluster(2) as (address, workers):
        thread = Thread(target=run_suite, args=(toy(**block), tmp_path / "there"), kwargs={"dask": address})
        thread.start()
        until(lambda: len(state(tmp_path / "there")) >= 20)
        os.kill(workers[0], signal.SIGKILL)
        thread.join(120)
        assert not thread.is_alive()
    here = run_suite(toy(**block), tmp_path / "here")
    one, other = (run_suite(toy(**block), tmp_path / name).parts("toy", "squares") for name in ("there", "here"))
    assert one is not None
    assert other is not None
    assert_frame_equal(one, other)
    assert here.manifest()["failed"] == []


@pytest.mark.soak
@pytest.mark.filterwarnings("ignore")
def test_two_workers_are_faster_than_one(tmp_path: Path) -> None:
    suite = tmp_path / "suite.toml"
    suite.write_text(ANSWERS)
    seconds = []
    for count in (1, 2):
        with cluster(count) as (address, _):
            warm = tmp_path / "warm.toml"
            warm.write_text(ANSWERS.replace("600000", "40000"))
            run_suite(load_suite(str(warm)), tmp_path / f"warm{count}", dask=address)
            begin = time.perf_counter()
            run_suite(load_suite(str(suite)), tmp_path / f"run{count}", dask=address)
            seconds.append(time.perf_counter() - begin)
    print(f"one worker {seconds[0]:.1f} s, two {seconds[1]:.1f} s: {seconds[0] / seconds[1]:.2f} times")
    assert seconds[0] >= 1.7 * seconds[1]


@pytest.mark.filterwarnings("ignore")
def test_the_command_says_a_wrong_address_in_one_line(tmp_path: Path) -> None:
    done = optik_command("bench", "run", "paper", "--out", str(tmp_path / "run"), "--dask", "10.255.255.1:1")
    assert done.returncode == 2
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("warning: 10.255.255.1:1: plain TCP")
    assert lines[1].startswith("error: --dask")
