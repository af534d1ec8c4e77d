"""The report of speed and of damping: its numbers are those of the rows, its advice follows from them."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from benchmarks.blocks.base import load_kind
from benchmarks.blocks.contest import version_words
from benchmarks.blocks.entries import check_set
from benchmarks.records import RunFolder
from benchmarks.report.base import Run, load_report
from benchmarks.report.budgets.accuracy import choose_dampings
from benchmarks.report.calls.tables import conspicuous
from benchmarks.run import run_suite
from benchmarks.suite import suite_of
from tests.benchmarks.browser import CHROMIUM
from tests.benchmarks.test_report import Page, draws_every_plot, page_of
from tests.outside import hide

SPEED: dict[str, Any] = {
    "title": "fast and sure",
    "calls": [
        {
            "id": "hard",
            "title": "hard ones",
            "robot": "paper6r",
            "set": "hard",
            "options": {"count": 20},
            "rounds": 1,
            "methods": [{"solver": "dls"}, {"label": "one step", "solver": "dls", "options": {"max_iterations": 1}}],
            "peers": [{"peer": "plain_casadi", "max_problems": 5}, {"peer": "eaik", "label": "EAIK <b>"}],
            "targets": [
                {"measure": "max_us", "at_most": 1e9},
                {"measure": "max_us", "at_most": 1e-3, "goal": True},
                {"measure": "median_ratio", "to": "EAIK <b>", "at_most": 0.5},
            ],
        }
    ],
}


@pytest.fixture(scope="module")
def speed_run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    with pytest.MonkeyPatch.context() as patch:
        hide(patch, "eaik")
        return run_suite(suite_of("speed", SPEED), tmp_path_factory.mktemp("report-speed") / "run")


@pytest.fixture(scope="module")
def page(speed_run: RunFolder) -> Page:
    return page_of(speed_run)


def test_a_run_of_speed_alone_has_its_section_and_no_claims(page: Page) -> None:
    assert page.anchors == ["calls", "limitations", "asked", "provenance"]
    assert "1 of 3 targets met, 1 not measured." in page.text


def test_every_table_of_the_report_is_on_the_page(page: Page, speed_run: RunFolder) -> None:
    tables = {table.id for table in load_report(load_kind("calls")).tables(Run(speed_run))}
    assert "calls-hard" in tables
    assert {a["data-table"] for t, a in page.tags if t == "table" and "data-table" in a} >= tables


def test_an_absent_peer_kinds_of_failures_and_verdicts_are_on_the_page(page: Page) -> None:
    kinds = ("elbow singular", "joint zeros", "wrist singular, on the limits")
    for words in ("not installed: pip install EAIK", "EAIK <b>", "(a goal)", *kinds):
        assert words in page.text
    assert ("b", {}) not in page.tags
    looks = [a["class"] for t, a in page.tags if t == "span" and "badge" in a.get("class", "")]
    assert looks == ["badge good", "badge partly", "badge none"]


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")
def test_a_browser_draws_the_speed_section(speed_run: RunFolder, tmp_path: Path) -> None:
    shutil.copytree(speed_run.path, tmp_path / "run")
    draws_every_plot(RunFolder(tmp_path / "run"), tmp_path)


# ---------------------------------------------------------------- damping


def figures(low: float, share_: float, high: float, iterations: float) -> dict[str, Any]:
    return {"low": low, "share": share_, "high": high, "iterations": iterations}


def test_the_fastest_of_those_that_none_is_surely_better_than_is_chosen() -> None:
    constants = {"a": 0.001, "b": 0.01, "c": 0.1, "d": 0.2}
    found = {
        "a": figures(80, 90, 95, 4.0),  # reaches the surest one's interval, and is faster
        "b": figures(93, 97, 99, 6.0),
        "c": figures(10, 20, 30, 2.0),  # fast, but surely worse
        "d": figures(92, 96, 98, float("nan")),
    }
    assert choose_dampings(constants, found) == ["a", "b"]
    found["a"]["high"] = 92.0
    assert choose_dampings(constants, found) == ["b"]


def test_the_advice_is_of_the_rows(tmp_path: Path) -> None:
    block = {
        "id": "damping", "robot": "paper6r", "set": "near_start", "budgets": [5, 60], "sweep": True,
        "options": {"count": 12, "singular_edges": [0.0, 0.03, 1.0]},
        "methods": [
            {"label": "λ=0.001", "solver": "dls", "options": {"damping": 0.001}},
            {"label": "λ=0.3", "solver": "dls", "options": {"damping": 0.3}},
            {"label": "half steps", "solver": "dls", "options": {"step": 0.5}},
        ],
    }  # fmt: skip
    folder = run_suite(suite_of("small", {"budgets": [block], "seed": 7}), tmp_path / "run")
    page = page_of(folder)
    assert "damping" in page.anchors
    rows = folder.rows("budgets", "damping")
    last = rows.filter(pl.col("budget") == 60)
    far = last.filter((pl.col("group") == "0.03 ≤ σ < 1") & (pl.col("method") == "λ=0.001"))
    assert far.filter(pl.col("status") == "solved").height == 12
    assert "0.03 ≤ σ < 1 : λ=0.001: 100.0 % of 12 solved after a median of" in page.text
    near = last.filter((pl.col("group") == "0 ≤ σ < 0.03") & (pl.col("method") == "λ=0.3"))
    percent = 100 * near.filter(pl.col("status") == "solved").height / 12
    assert f"λ=0.3 with {percent:.1f} % of 12" in page.text
    assert "half steps: " in page.text
    (found,) = [t for t in load_report(load_kind("budgets")).tables(Run(folder)) if t.id == "damping"]
    assert [column.words for column in found.columns if not column.aside] == [
        "Damping", "solved, 0 ≤ σ < 0.03 (n = 12)", "solved, 0.03 ≤ σ < 1 (n = 12)",
    ]  # fmt: skip
    row = {row["label"]: row for row in found.rows}["λ=0.3"]
    assert row["share 0 ≤ σ < 0.03"][0] == pytest.approx(percent)  # type: ignore[index]
    assert row["p95 0 ≤ σ < 0.03"] == pytest.approx(1e3 * np.quantile(near["position_error"].to_numpy(), 0.95))


def test_a_method_that_raises_is_named_with_its_first_reason() -> None:
    rows = {
        "outcome": ["answered", "raised"], "error": [None, "ValueError: singular\nmatrix"], "solved": [True, False],
        "claimed": [None, None], "cpu_ns": [None, None], "changed_input": False, "ns": 1.0, "least_ns": 1, "most_ns": 1,
        "first_round": 1.0,
    }  # fmt: skip
    assert list(conspicuous(pl.DataFrame(rows), "")) == ["raised in 1 of 2 calls, first: ValueError: singular matrix"]


def test_a_method_from_a_file_is_not_called_one_of_ours() -> None:
    facts = {"kind": "ours", "version": None}
    assert "file" not in version_words(facts | {"name": "lm"})
    assert version_words(facts | {"name": "/somewhere/mine.py"}).endswith("file mine.py")


def test_a_set_of_fewer_problems_than_a_trial_draws_is_accepted() -> None:
    data = {**SPEED["calls"][0], "set": "random_reachable", "options": {"count": 2}}
    check_set(suite_of("calls", {"calls": [data]}).of("calls")[0])
