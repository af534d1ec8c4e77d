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
    assert list(suite.pairs())
    assert suite.robots


def test_a_suite_is_read_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        '[[timing]]\nid = "a"\nlimits = [{ jerk = 9.0 }]\nlaws = [{ law = "ruckig" }]\n'
        'lines = [{ robot = "paper6r", kind = "line", start_deg = [0,0,0,0,0,0], move_m = [0,0,1] }]\n'
    )
    suite = load_suite(str(file))
    assert suite.name == "mine"
    assert suite.of("timing")[0].samples == 151


def test_the_fingerprint_depends_on_the_settings_alone() -> None:
    assert suite_of("a", copy.deepcopy(SMALL)).fingerprint == suite_of("b", copy.deepcopy(SMALL)).fingerprint
    assert suite_of("a", SMALL | {"seed": 8}).fingerprint != suite_of("a", SMALL).fingerprint


def _changed(path: list[Any], value: Any, settings: dict[str, Any]) -> dict[str, Any]:
    data = copy.deepcopy(settings)
    at: Any = data
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = value
    return data


SPEED: dict[str, Any] = {
    "calls": [
        {
            "id": "warm",
            "robot": "paper6r",
            "set": "near_start",
            "methods": [{"solver": "dls"}],
            "peers": [{"peer": "plain_casadi"}],
            "targets": [{"measure": "median_ratio", "to": "plain casadi", "at_most": 0.5}],
        }
    ],
    "batch": [
        {
            "id": "many", "robot": "paper6r", "set": "near_start", "solver": "dls",
            "targets": [{"measure": "million_per_second", "at_least": 0.2}],
        }
    ],
}  # fmt: skip


TIMING: dict[str, Any] = {
    "timing": [
        {
            "id": "lines",
            "lines": [{"robot": "paper6r", "kind": "regular", "count": 2}],
            "limits": [{"velocity": 2.0, "acceleration": 10.0, "jerk": 100.0}],
            "laws": [{"law": "ruckig"}, {"law": "toppra"}],
            "peers": [{"peer": "toppra_spline"}],
            "reference": {"law": "optimal"},
            "targets": [{"law": "ruckig", "measure": "median_ms", "group": "regular", "at_most": 10}],
        }
    ]
}


