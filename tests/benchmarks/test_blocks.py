"""Kinds of blocks: each keeps the contract, and has a report."""

from __future__ import annotations

import pickle

import pytest

from benchmarks.blocks.base import KINDS, Kind, load_kind
from benchmarks.report.base import load_report
from benchmarks.suite import ALIASES, suite_of
from optik.errors import InvalidInput, UnknownName
from tests.benchmarks.conftest import SMALL

OURS = [name for name, module in KINDS.items() if module.startswith("benchmarks.")]


@pytest.mark.parametrize("name", OURS)
def test_every_kind_keeps_the_contract(name: str) -> None:
    kind = load_kind(name)
    assert isinstance(kind, Kind)
    assert kind is load_kind(name)
    assert kind.name == name
    assert kind.title
    assert type(pickle.loads(pickle.dumps(kind))) is type(kind)
    assert len({measure.key for measure in kind.block.measures}) == len(kind.block.measures)
    sections = load_report(kind).sections
    assert sections
    for section in sections:
        assert section.place in ("top", "terms", "summary", "section")
        assert section.template.is_file()
    with pytest.raises(InvalidInput):
        kind.settings("no table")


def test_a_kind_has_the_key_of_its_name_and_perhaps_an_older_one() -> None:
    assert set(ALIASES.values()) <= set(OURS)
    older = suite_of("x", {"blocks": SMALL["blocks"], "line": SMALL["line"]})
    newer = suite_of("x", {"budgets": SMALL["blocks"], "plans": SMALL["line"]})
    assert newer.asked == older.asked
    with pytest.raises(InvalidInput, match="'blocks' and 'budgets'"):
        suite_of("x", {"blocks": SMALL["blocks"], "budgets": SMALL["blocks"]})
    with pytest.raises(UnknownName, match="did you mean speed"):
        suite_of("x", {"sped": []})
