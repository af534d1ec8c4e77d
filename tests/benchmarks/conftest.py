from __future__ import annotations

import copy
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from benchmarks.blocks.base import Session, load_kind
from benchmarks.cli.app import main
from benchmarks.records import RunFolder
from benchmarks.run import run_suite
from benchmarks.suite import Suite, suite_of
from tests.oracles import REPOSITORY

START = [20, -35, 40, 25, 50, -30]

SMALL: dict[str, Any] = {
    "title": "a small run",
    "seed": 7,
    "budgets": [
        {
            "id": "workspace",
            "robot": "paper6r",
            "set": "graph_paper",
            "budgets": [1, 3, 10, 40],
            "options": {"start_deg": START, "normals": ["Y"], "offsets_m": [0.0], "half_size_m": 0.3, "spacing_m": 0.1},
            "methods": [
                {"label": "dls λ=0.01", "solver": "dls", "options": {"damping": 0.01}},
                {"label": "ipopt", "solver": "ipopt", "max_problems": 6},
            ],
        },
        {
            "id": "misprint",
            "robot": "paper6r",
            "set": "near_start",
            "budgets": [5, 100],
            "options": {"count": 40},
            "methods": [
                {"label": "as printed", "solver": "dls", "options": {"as_printed": True}},
                {"label": "corrected", "solver": "dls"},
            ],
        },
    ],
    "timing": [
        {
            "id": "line",
            "title": "The line",
            "detail": True,
            "lines": [{"robot": "paper6r", "kind": "line", "start_deg": START, "move_m": [-0.12, 0.0, 0.20]}],
            "limits": [{"label": "own", **dict.fromkeys(("velocity", "acceleration", "jerk", "torque"), "robot")}],
            "solvers": ["dls"],
            "laws": [{"law": "quintic"}, {"law": "ruckig"}, {"law": "toppra"}],
            "samples": 31,
        }
    ],
}


def small(**changes: Any) -> Suite:
    return suite_of("small", copy.deepcopy(SMALL) | changes)


def solved(kind: str, settings: dict[str, Any], folder: Path, seed: int = 0) -> pl.DataFrame:
    """The rows of all shards of one block."""
    of = load_kind(kind)
    block = of.settings(settings)
    session = Session(of, block, seed, RunFolder(folder), of.prepare(block, seed))
    return pl.concat([shard.solve() for shard in of.shards(block, session)])


@pytest.fixture(scope="session")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder: Path = tmp_path_factory.mktemp("runs") / "small"
    return run_suite(small(), folder, command="optik bench run small --out RUN")


@pytest.fixture
def copied(small_run: RunFolder, tmp_path: Path) -> RunFolder:
    """The small run in a folder that a test may change."""
    return RunFolder(shutil.copytree(small_run.path, tmp_path / "run"))


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Callable[..., tuple[Any, str, str]]:
    """A command as it is typed, but in this process: exit status, output and errors.

    Imports are most of the time of a process of its own.
    """

    def run(*arguments: str) -> tuple[Any, str, str]:
        monkeypatch.setattr(sys, "argv", ["optik", *arguments])
        capfd.readouterr()
        status: Any = 0
        try:
            main()
        except SystemExit as ended:
            status = ended.code
        return status, *capfd.readouterr()

    return run


def optik_process(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """A command in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.cli", *arguments]
    given = os.environ | {"PYTHONPATH": str(REPOSITORY), "COLUMNS": "160"} | environment
    return subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=REPOSITORY, env=given, check=False)
