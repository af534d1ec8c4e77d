"""Kinds of suite blocks: ours keep the contract, and one from outside is a single file, also in a report without it."""

from __future__ import annotations

import json
import shutil
import sys
import tomllib
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from benchmarks.kinds.base import KINDS, Kind, Section, load_kind
from benchmarks.records import RunFolder
from benchmarks.report.numbers import number
from benchmarks.report.run import Run
from benchmarks.run import run_suite
from benchmarks.suite import ALIASES, Suite, suite_of
from optik.errors import InvalidInput, UnknownName
from optik.registry import load_method, names
from tests.benchmarks.conftest import SMALL
from tests.benchmarks.test_report import page_of
from tests.oracles import REPOSITORY

DOCS = (REPOSITORY / "docs" / "comparison.md").read_text(encoding="utf-8").partition("## A kind of suite block")[2]
EXAMPLE = (REPOSITORY / "examples" / "fk_time.py").read_text(encoding="utf-8")
RATIO = """        Measure("ratio", "", lambda rows, a, b: (
            rows.filter(pl.col("method") == a)["us"].median() / rows.filter(pl.col("method") == b)["us"].median()
        ), "median over that of", relative=True),
    )

    def settings"""
OUTSIDE = DOCS.partition("```python\n")[2].partition("```")[0].replace("    )\n\n    def settings", RATIO)

BLOCK = {
    "id": "poses", "title": "Poses <of> one arm", "robot": "paper6r", "sizes": [1, 100],
    "targets": [
        {"measure": "median_us", "at_most": 1e9},
        {"measure": "ratio", "method": "100 at once", "to": "1 at once", "at_most": 1e-9, "goal": True},
    ],
}  # fmt: skip


@pytest.fixture(scope="module")
def outside(tmp_path_factory: pytest.TempPathFactory) -> type[Kind]:
    file = tmp_path_factory.mktemp("outside") / "fk_time.py"
    file.write_text(OUTSIDE)
    kind: type[Kind] = load_method(KINDS, str(file))
    return kind


def suite_with(kind: type[Kind], **changes: Any) -> Suite:
    return suite_of("fk", {str(sys.modules[kind.__module__].__file__): [BLOCK | changes]})