@pytest.mark.parametrize(
    ("settings", "path", "value", "error", "word"),
    [
        (SMALL, ["calls"], 1, InvalidInput, "calls"),
        (SMALL, ["budgets", 0, "robott"], 1, InvalidInput, "robott"),
        (SMALL, ["budgets", 0, "robot"], "paper7r", UnknownName, "paper6r"),
        (SMALL, ["budgets", 0, "set"], "graph_papers", UnknownName, "graph_paper"),
        (SMALL, ["budgets", 0, "methods", 0, "solver"], "dlss", UnknownName, "dls"),
        (SMALL, ["budgets", 0, "budgets"], [3, 1], InvalidInput, "budgets"),
        (SMALL, ["budgets", 0, "budgets"], [0], InvalidInput, "budgets"),
        (SMALL, ["budgets", 0, "budgets"], 5, InvalidInput, "budgets"),
        (SMALL, ["budgets", 0, "budgets"], [], InvalidInput, "budgets"),
        (SMALL, ["timing", 0, "lines", 0, "move_m"], [0.1, 0.0], InvalidInput, "move_m"),
        (SMALL, ["timing", 0, "solvers"], "dls", InvalidInput, "solvers"),
        (SMALL, ["budgets", 0, "methods", 0, "options"], {"max_restarts": 3}, InvalidInput, "max_restarts"),
        (SMALL, ["budgets", 0, "methods", 1, "label"], "dls λ=0.01", InvalidInput, "label"),
        (SMALL, ["budgets", 1, "id"], "workspace", InvalidInput, "id"),
        (SMALL, ["budgets", 1, "id"], "Workspace", InvalidInput, "ids 'workspace' and 'Workspace'"),
        (SMALL, ["budgets", 1, "id"], "(workspace!)", InvalidInput, "they name files"),
        (SMALL, ["budgets", 1, "id"], "腕", InvalidInput, "the id '腕'"),
        (SMALL, ["timing", 0, "laws", 0, "law"], "quintics", UnknownName, "quintic"),
        (SMALL, ["timing", 0, "samples"], 1, InvalidInput, "samples"),
        (SMALL, ["seed"], -1, InvalidInput, "seed"),
        (SMALL, ["budgets", 0, "sweep"], "yes", InvalidInput, "sweep"),
        (SPEED, ["calls"], 1, InvalidInput, "calls"),
        (SPEED, ["calls", 0], 1, InvalidInput, "calls block"),
        (SPEED, ["calls", 0, "budgets"], [1], InvalidInput, "budgets"),
        (SPEED, ["calls", 0, "robot"], "paper7r", UnknownName, "paper6r"),
        (SPEED, ["calls", 0, "rounds"], 0, InvalidInput, "rounds"),
        (SPEED, ["calls", 0, "methods", 0, "solver"], "dlss", UnknownName, "dls"),
        (SPEED, ["calls", 0, "methods", 0, "max_problems"], 0, InvalidInput, "max_problems"),
        (SPEED, ["calls", 0, "peers", 0, "peer"], "eiak", UnknownName, "did you mean eaik"),
        (SPEED, ["calls", 0, "peers", 0, "label"], "dls", InvalidInput, "label"),
        (SPEED, ["calls", 0, "targets", 0, "measure"], "speed", InvalidInput, "median_us"),
        (SPEED, ["calls", 0, "targets", 0, "to"], "EAIK", InvalidInput, "a label of the block"),
        (SPEED, ["calls", 0, "targets", 0, "at_least"], 0.1, InvalidInput, "either at_most or at_least"),
        (SPEED, ["calls", 0, "targets", 0, "at_most"], "half", InvalidInput, "at_most"),
        (SPEED, ["calls", 0, "targets", 0, "goal"], 1, InvalidInput, "goal"),
        (SPEED, ["calls", 0, "targets", 0, "measure"], "mean_us", InvalidInput, "only there"),
        (SPEED, ["batch", 0, "threads"], [0], InvalidInput, "threads"),
        (SPEED, ["batch", 0, "repeats"], 0, InvalidInput, "repeats"),
        (SPEED, ["batch", 0, "solver"], "dlss", UnknownName, "dls"),
        (SPEED, ["batch", 0, "id"], "warm", InvalidInput, "id"),
        (SPEED, ["batch", 0, "targets", 0, "measure"], "median_us", InvalidInput, "million_per_second"),
        (SPEED, ["first_use"], {"robot": "paper6r", "solver": "dls"}, InvalidInput, "earlier version"),
        (SPEED, ["answers"], [{"id": "a"}], InvalidInput, "earlier version"),
        (TIMING, ["timing", 0], 1, InvalidInput, "timing block"),
        (TIMING, ["timing", 0, "line"], 1, InvalidInput, "'line'"),
        (TIMING, ["timing", 0, "lines", 0, "robot"], "paper7r", UnknownName, "paper6r"),
        (TIMING, ["timing", 0, "lines", 0, "kind"], "singular", InvalidInput, "near_singular"),
        (TIMING, ["timing", 0, "lines", 0, "count"], 0, InvalidInput, "count"),
        (TIMING, ["timing", 0, "limits", 0], {}, InvalidInput, "velocity"),
        (TIMING, ["timing", 0, "limits", 0, "jerk"], -1, InvalidInput, "jerk"),
        (TIMING, ["timing", 0, "laws", 0, "law"], "rukig", UnknownName, "ruckig"),
        (TIMING, ["timing", 0, "laws", 1, "label"], "ruckig", InvalidInput, "label"),
        (TIMING, ["timing", 0, "peers", 0, "peer"], "cop", UnknownName, "did you mean copp"),
        (TIMING, ["timing", 0, "peers", 0, "max_lines"], 0, InvalidInput, "max_lines"),
        (TIMING, ["timing", 0, "reference", "law"], "best", UnknownName, "optimal"),
        (TIMING, ["timing", 0, "plan"], "toppra spline", InvalidInput, "ruckig, toppra"),
        (TIMING, ["timing", 0, "solvers"], ["lmm"], UnknownName, "lm"),
        (TIMING, ["timing", 0, "rounds"], 0, InvalidInput, "rounds"),
        (TIMING, ["timing", 0, "example"], {"limits": "(1, 2)"}, InvalidInput, "2.0, 10.0, 100.0"),
        (TIMING, ["timing", 0, "targets", 0, "measure"], "median_us", InvalidInput, "median_ms"),
        (TIMING, ["timing", 0, "targets", 0, "law"], "optimal", InvalidInput, "ruckig, toppra"),
        (TIMING, ["timing", 0, "targets", 0, "group"], "ur5e", InvalidInput, "regular, paper6r"),
        (TIMING, ["timing", 0, "targets", 0, "at_least"], 1, InvalidInput, "either at_most or at_least"),
    ],
)
def test_a_wrong_setting_is_named(
    settings: dict[str, Any], path: list[Any], value: Any, error: type[Exception], word: str
) -> None:
    with pytest.raises(error, match=word):
        suite_of("wrong", _changed(path, value, settings))


def test_a_timing_block_looks_closely_at_its_first_line_that_is_near_singular() -> None:
    suite = suite_of("timing", copy.deepcopy(TIMING))
    assert suite.of("timing")[0].labels == ("ruckig", "toppra", "toppra spline")
    assert (suite.of("timing")[0].plan, suite.of("timing")[0].example.kind) == ("ruckig", "regular")
    lines = TIMING["timing"][0]["lines"]
    more = _changed(["timing", 0, "lines"], [*lines, {"robot": "ur5e", "kind": "near_singular", "count": 1}], TIMING)
    example = suite_of("timing", more).of("timing")[0].example
    assert (example.robot, example.kind, example.limits) == ("ur5e", "near_singular", "2.0, 10.0, 100.0")


def test_labels_of_peers_are_their_names_and_targets_ask_of_the_first_method() -> None:
    suite = suite_of("speed", copy.deepcopy(SPEED))
    assert suite.of("calls")[0].labels == ("dls", "plain casadi")
    assert suite.of("calls")[0].targets[0].method == suite.of("calls")[0].reference == "dls"


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


def test_blocks_of_different_kinds_have_files_of_their_own_too() -> None:
    data = copy.deepcopy(SPEED) | {"budgets": copy.deepcopy(SMALL["budgets"])}
    data["budgets"][0]["id"], data["calls"][0]["id"] = "near é start", "Near-Start"
    with pytest.raises(InvalidInput, match="ids 'near é start' and 'Near-Start'"):
        suite_of("both", data)
    data["calls"][0]["id"] = "near e start"
    assert suite_of("both", data).of("calls")[0].id == "near e start"
