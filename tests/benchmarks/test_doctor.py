"""`optik doctor` says what is usable, as the packages' own metadata have it, and exits 1 where something is wrong."""

import importlib.metadata
import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tests.oracles import REPOSITORY


@cache
def doctor(*arguments: str, **environment: str) -> tuple[int, str]:
    given = os.environ | {"PYTHONPATH": str(REPOSITORY)} | environment
    command = [sys.executable, "-m", "benchmarks.cli", "doctor", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=given, timeout=300, check=False)
    assert done.stderr == ""
    return done.returncode, done.stdout


def rows(out: str, part: str) -> dict[str, Any]:
    return {row["name"]: row for row in json.loads(out)["rows"] if row["part"].startswith(part)}


def test_all_that_is_needed_is_usable_with_its_version() -> None:
    status, out = doctor("--json")
    needed = rows(out, "packages")
    assert status == 0
    assert {"numpy", "numba", "casadi", "ruckig", "toppra"} <= set(needed)
    for name, row in needed.items():
        assert (row["state"], row["words"]) == ("usable", importlib.metadata.version(name))


def test_every_peer_is_named_and_one_that_is_not_installed_says_what_to_type() -> None:
    _, out = doctor("--json")
    found = rows(out, "peers")
    files = [f.stem for kind in ("ik", "laws") for f in (REPOSITORY / "benchmarks" / "peers" / kind).glob("[a-z]*.py")]
    assert sorted(found) == sorted(name for name in files if name != "base")
    assert {row["state"] for row in found.values()} <= {"usable", "absent"}
    assert all("install" in row["words"] for row in found.values() if row["state"] == "absent")


def test_the_cache_is_where_numba_was_told_to_put_it(tmp_path: Path) -> None:
    _, out = doctor("--json", NUMBA_CACHE_DIR=str(tmp_path))
    assert rows(out, "compiled")["cache"]["words"].startswith(str(tmp_path))


def test_what_makes_everything_slow_is_a_problem() -> None:
    status, out = doctor(NUMBA_DISABLE_JIT="1")
    assert status == 1
    assert "NUMBA_DISABLE_JIT" in out


@pytest.mark.parametrize("columns", ["40", "200"])
def test_its_tables_fit_a_terminal(columns: str) -> None:
    _, out = doctor(COLUMNS=columns, TERM="dumb")
    assert max(map(len, out.splitlines())) <= int(columns)
