"""What every kind of block must keep: runs over all files in benchmarks/blocks, each with little blocks of our suites."""

import tomllib
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from benchmarks.blocks.base import GROUP, load_kind
from benchmarks.records import failures, rows_file
from benchmarks.report.base import Run, load_report
from benchmarks.run import run_suite
from benchmarks.suite import SUITES, suite_of
from optik.registry import data_file, own_names

LITTLE = {"count": 2, "rounds": 1, "repeats": 1}
"""Largest value of each key that multiplies the work of a block."""
LEFT_OUT = {"targets", "peers", "max_problems"}
"""A little block has no bound to meet, names no package of others, and gives every method all problems."""


def is_counted(settings: Any) -> bool:
    return "'count'" in str(settings)


def little(settings: Any) -> Any:
    """A block with two problems, each solved once; of several sets of problems it keeps the first."""
    if isinstance(settings, dict):
        kept = {key: value for key, value in settings.items() if key not in LEFT_OUT}
        return {key: min(value, LITTLE[key]) if key in LITTLE else little(value) for key, value in kept.items()}
    if isinstance(settings, list):
        return [little(one) for one in (settings[:1] if is_counted(settings) else settings)]
    return settings


def little_block(name: str) -> dict[str, Any]:
    """The shortest block of our suites for a kind, one with a number of problems if there is one."""
    files = (data_file(SUITES, suite, "suite") for suite in sorted(own_names(SUITES)))
    found = [block for file in files for block in tomllib.loads(file.read_text(encoding="utf-8")).get(name, [])]
    assert found, f"no suite in benchmarks/suites has a block [[{name}]]: add one"
    shortest: dict[str, Any] = little(min(found, key=lambda block: (not is_counted(block), len(str(block)))))
    return shortest


@pytest.mark.parametrize("name", sorted(own_names(GROUP)))
def test_every_kind_solves_two_problems_and_shows_them_in_a_table(name: str, tmp_path: Path) -> None:
    suite = suite_of(name, {name: [little_block(name)]})
    run = run_suite(suite, tmp_path / "run")
    assert failures(run) == []
    assert run.manifest()["complete"]
    for kind, block in suite.pairs():
        rows = pl.concat(pl.read_parquet(file) for file in run.path.glob(rows_file(name, block.id, "parquet", "*")))
        assert set(rows.columns) == {"block", *(field for field in kind.fields if kind.fields[field].stored)}
        assert not rows.is_empty()
        for entry in block.entries:
            if entry.role != "peer":  # its package may be absent
                assert set(rows.filter(method=entry.label)["problem"]) == set(rows["problem"]), entry.label
        crashed = kind.lost()
        measured = [key for key in kind.compared if key in crashed and {*rows[key]} - {None, crashed[key]}]
        assert measured, "no value but those of a crashed method"
    tables = load_report(load_kind(name)).tables(Run(run))
    assert [table.id for table in tables if not table.rows] == []
    assert tables
