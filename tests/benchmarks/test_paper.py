"""The paper's suite, small: its rows are those of every method, and the report's figures are what NumPy finds in the files."""

from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.blocks.base import load_kind
from benchmarks.experiments.base import COUNTERPARTS, PAPER_TITLE
from benchmarks.experiments.claims import judge_claims
from benchmarks.records import RunFolder
from benchmarks.report import write_report
from benchmarks.report.base import Run, Winner, load_report
from benchmarks.report.budgets.default import pairs
from benchmarks.report.tables import Table
from benchmarks.run import run_suite
from benchmarks.suite import load_suite, suite_of
from optik.registry import own_names
from tests.benchmarks import plain_demo

PAPER, ATTEMPT, WHOLE = "dls λ=0.01", "lm, one attempt", "lm"


def smaller(settings: dict[str, Any]) -> dict[str, Any]:
    """The suite with fewer problems, laws and samples, and the same methods."""
    settings = copy.deepcopy(settings)
    for block in (*settings["budgets"], *settings["calls"]):
        options = block["options"]
        if "spacing_m" in options:
            options |= {"spacing_m": 0.1, "offsets_m": [0.0], "normals": ["Y"]}
        else:
            options["count"] = 20
        for method in block["methods"]:
            method["max_problems"] = 8 if method["solver"] == "ipopt" else 60 if method["label"] != PAPER else 200
            if method["label"] in (ATTEMPT, "dls α=0.25"):
                method["max_problems"] = 200
    laws = [{"law": law} for law in ("quintic", "ruckig", "toppra")]
    settings["timing"][0] |= {"laws": laws, "samples": 31, "plan": "ruckig"}
    return settings


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    suite = suite_of("paper", smaller(load_suite("paper").settings))
    return Run(run_suite(suite, tmp_path_factory.mktemp("paper") / "run"))


def tables(run: Run, kind: str) -> dict[str, Table]:
    return {table.id: table for table in load_report(load_kind(kind)).tables(run)}


def winner(run: Run, kind: str, title: str) -> Winner:
    return next(w for w in load_report(load_kind(kind)).winners(run) if title in w.question)


def test_the_suite_has_every_ik_method_and_time_laws_of_ours() -> None:
    suite = load_suite("paper")
    assert {m.name for m in suite.of("budgets")[0].methods} == own_names("optik.ik")
    assert {m.name for m in suite.of("calls")[0].methods} == own_names("optik.ik")
    assert {m.label for m in suite.of("calls")[0].methods} == {m.label for m in suite.of("budgets")[0].methods}
    assert {law.name for law in suite.of("timing")[0].laws} <= own_names(
        "planners.timing"
    )  # a new law need not be in the demo


@pytest.mark.parametrize("block", ["workspace", "random", "damping", "step"])
def test_rates_and_medians_are_what_the_files_hold(run: Run, block: str) -> None:
    found = plain_demo.rates(run.folder.path, block)
    shown = {str(row["label"]): row for row in tables(run, "budgets")[f"budgets-{block}"].rows}
    assert set(shown) == set(found)
    for label, expect in found.items():
        plain_demo.check_figures(shown[label], expect)


def test_the_default_and_the_paper_s_iteration_are_counted_on_the_same_targets(run: Run) -> None:
    pair, labels = pairs(run)[0], [PAPER, ATTEMPT, WHOLE]
    assert list(pair.labels) == labels
    given = plain_demo.given_to_all(plain_demo.block(run.folder.path, "workspace"), labels)
    assert len({tuple(part["problem"]) for part in given.values()}) == 1
    for label in labels[1:]:
        mine, other = (plain_demo.solved(given[m], 1e-6) for m in (label, PAPER))
        expect = [int(x.sum()) for x in (mine & other, mine & ~other, other & ~mine, ~mine & ~other)]
        test = pair.against_paper(label)
        assert [test.both, test.first, test.second, test.neither] == expect
    times = plain_demo.call_medians(run.folder.path, labels)
    for label in labels:
        assert pair.times(run)[label] == pytest.approx(times[label])
        assert pair.solved(label).mean() == pytest.approx(plain_demo.solved(given[label], 1e-6).mean())


