"""Narrow terminals, plain ones, and a run that is stopped by a signal: nothing is lost and nothing breaks."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from polars.testing import assert_frame_equal

from benchmarks.cli.command import err_console, out_console
from benchmarks.records import RunFolder
from benchmarks.run import run_suite
from tests.benchmarks.conftest import SMALL, small
from tests.oracles import REPOSITORY

START = "20,-35,40,25,50,-30"


def python(*arguments: str, **variables: str) -> subprocess.CompletedProcess[bytes]:
    kept = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "TERM", "LANG", "LC_ALL", "FORCE_COLOR")}
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, timeout=300, cwd=REPOSITORY,
        env=kept | {"PYTHONPATH": str(REPOSITORY)} | variables,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("command", "wanted"),
    [
        (["ik", "--xyz", "0.1,0.3,0.2", "--rpy-deg", "-90,10,20", "--start-deg", START], "joint6"),
        (["plan", "line", "--timing", "ruckig"], "valid"),
        (["bench", "list"], "ik"),
    ],
    ids=lambda x: " ".join(x[:2]),
)
def test_forty_columns_are_kept_to(
    typed: Any, monkeypatch: pytest.MonkeyPatch, command: list[str], wanted: str
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    for console in (out_console, err_console):
        monkeypatch.setattr(console, "_width", None)  # kept from where the first command of this process was imported
    status, text, said = typed(*command)
    assert status == 0, said
    assert max(map(len, text.splitlines())) <= 40
    assert wanted in text


def test_a_plain_terminal_is_written_plainly() -> None:
    done = python("-m", "benchmarks.cli", "bench", "list", COLUMNS="40", TERM="dumb", LC_ALL="C")
    assert done.returncode == 0, done.stderr
    text = done.stdout.decode("utf-8")
    assert max(map(len, text.splitlines())) <= 40
    assert "ik" in text and "\x1b" not in text


LIVE = """
from benchmarks.cli.command import err_console, out_console
from benchmarks.cli.runs import make_progress
with err_console.status("writing the report"):
    pass
out_console.print("colours", style="yellow")
with make_progress() as progress:
    progress.refresh()
"""
"""Shows what changes in place on the error stream."""


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
@pytest.mark.parametrize(("terminal", "notebook"), [(False, False), (True, True), (True, False)])
def test_displays_are_live_on_terminals_alone_whatever_the_colours(terminal: bool, notebook: bool) -> None:
    kept = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "JPY_PARENT_PID")}
    asked = {"PYTHONPATH": str(REPOSITORY), "FORCE_COLOR": "1", "TERM": "xterm-color"}
    asked |= {"JPY_PARENT_PID": "1"} if notebook else {}
    ends = os.openpty() if terminal else os.pipe()
    with os.fdopen(ends[0], "rb", buffering=0) as errors:
        done = subprocess.run(
            [sys.executable, "-c", LIVE],
            stdout=subprocess.PIPE,
            stderr=ends[1],
            check=True,
            env=kept | asked,
            timeout=300,
        )
        assert done.stdout == b"\x1b[33mcolours\x1b[0m\n"
        os.write(ends[1], b"|")
        said = b""
        while not said.endswith(b"|"):
            said += errors.read(1 << 16)
        os.close(ends[1])
    assert (said != b"|") is (terminal and not notebook), said


SEVERAL = """
import json, sys
from benchmarks.cli.app import main
for arguments in json.loads(sys.argv[1]):
    sys.argv = ["optik", *arguments]
    try:
        main()
    except SystemExit as ended:
        print(ended.code)
"""
"""Types several commands in one process."""


def test_tables_and_errors_are_written_where_nothing_but_ascii_can_be() -> None:
    commands = [["robots"], ["fk", "0,0,0,0,0,0"]]
    done = python("-c", SEVERAL, json.dumps(commands), PYTHONIOENCODING="ascii", TERM="dumb")
    assert (done.returncode, done.stderr) == (0, b"")
    assert "paper6r" in done.stdout.decode("ascii") and "--xyz" in done.stdout.decode("ascii")
    done = python("-m", "benchmarks.cli", "fk", "1,2", LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0", TERM="dumb")
    assert done.returncode == 2
    assert b"Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


# ---------------------------------------------------------------- stopped by a signal

INTERRUPTED = """
import json, os, sys
from pathlib import Path
from benchmarks import suite
from benchmarks.cli.runs import RunCommand
from tests.benchmarks.conftest import SMALL

out, number, after = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
wanted = suite.suite_of("small", json.loads(sys.argv[4]))
suite.load_suite = lambda name, allow_plugins=False: wanted
replace, count = Path.replace, 0

def counted(self, target):
    global count
    count += Path(target).parent == out / "rows/budgets"
    if count == after:  # the part is written, and not yet in its place
        os.kill(os.getpid(), number)
    return replace(self, target)

Path.replace = counted
import typer
try:
    RunCommand(suite="small", out=out).run_with_progress()
except typer.Exit as stopped:
    sys.exit(stopped.exit_code)
"""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)])
def test_a_run_that_is_stopped_goes_on_to_the_same_rows(
    small_run: RunFolder, tmp_path: Path, number: int, status: int
) -> None:
    settings = SMALL | {"timing": [SMALL["timing"][0] | {"laws": [{"law": "ruckig"}]}]}
    done = python("-c", INTERRUPTED, str(tmp_path / "run"), str(int(number)), "3", json.dumps(settings))
    assert done.returncode == status, done.stderr.decode()
    if status == 130:
        assert b"repeat the command" in done.stderr
        assert b"Traceback" not in done.stderr
    stopped = RunFolder(tmp_path / "run")
    assert stopped.manifest()["complete"] is False
    finished = {p: p.stat().st_mtime_ns for p in (tmp_path / "run" / "rows/budgets").glob("*.parquet")}
    assert 0 < len(finished) < 4
    again = run_suite(small(timing=settings["timing"]), tmp_path / "run")
    assert again.manifest()["complete"] is True
    assert {p: p.stat().st_mtime_ns for p in finished} == finished, "what was done is not done again"
    for block in ("workspace", "misprint"):
        one, other = small_run.rows("budgets", block), again.rows("budgets", block)
        assert_frame_equal(one, other, check_exact=True)
