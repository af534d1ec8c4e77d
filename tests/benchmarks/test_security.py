"""What docs/security.md promises: reading what others sent runs none of their code, and no process imports from the folder."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.records import RunFolder
from benchmarks.report import write_report
from benchmarks.report.base import Run
from benchmarks.report.compare import compare_runs
from benchmarks.report.formats import write_csv, write_tex
from optik.errors import OptikError
from tests.oracles import REPOSITORY

BOMB = """
import pathlib
pathlib.Path(__file__).with_suffix(".ran").touch()
import optik
METHOD = optik.load("paper6r")
"""
"""A robot in a Python file that leaves another file beside it where it is run."""


def replaced(settings: Any, key: str, value: str) -> Any:
    """Settings with every value of a key replaced, or added where it is a list."""
    if isinstance(settings, list):
        return [replaced(one, key, value) for one in settings]
    if not isinstance(settings, dict):
        return settings
    return {k: _in_place(v, value) if k == key else replaced(v, key, value) for k, v in settings.items()}


def _in_place(old: Any, value: str) -> Any:
    return [*old, value] if isinstance(old, list) else value


@pytest.mark.parametrize("key", ["robot", "set", "solver", "solvers", "law", "a kind of block"])
def test_reports_and_comparisons_run_no_file_that_a_run_folder_names(
    small_run: RunFolder, copied: RunFolder, tmp_path: Path, key: str
) -> None:
    bomb = tmp_path / "bomb.py"
    bomb.write_text(BOMB)
    manifest = copied.manifest()
    settings = replaced(manifest["settings"], key, str(bomb))
    assert settings != manifest["settings"] or key == "a kind of block"
    manifest["settings"] = settings if key != "a kind of block" else settings | {str(bomb): [{"id": "x"}]}
    copied.write_json("run.json", manifest)
    for read in (write_report, write_csv, write_tex, lambda f: compare_runs(Run(f), Run(small_run))):
        try:
            read(copied)
        except OptikError as error:
            assert "bomb" in str(error)
    assert not bomb.with_suffix(".ran").exists()


def test_an_arm_that_the_run_has_not_stored_is_named(small_run: RunFolder, tmp_path: Path) -> None:
    with pytest.raises(OptikError, match=r"run\.json.*repeat the run"):
        Run(small_run).robot(str(tmp_path / "arm.urdf"))


# ---------------------------------------------------------------- the working folder

MODULES = (
    "random",
    "pickle",
    "socket",
    "multiprocessing",
    "numpy",
    "polars",
    "numba",
    "optik",
    "planners",
    "benchmarks",
)
"""What child processes import, of Python, of others and of ours."""

FOREIGN = "import pathlib, sys; pathlib.Path(__file__).with_suffix('.ran').touch(); sys.exit('run')"

STARTS = {
    "fresh": "from benchmarks.blocks.contest import fresh\n"
    "fresh(['-c', 'import pickle, random, polars, optik; print(1)'], 'a process')\n",
    "workers": "import sys\n"
    "from benchmarks.run import run_suite\nfrom benchmarks.suite import suite_of\n"
    "if __name__ == '__main__':\n"
    "    suite = suite_of('toy', {'budgets': [{'id': 'a', 'robot': 'paper6r', 'set': 'random_reachable', 'budgets': [5],\n"
    "                                         'options': {'count': 10}, 'methods': [{'solver': 'dls'}]}]})\n"
    "    assert run_suite(suite, sys.argv[1], part_timeout=60.0).manifest()['complete']\n",
}
"""Scripts, each in a folder of its own as that of an installed command, that start child processes."""


@pytest.mark.parametrize("how", STARTS)
def test_child_processes_import_nothing_from_the_working_folder(tmp_path: Path, how: str) -> None:
    script, work = tmp_path / "bin" / "command.py", tmp_path / "work"
    for folder in (script.parent, work):
        folder.mkdir()
    script.write_text(STARTS[how])
    for module in MODULES:
        (work / f"{module}.py").write_text(FOREIGN)
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONSAFEPATH"} | {"PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path / "run")],
        capture_output=True, text=True, timeout=120, cwd=work, env=environment,
    )  # fmt: skip
    assert [file.name for file in work.glob("*.ran")] == []
    assert done.returncode == 0, done.stderr


def test_numba_takes_no_folder_of_compiled_code_from_the_working_folder(tmp_path: Path) -> None:
    (tmp_path / ".numba_config.yaml").write_text(f"cache_dir: {tmp_path / 'theirs'}\n")
    code = (
        "from optik.linear import copy_vector as f; import numba\n"
        "numba.core.config.reload_config(); print(f._cache.cache_path)"
    )
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | {"PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert done.stdout.strip() and str(tmp_path) not in done.stdout, done.stderr


# ---------------------------------------------------------------- the page


def test_every_entry_of_the_threat_model_has_a_test() -> None:
    page = (REPOSITORY / "docs" / "security.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ") and "`tests/" in line]
    assert len(rows) >= 10
    for row in rows:
        for file, test in re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", row):
            assert f"def {test}(" in (REPOSITORY / file).read_text(encoding="utf-8"), row
