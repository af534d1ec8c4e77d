"""Suites with plug-ins: refused unless allowed, the same in workers, recorded, and not continued with other files."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from benchmarks.records import RunFolder
from benchmarks.run import run_suite
from benchmarks.suite import load_suite
from optik import registry
from optik.errors import InvalidInput
from optik.plugins.files import digest
from tests.benchmarks.conftest import optik_process
from tests.benchmarks.test_report import page_of
from tests.oracles import REPOSITORY

MARK = '\nimport pathlib; pathlib.Path(__file__).with_suffix(".ran").touch()\n'
"""What a file does where it is run: it leaves another beside it."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The example suite in a folder of its own, so that each test has other files; every file tells that it was run."""
    monkeypatch.setattr(registry, "_loaded", {})  # other tests of this process load the examples where they are
    examples = tmp_path / "examples"
    shutil.copytree(
        REPOSITORY / "examples" / "plugins", examples, ignore=shutil.ignore_patterns("__pycache__", "*.ran")
    )
    for file in examples.glob("*.py"):
        file.write_text(file.read_text() + MARK)
    return examples


def ran(folder: Path) -> list[str]:
    return sorted(file.stem for file in folder.glob("*.ran"))


@pytest.fixture
def said(typed: Any) -> Callable[..., tuple[int, str]]:
    """Exit status and words of a command, with the words on one line."""

    def run(*arguments: str) -> tuple[int, str]:
        status, out, errors = typed(*arguments)
        return status, " ".join((out + errors).split())

    return run


def test_a_file_that_raises_when_it_is_imported_is_named_with_its_line(folder: Path, said: Any) -> None:
    (folder / "jt.py").write_text("\nraise RuntimeError('boom')\n")
    run = ["bench", "run", str(folder / "suite.toml"), "--out", str(folder.parent / "run"), "--allow-plugins"]
    code, words = said(*run)
    assert code == 2
    assert "RuntimeError: boom" in words
    assert "jt.py, line 2" in words
    assert "Traceback" not in words


def test_a_suite_with_files_runs_only_where_it_is_allowed_and_its_report_runs_none(folder: Path, said: Any) -> None:
    suite, out = str(folder / "suite.toml"), str(folder.parent / "run")
    run = ["bench", "run", suite, "--out", out]
    (code, words), (checked, listed) = said(*run), said("bench", "check", suite, "--json")
    assert code == 2
    assert "--allow-plugins" in words
    assert str(folder / "jt.py") in words
    assert not Path(out).exists()
    assert checked == 0
    assert {row["name"] for row in json.loads(listed)["plugins"]} == {"arm", "beside", "jt"}
    assert ran(folder) == []
    assert "not run" in said("bench", "check", suite)[1]

    done = optik_process(*run, "--allow-plugins", "--workers", "2")
    assert done.returncode == 0, done.stdout + done.stderr
    assert ran(folder) == ["beside", "jt"]
    recorded = {row["name"]: row for row in RunFolder(out).manifest()["plugins"]}
    assert recorded["jt"]["sha256"] == digest(folder / "jt.py")
    assert recorded["arm"]["path"] == str(folder / "arm.toml")
    rows = RunFolder(out).rows("budgets", "beside")
    assert set(rows["method"]) == {"dls", "Jacobian transpose"}
    assert set(rows["solver"]) == {"dls", "jt"}

    (folder / "jt.py").write_text((folder / "jt.py").read_text() + "\n# changed\n")
    code, words = said(*run, "--allow-plugins")
    assert code == 2
    assert "plug-in jt (optik.ik)" in words
    assert f"got {folder / 'jt.py'} with SHA-256" in words
    shutil.rmtree(folder)
    code, words = said("bench", "report", out)
    assert code == 0, words
    page = page_of(RunFolder(out))
    assert "arm (6 joints)" in page.text
    assert str(folder / "arm.toml") not in page.text
    assert f"plug-in jt (optik.ik) jt.py, SHA-256 {recorded['jt']['sha256']}" in page.text
    assert not folder.exists()


def test_a_suite_that_was_only_looked_at_is_not_run(tmp_path: Path) -> None:
    (tmp_path / "looked_at.py").write_text(MARK)
    block = 'id = "a"\nrobot = "paper6r"\nset = "random_reachable"\nmethods = [{ solver = "./looked_at.py" }]\n'
    (tmp_path / "look.toml").write_text(f"[[budgets]]\n{block}")
    with pytest.raises(InvalidInput, match="allow_plugins=True"):
        run_suite(load_suite(str(tmp_path / "look.toml")), tmp_path / "run")
    assert ran(tmp_path) == []
