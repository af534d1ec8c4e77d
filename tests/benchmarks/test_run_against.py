"""Blocks by two interpreters in turn: the order of their processes, where they stop, and what an interruption leaves."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.blocks.contest import ProcessFailed, run_python
from benchmarks.provenance import ROOT
from benchmarks.records import RunFolder
from benchmarks.run import against
from benchmarks.suite import load_suite

SUITE = """
[[budgets]]
id = "untimed"
robot = "paper6r"
set = "near_start"
methods = [{ solver = "dls" }]
[[calls]]
id = "warm"
robot = "paper6r"
set = "near_start"
methods = [{ solver = "lm" }]
"""


def test_processes_alternate_until_the_times_are_settled_and_finished_ones_are_not_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "suite.toml"
    file.write_text(SUITE)
    done: list[tuple[str, str]] = []

    def run(python: str, arguments: list[str], what: str, **environment: str) -> str:
        *_, kind, block, out, allowed = arguments
        assert (kind, block, allowed) == ("calls", "warm", "")
        done.append((Path(python).name, "/".join(Path(out).relative_to(tmp_path).parts)))
        manifest = dict.fromkeys(("suite", "title", "fingerprint", "settings", "command", "provenance", "continued"))
        Path(out).mkdir()
        (Path(out) / "run.json").write_text(json.dumps({"format": "optik-run/4", "complete": True, **manifest}))
        return ""

    monkeypatch.setattr(against, "run_python", run)
    folders = (RunFolder(tmp_path / "run"), RunFolder(tmp_path / "other"))
    for folder in folders:
        folder.path.mkdir()
        manifest = dict.fromkeys(("suite", "title", "fingerprint", "settings", "command", "provenance", "continued"))
        folder.write_json("run.json", {"format": "optik-run/4", "complete": True, **manifest})

    def go(most: int) -> None:
        suite = load_suite(str(file))
        against.run_alternately(suite, file, folders, "theirs", lambda *_: len(done) >= most, lambda _: None)

    ours, at = Path(sys.executable).name, "processes/calls-warm"
    go(4)
    want = [(ours, "run", 0), ("theirs", "other", 0), ("theirs", "other", 1), (ours, "run", 1)]
    assert done == [(program, f"{folder}/{at}/{turn:02d}") for program, folder, turn in want]
    token = folders[0].manifest()["alternated"]
    done.clear()
    go(2)
    assert done == [(ours, f"run/{at}/02"), ("theirs", f"other/{at}/02")]
    assert folders[0].manifest()["alternated"] == folders[1].manifest()["alternated"] == token


def test_another_interpreter_sees_no_path_of_this_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PYTHONPATH", "/here")
    (other := tmp_path / "python").symlink_to(sys.executable)
    code = "import os, sys; print(os.environ['PYTHONPATH'] or 'none', '' in sys.path)"
    assert run_python(sys.executable, ["-c", code], "a process").split() == [f"{ROOT}{os.pathsep}/here", "False"]
    assert run_python(str(other), ["-c", code], "a process").split() == ["none", "False"]
    with pytest.raises(ProcessFailed, match="a process: ValueError: no"):
        run_python(sys.executable, ["-c", "raise ValueError('no')"], "a process")


def test_an_interpreter_that_is_not_there_is_named(typed: Any, tmp_path: Path) -> None:
    file = tmp_path / "suite.toml"
    file.write_text(SUITE)
    code, _, err = typed("bench", "run", str(file), "--out", str(tmp_path / "run"), "--against", "no-python")
    assert code == 2
    assert "no-python" in err
    assert not (tmp_path / "run").exists()
