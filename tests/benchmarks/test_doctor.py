"""`optik doctor` says what is usable, as the packages' own metadata have it, and exits 1 where something is wrong."""

import importlib.metadata
import json
from pathlib import Path
from typing import Any

import pytest

from tests.benchmarks.conftest import optik_process
from tests.oracles import REPOSITORY


def rows(out: str, part: str) -> dict[str, Any]:
    return {row["name"]: row for row in json.loads(out)["rows"] if row["part"].startswith(part)}


def test_what_is_needed_is_usable_and_every_peer_is_named_with_what_to_type(
    typed: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path))
    status, out, said = typed("doctor", "--json")
    assert (status, said) == (0, "")
    needed = rows(out, "packages")
    assert {"numpy", "numba", "ruckig", "toppra"} <= set(needed)
    for name, row in needed.items():
        assert (row["state"], row["words"]) == ("usable", importlib.metadata.version(name))
    found = rows(out, "peers")
    files = [
        f.stem
        for kind in ("ik", "laws")
        for f in (REPOSITORY / "benchmarks" / "peers" / kind).glob("[a-z]*.py")
        if "METHOD = " in f.read_text()
    ]
    assert sorted(found) == sorted(name for name in files if name != "base")
    assert {row["state"] for row in found.values()} <= {"usable", "absent"}
    assert all("install" in row["words"] for row in found.values() if row["state"] == "absent")
    assert rows(out, "compiled")["cache"]["words"].startswith(str(tmp_path))


def test_what_makes_everything_slow_is_a_problem_said_within_forty_columns() -> None:
    done = optik_process("doctor", NUMBA_DISABLE_JIT="1", COLUMNS="40", TERM="dumb")
    assert (done.returncode, done.stderr) == (1, "")
    assert "NUMBA_DISABLE_JIT" in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 40