def test_the_winner_solves_most_of_the_targets_that_all_were_given(run: Run) -> None:
    w = winner(run, "budgets", "Graph paper")
    assert "ipopt (8)" in w.note
    labels = [entry[0] for entry in w.entries]
    given = plain_demo.given_to_all(plain_demo.block(run.folder.path, "workspace"), labels)
    shares = {m: 100 * plain_demo.solved(part, 1e-6).mean() for m, part in given.items()}
    for label, value, low, high in w.entries:
        assert value == pytest.approx(shares[label])
        hits = round(value * len(given[label]["problem"]) / 100)
        assert (low, high) == pytest.approx(100 * np.array(plain_demo.wilson(hits, len(given[label]["problem"]))))
    assert shares[w.entries[0][0]] == max(shares.values())


def test_the_fastest_law_is_the_shortest_of_those_that_keep_every_limit(run: Run) -> None:
    found = plain_demo.durations(run.folder.path)
    w = winner(run, "timing", "line")
    assert [(label, value) for label, value, _, _ in w.entries] == sorted(
        ((law, end) for law, (end, keeps) in found.items() if keeps), key=lambda entry: entry[1]
    )
    shown: Any = {row["label"]: row for row in tables(run, "timing")["laws"].rows}
    assert {law: row["duration"] for law, row in shown.items()} == {law: end for law, (end, _) in found.items()}
    assert {law for law, row in shown.items() if row["broken"] == "none"} == {
        law for law, (_, keeps) in found.items() if keeps
    }


def test_figures_of_the_claims_are_what_the_files_hold(run: Run) -> None:
    path = run.folder.path
    found = {f.key: f for f in judge_claims(run.folder)}
    share, missed, median = plain_demo.claim_a(path)
    assert f"{share:.1f} % of" in found["a"].summary
    assert re.search(rf"\b{missed}\b.*\b{median:.0f} mm", found["a"].summary)
    assert f"rank correlation {plain_demo.claim_b(path):.2f}" in found["b"].summary
    shown = dict(found["c"].figures)
    for method in (PAPER, "dls λ=0.1", "dls α=0.25"):
        words = [
            "{} R² {:.2f} ~d^{:.2f}".format(name, *plain_demo.claim_c(path, method, 1, column))
            for column, name in (("error_x", "X"), ("error_y", "Y"), ("error_z", "Z"), ("position_error", "distance"))
        ]
        assert shown[f"{method}, 1 iteration"] == ", ".join(words)
    middle, worst = plain_demo.claim_d(path, "0 ≤ σ < 0.01", "λ=0.001")
    assert f"a median of {middle:.2f} and a 95th percentile of {worst:.1f} with λ=0.001" in found["d"].summary


def test_a_method_as_it_comes_has_one_row_a_problem(run: Run) -> None:
    rows = run.folder.rows("budgets", "workspace")
    for label in (WHOLE, "closed_form"):
        part = rows.filter(rows["method"] == label)
        assert part["problem"].is_unique().all()
        assert set(part["budget"]) == {100}
        assert part.filter(part["known"])["status"].unique().to_list() == ["solved"]


def test_errors_of_every_method_at_a_budget_are_judged_inside_the_limits(run: Run) -> None:
    rows = run.folder.rows("budgets", "workspace")
    ended_outside = rows.filter((rows["status"] == "outside_limits") & (rows["budget"] == 100))
    for problem, method in ended_outside.select("problem", "method").iter_rows():
        near = rows.filter((rows["problem"] == problem) & (rows["method"] == method) & (rows["position_error"] < 1e-3))
        assert "solved" not in set(near["status"])
        assert set(near.filter(near["rotation_error"] < 1e-3)["status"]) <= {"outside_limits"}


def test_the_page_names_the_paper_and_links_what_answers_it(run: Run, tmp_path: Path) -> None:
    text = write_report(RunFolder(run.folder.path)).read_text(encoding="utf-8")
    assert PAPER_TITLE in text
    for row in COUNTERPARTS:
        assert not row.anchor or f'<section id="{row.anchor}"' in text, row
    for figure in ("(Fig. 5)", "(Fig. 6)", "Fig. 10", "(Fig. 11)", "(Fig. 12)", "(Fig. 13)"):
        assert figure in text
    assert text.index('<section id="default"') < text.index('<section id="budgets"')
