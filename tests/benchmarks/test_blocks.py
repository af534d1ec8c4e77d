"""Kinds of blocks: each keeps the contract, and has a report."""

from __future__ import annotations

import pickle

import pytest

from benchmarks.blocks.base import GROUP, Kind, kind_names, load_kind
from benchmarks.blocks.block import Block
from benchmarks.report import base
from benchmarks.report.base import load_report
from benchmarks.suite import suite_of
from optik.errors import InvalidInput, UnknownName
from optik.registry import own_names

OURS = sorted(own_names(GROUP))


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


def test_a_kind_of_ours_without_a_module_in_the_report_has_the_table_of_its_measures(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Squares(Kind):
        name, title, block = "squares", "Squares", Block

    monkeypatch.setattr(base, "own_names", lambda group: {"squares"})
    (section,) = load_report(Squares()).sections
    assert (section.title, section.anchor) == ("Squares", "squares")


def test_a_key_of_an_earlier_version_names_the_new_one() -> None:
    assert set(OURS) <= set(kind_names())
    for key, now in (("blocks", "budgets"), ("speed", "calls"), ("line", "timing")):
        with pytest.raises(InvalidInput, match=rf"\[\[{now}\]\].*{key}"):
            suite_of("x", {key: []})
    with pytest.raises(UnknownName, match="did you mean calls"):
        suite_of("x", {"cals": []})
    with pytest.raises(InvalidInput, match="installed package"):
        suite_of("x", {"./calls.py": []})