@pytest.fixture(scope="module")
def run(outside: type[Kind], tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return run_suite(suite_with(outside), tmp_path_factory.mktemp("fk") / "run")


# ---------------------------------------------------------------- ours


@pytest.mark.parametrize("name", names(KINDS))
def test_every_kind_keeps_the_contract(name: str) -> None:
    kind = load_kind(name)
    assert isinstance(kind, load_method(KINDS, name))
    assert kind is load_kind(name)
    assert kind.name == name
    assert kind.title
    assert len({measure.name for measure in kind.measures}) == len(kind.measures)
    for section in kind.sections():
        assert isinstance(section, Section)
        assert section.place in ("top", "terms", "summary", "section")
        assert isinstance(section.template, Path)
        assert section.template.is_file()
    with pytest.raises(InvalidInput):
        kind.settings("no table")


def test_a_kind_has_the_key_of_its_name_and_perhaps_an_older_one() -> None:
    assert set(ALIASES.values()) <= set(names(KINDS))
    older = suite_of("x", {"blocks": SMALL["blocks"], "line": SMALL["line"]})
    newer = suite_of("x", {"budgets": SMALL["blocks"], "plans": SMALL["line"]})
    assert newer.asked == older.asked
    with pytest.raises(InvalidInput, match="'blocks' and 'budgets'"):
        suite_of("x", {"blocks": SMALL["blocks"], "budgets": SMALL["blocks"]})
    with pytest.raises(UnknownName, match="did you mean speed"):
        suite_of("x", {"sped": []})


# ---------------------------------------------------------------- one from outside


def test_the_example_is_the_one_of_the_docs() -> None:
    assert DOCS.partition("```python\n")[2].partition("```")[0] == EXAMPLE


def test_the_suite_of_the_docs_is_one(outside: type[Kind]) -> None:
    found = outside()
    data = tomllib.loads(DOCS.partition("```toml\n")[2].partition("```")[0])
    suite = suite_of("docs", data, find=lambda name: found)
    assert suite.kinds == (found,)
    assert suite.of("fk_time")[0].targets[0].method == "1000 at once"
    assert found.folder == "kinds/fk-time"


def test_a_kind_from_outside_runs_is_judged_and_continued(outside: type[Kind], run: RunFolder) -> None:
    rows = run.read("kinds/fk-time/poses.parquet")
    assert rows is not None
    assert rows["method"].unique(maintain_order=True).to_list() == ["1 at once", "100 at once"]
    suite = suite_with(outside)
    found = [o for kind, block in suite.pairs() for o in kind.outcomes(block, run)]
    assert [o.held for o in found] == [True, False]
    assert found[0].value == rows.filter(pl.col("method") == "1 at once")["us"].median()
    assert found[1].what == "100 at once: median over that of 1 at once"
    before = (run.path / "kinds/fk-time/poses.parquet").stat().st_mtime_ns
    run_suite(suite, run.path)
    assert (run.path / "kinds/fk-time/poses.parquet").stat().st_mtime_ns == before


def test_its_wrong_settings_are_named(outside: type[Kind]) -> None:
    for changes, word in (
        ({"size": 3}, "size"),
        ({"targets": [{"measure": "median_ms", "at_most": 1}]}, "median_us, longest_us, ratio"),
        ({"targets": [{"measure": "median_us", "method": "2 at once", "at_most": 1}]}, "1 at once, 100 at once"),
        ({"targets": [{"measure": "ratio", "at_most": 1}]}, "`to` for ratio"),
    ):
        with pytest.raises(InvalidInput, match=word):
            suite_with(outside, **changes)


def test_a_report_has_its_table_without_its_code(outside: type[Kind], run: RunFolder) -> None:
    found = Run(run)
    assert not isinstance(found.suite.kinds[0], outside)
    page = page_of(run)
    assert page.anchors == ["fk-time", "limitations", "asked", "provenance"]
    assert "The kind of block 'fk_time' is not available here" in page.text
    assert "ompared: forward kinematics on paper6r (6 joints)." in page.text.replace(" (", " (")
    assert "Poses <of> one arm" in page.text
    assert "longest call [µs]" in page.text
    assert "1 of 2 targets met." in page.text
    assert "100 at once: median over that of 1 at once" in page.text
    table = json.loads((run.path / "kinds/fk-time/poses.table.json").read_text())
    rows = run.read("kinds/fk-time/poses.parquet")
    assert rows is not None
    worst = rows.filter(pl.col("method") == "100 at once")["us"].max()
    assert table["rows"][1]["values"][1] == [worst]
    assert number(float(worst)) in page.text


def test_a_report_names_the_package_of_a_kind_that_is_not_installed(run: RunFolder, tmp_path: Path) -> None:
    shutil.copytree(run.path, tmp_path / "run")
    row = {"group": KINDS, "name": "fk_time", "distribution": "fast-kinds", "version": "1.2"}
    manifest = run.manifest() | {"settings": {"fk_time": [BLOCK]}, "plugins": [row]}
    (tmp_path / "run" / "run.json").write_text(json.dumps(manifest))
    text = page_of(RunFolder(tmp_path / "run")).text
    assert "'fk_time' is not available here: the package fast-kinds 1.2, which it comes from, is not installed." in text
    assert "runs no code" not in text
    assert "plug-in fk_time (benchmarks.kinds) fast-kinds 1.2" in text


def test_a_kind_without_a_stored_table_says_where_its_rows_are(
    outside: type[Kind], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.run.session.store_table", lambda *a: None)
    folder = run_suite(suite_with(outside), tmp_path / "run")
    assert "rows of the blocks without figures are in kinds/fk-time/" in page_of(folder).text


def test_with_its_code_the_report_computes_the_table(
    outside: type[Kind], run: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = outside()
    monkeypatch.setattr("benchmarks.report.run.kind_or_stored", lambda name, folder: kind)
    page = page_of(run)
    assert "not available" not in page.text
    assert "ompared: forward kinematics on" in page.text
