"""Suites are checked before anything runs, and every wrong key or name is said."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

from benchmarks.suite import SUITES, load_suite, suite_of
from optik.errors import InvalidInput, UnknownName
from optik.registry import names
from tests.benchmarks.conftest import SMALL


@pytest.mark.parametrize("name", names(SUITES))
def test_every_suite_that_comes_along_loads(name: str) -> None:
    suite = load_suite(name)
    assert suite.name == name
    assert suite.blocks or suite.line


def test_a_suite_is_read_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        '[line]\nrobot = "paper6r"\nstart_deg = [0,0,0,0,0,0]\nmove_m = [0,0,1]\nik = ["dls"]\nlaws = ["ruckig"]\n'
    )
    suite = load_suite(str(file))
    assert suite.name == "mine"
    assert suite.line is not None
    assert suite.line.samples == 151


def test_the_fingerprint_depends_on_the_settings_alone() -> None:
    assert suite_of("a", copy.deepcopy(SMALL)).fingerprint == suite_of("b", copy.deepcopy(SMALL)).fingerprint
    assert suite_of("a", SMALL | {"seed": 8}).fingerprint != suite_of("a", SMALL).fingerprint


def _changed(path: list[Any], value: Any) -> dict[str, Any]:
    data = copy.deepcopy(SMALL)
    at: Any = data
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = value
    return data


@pytest.mark.parametrize(
    ("path", "value", "error", "word"),
    [
        (["speed"], 1, InvalidInput, "speed"),
        (["blocks", 0, "robott"], 1, InvalidInput, "robott"),
        (["blocks", 0, "robot"], "paper7r", UnknownName, "paper6r"),
        (["blocks", 0, "set"], "graph_papers", UnknownName, "graph_paper"),
        (["blocks", 0, "methods", 0, "solver"], "dlss", UnknownName, "dls"),
        (["blocks", 0, "budgets"], [3, 1], InvalidInput, "budgets"),
        (["blocks", 0, "budgets"], [0], InvalidInput, "budgets"),
        (["blocks", 0, "budgets"], 5, InvalidInput, "budgets"),
        (["blocks", 0, "budgets"], [], InvalidInput, "budgets"),
        (["line", "move_m"], [0.1, 0.0], InvalidInput, "move_m"),
        (["line", "ik"], "dls", InvalidInput, "ik"),
        (["blocks", 0, "methods", 0, "options"], {"max_restarts": 3}, InvalidInput, "max_restarts"),
        (["blocks", 0, "methods", 1, "label"], "dls λ=0.01", InvalidInput, "label"),
        (["blocks", 1, "id"], "workspace", InvalidInput, "id"),
        (["line", "laws"], ["quintics"], UnknownName, "quintic"),
        (["line", "samples"], 1, InvalidInput, "samples"),
        (["seed"], -1, InvalidInput, "seed"),
    ],
)
def test_a_wrong_setting_is_named(path: list[Any], value: Any, error: type[Exception], word: str) -> None:
    with pytest.raises(error, match=word):
        suite_of("small", _changed(path, value))


def test_an_empty_suite_is_refused() -> None:
    with pytest.raises(InvalidInput):
        suite_of("none", {})


def test_a_file_that_is_no_toml_is_named(tmp_path: Path) -> None:
    file = tmp_path / "broken.toml"
    file.write_text("[[[")
    with pytest.raises(InvalidInput, match=r"broken\.toml"):
        load_suite(str(file))


def test_an_unknown_suite_offers_the_nearest() -> None:
    with pytest.raises(UnknownName, match="did you mean paper"):
        load_suite("papers")
