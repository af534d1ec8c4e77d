"""A Dask cluster does the parts: equal to one process, also where a worker is killed; a wrong address is one line."""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any

import distributed
import pytest
from polars.testing import assert_frame_equal

from benchmarks.run import run_suite
from benchmarks.run.pool import warn_of_plain_text
from optik.errors import InvalidInput
from tests.benchmarks.test_run_folder import state, toy
from tests.benchmarks.test_run_workers import until
from tests.oracles import REPOSITORY


def dask(*command: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "distributed.cli." + command[0], *command[1:]], stderr=subprocess.DEVNULL,
        cwd=REPOSITORY, env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
    )  # fmt: skip


@contextmanager
def cluster(workers: int, protocol: str = "tcp") -> Iterator[tuple[str, list[int]]]:
    """Address of a scheduler on loopback, and the processes of its workers: one thread each, nothing restarts them."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    address = f"{protocol}://127.0.0.1:{port}"
    same = ("--protocol", protocol, "--no-dashboard")
    processes = [dask("dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-show", *same)]
    for _ in range(workers):
        processes.append(dask("dask_worker", address, "--nthreads", "1", "--no-nanny", *same))
    try:
        security = distributed.Security() if protocol == "tls" else None
        with distributed.Client(address, timeout=60, set_as_default=False, security=security) as client:
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
    one, other = there.rows("toy", "squares"), here.rows("toy", "squares")
    assert_frame_equal(one, other)
    assert there.manifest()["failed"] == here.manifest()["failed"]


def test_an_address_where_nobody_answers_is_one_line_within_seconds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    monkeypatch.setattr("benchmarks.run.pool.CONNECT_SECONDS", 1.0)
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
    one, other = (run_suite(toy(**block), tmp_path / name).rows("toy", "squares") for name in ("there", "here"))
    assert_frame_equal(one, other)
    assert here.manifest()["failed"] == []


@pytest.mark.soak
@pytest.mark.filterwarnings("ignore")
@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl for a certificate")
def test_tls_takes_the_certificates_of_dasks_configuration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import dask as configured

    key, cert = str(tmp_path / "key.pem"), str(tmp_path / "cert.pem")
    made = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", key, "-out", cert, "-days", "2"]
    subprocess.run([*made, "-subj", "/CN=localhost"], check=True, capture_output=True)
    files = {"ca_file": cert}
    files |= {
        f"{who}__{what}": file
        for who in ("scheduler", "worker", "client")
        for what, file in (("cert", cert), ("key", key))
    }
    for name, file in files.items():
        monkeypatch.setenv(f"DASK_DISTRIBUTED__COMM__TLS__{name.upper()}", file)
    ours = {f"distributed.comm.tls.{name.replace('__', '.').replace('_', '-')}": file for name, file in files.items()}
    with configured.config.set(ours), cluster(1, "tls") as (address, _):
        folder = run_suite(toy(count=60, part=4), tmp_path / "run", dask=address)
        assert folder.manifest()["complete"] is True
        with pytest.raises(InvalidInput, match="--dask"):
            run_suite(toy(), tmp_path / "other", dask=address.replace("tls", "tcp"))


@pytest.mark.soak
@pytest.mark.filterwarnings("ignore")
def test_two_workers_are_faster_than_one(tmp_path: Path) -> None:
    """The problems wait in place of computing, so that other work on this machine does not count."""
    suite = toy(count=600, part=5, bad={str(i): "waits" for i in range(600)})
    seconds = []
    for count in (1, 2):
        with cluster(count) as (address, _):
            run_suite(toy(count=20, part=1), tmp_path / f"warm{count}", dask=address)
            begin = time.perf_counter()
            run_suite(suite, tmp_path / f"run{count}", dask=address)
            seconds.append(time.perf_counter() - begin)
    print(f"one worker {seconds[0]:.1f} s, two {seconds[1]:.1f} s: {seconds[0] / seconds[1]:.2f} times")
    assert seconds[0] >= 1.7 * seconds[1]


@pytest.mark.filterwarnings("ignore")
def test_the_command_says_a_wrong_address_in_one_line(
    tmp_path: Path, typed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.run.pool.CONNECT_SECONDS", 1.0)
    status, _, said = typed("bench", "run", "paper", "--out", str(tmp_path / "run"), "--dask", "10.255.255.1:1")
    assert status == 2
    lines = said.strip().splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("warning: 10.255.255.1:1: plain TCP")
    assert lines[1].startswith("error: --dask")
