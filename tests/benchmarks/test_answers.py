"""Recorded answers: each judged by its own pose, the same for any part and order, and summed up without being read whole."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from benchmarks.blocks.base import Entry, Part, load_kind
from benchmarks.blocks.contest import trial_seed
from benchmarks.blocks.ik.answers import AnswersWork, distribution, solved_by_all, summary
from benchmarks.problems.near_start import near_start
from benchmarks.records import RunFolder
from benchmarks.report.base import Run, load_report
from benchmarks.run import run_suite
from benchmarks.statistics import mcnemar_p, wilson
from benchmarks.suite import Suite, load_suite, suite_of
from optik import load
from optik.errors import InvalidInput
from optik.ik import make_solver
from tests.benchmarks.test_report import page_of

BLOCK: dict[str, Any] = {
    "id": "arm", "robot": "paper6r", "set": "near_start", "count": 2500, "part": 700, "options": {"spreads": [1.5]},
    "methods": [
        {"solver": "dls", "label": "dls <weak>", "options": {"damping": 0.3, "max_restarts": 0, "max_iterations": 12}},
        {"solver": "lm", "options": {"max_restarts": 0}, "max_problems": 1200},
    ],
    "targets": [{"measure": "success at 1e−6", "method": "lm", "at_least": 50.0}],
}  # fmt: skip

RANDOM_METHOD = '''
"""Draws its answer: from NumPy's global generator, from Python's, and from its own."""
import random
import numpy as np
from optik.ik import IKSolver, IKStatus
from optik.ik.base import Attempt

class Guess(IKSolver):
    """Guesses."""
    takes_tasks = False
    def __init__(self, robot, **options):
        super().__init__(robot, **options)
        self.reseed(0)
    def reseed(self, number):
        self.rng = np.random.default_rng(number)
    def attempt(self, target, start, trace, time_limit):
        lower, upper = self.robot.limits.lower, self.robot.limits.upper
        share = (np.random.rand() + random.random() + self.rng.random()) / 3
        return Attempt(lower + share * (upper - lower), IKStatus.STALLED, 1)

METHOD = Guess
'''


def suite(**changes: Any) -> Suite:
    block = {key: value for key, value in (BLOCK | changes).items() if value is not None}
    return suite_of("answers", {"seed": 5, "answers": [block]})


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return run_suite(suite(), tmp_path_factory.mktemp("answers") / "run")


def test_the_first_problems_are_recorded_by_their_hash_and_a_run_does_not_continue_with_others(
    done: RunFolder, tmp_path: Path
) -> None:
    first = near_start(load("paper6r"), trial_seed(5, 0, "problems"), spreads=[1.5], count=1000)
    assert done.read_json("problems/arm.json") == {
        "sha256": first.sha256, "problems": 2500, "sha256_of": "the first 1,000"
    }  # fmt: skip
    assert f"2,500, SHA-256 {first.sha256[:16]}… (of the first 1,000)" in page_of(done).text
    shutil.copytree(done.path, tmp_path / "run")
    other = RunFolder(tmp_path / "run")
    other.write_json("problems/arm.json", {"sha256": "0" * 64})
    with pytest.raises(InvalidInput, match="as when the run began"):
        run_suite(suite(), other.path)


def parts(of: Suite, folder: Path) -> list[Part]:
    kind, block = next(of.pairs())
    folder.mkdir(exist_ok=True)
    return list(kind.parts(block, kind.prepare(block, of.seed), RunFolder(folder)))


def table(folder: RunFolder) -> pl.DataFrame:
    rows = folder.rows("answers", "arm")
    return rows.sort("method", "problem").drop("seconds", "block")


def test_every_problem_has_a_row_of_every_method(done: RunFolder) -> None:
    rows = table(done)
    assert rows.filter(pl.col("method") == "dls <weak>")["problem"].to_list() == list(range(2500))
    assert rows.filter(pl.col("method") == "lm")["problem"].to_list() == list(range(1200))


def test_rows_do_not_depend_on_the_size_or_the_order_of_parts(done: RunFolder, tmp_path: Path) -> None:
    assert_frame_equal(table(run_suite(suite(part=1100), tmp_path / "other")), table(done), check_exact=True)
    backwards = [part.work.solve() for part in reversed(parts(suite(part=333), tmp_path))]
    assert_frame_equal(
        pl.concat(backwards).sort("method", "problem").drop("seconds"),
        table(done),
        check_exact=True,
        check_column_order=False,
    )


def test_an_answer_is_that_of_a_single_call_judged_by_its_own_pose(done: RunFolder) -> None:
    robot = load("paper6r")
    solver = make_solver(robot, "lm", max_restarts=0)
    drawn = near_start(robot, trial_seed(5, 1, "problems"), count=1000, spreads=[1.5])
    rows = table(done).filter(pl.col("method") == "lm")
    for problem in (1000, 1003, 1199):
        row = rows.row(problem, named=True)
        target, start = drawn.targets[problem - 1000], drawn.starts[problem - 1000]
        answer = solver.solve(target, start)
        pose = robot.fk(answer.q)
        assert row["position_error"] == pytest.approx(np.linalg.norm(pose[:3, 3] - target[:3, 3]), rel=1e-6, abs=1e-15)
        angle = np.linalg.norm(pose[:3, :3] - target[:3, :3]) / np.sqrt(2)  # 2 sin(angle/2)
        if angle < 1e-3:
            assert row["rotation_error"] == pytest.approx(angle, rel=1e-3, abs=1e-12)
        assert row["solved"] == bool(answer)
        assert (row["iterations"], row["restarts"], row["status"]) == (
            answer.iterations,
            answer.restarts,
            str(answer.status),
        )
        assert row["distance"] == pytest.approx(np.linalg.norm(robot.fk(start)[:3, 3] - target[:3, 3]), rel=1e-6)


def test_the_summary_is_what_numpy_computes(done: RunFolder) -> None:
    kind, block = next(suite().pairs())
    found = kind.rows(done, block)
    measures = {m.key: m for m in kind.block.measures}
    for label, count in (("dls <weak>", 2500), ("lm", 1200)):
        rows, row = table(done).filter(pl.col("method") == label), found.filter(pl.col("method") == label)
        e = np.maximum(rows["position_error"].to_numpy(), rows["rotation_error"].to_numpy())
        for name, tolerance in (("1e−3", 1e-3), ("1e−6", 1e-6), ("1e−9", 1e-9)):
            good = int(((e <= tolerance) & rows["inside"].to_numpy()).sum())
            low, high = wilson(good, count)
            assert measures[f"success at {name}"].of(row) == (100 * good / count, 100 * low, 100 * high)
        wanted = 1e3 * np.quantile(rows["position_error"].to_numpy().astype(float), (0.5, 0.95, 0.99))
        assert measures["position error"].value(row) == pytest.approx(wanted[0], rel=1e-5)
        found_here = [1e3 * row[f"position {name}"][0] for name in ("median", "p95", "p99")]
        np.testing.assert_allclose(found_here, wanted, rtol=1e-5)
    spread = distribution(done.scan(done.part_names("answers", "arm"))).filter(pl.col("method") == "lm")
    inside = table(done).filter((pl.col("method") == "lm") & pl.col("inside"))["position_error"].to_numpy()
    for upper, so_far in zip(spread["upper"], np.cumsum(spread["count"].to_numpy()), strict=True):
        assert so_far == (np.maximum(inside, 1e-16) <= upper * (1 + 1e-6)).sum()


def test_the_page_has_a_table_and_a_plot(done: RunFolder) -> None:
    page = page_of(done)
    assert "answers" in page.anchors
    assert "dls <weak>" in page.text
    assert "1 of 1 targets met" in page.text
    kind = load_kind("answers")
    (shown,) = load_report(kind).tables(Run(done))
    assert [row["label"] for row in shown.rows] == ["dls <weak>", "lm"]
    assert all(set(row) >= {column.key for column in shown.columns} for row in shown.rows)
    (best,) = load_report(kind).winners(Run(done))
    assert best.entries[0][0] == "lm"
    solved = solved_by_all(done.scan(done.part_names("answers", "arm")), ["dls <weak>", "lm"])
    good = pl.col("inside") & (pl.max_horizontal("position_error", "rotation_error") <= 1e-6)
    both = table(done).filter(pl.col("problem") < 1200).sort("problem")
    for label, found in solved.items():
        assert found.tolist() == both.filter(pl.col("method") == label).select(good).to_series().to_list()
    only = [int((x & ~y).sum()) for x, y in itertools.permutations((solved["lm"], solved["dls <weak>"]))]
    assert best.tied == (("lm",) if mcnemar_p(*only) < 0.05 else ("lm", "dls <weak>"))
    assert best.note == "the same 1,200 problems for all"


def test_random_numbers_are_keyed_by_problem_method_and_trial(tmp_path: Path) -> None:
    file = tmp_path / "guess.py"
    file.write_text(RANDOM_METHOD)
    method = {"solver": str(file), "label": "guess", "options": {"max_restarts": 0}}
    whole, small = (suite(count=60, part=part, methods=[method], targets=None) for part in (60, 7))
    one, other = (
        pl.concat([p.work.solve() for p in reversed(parts(s, tmp_path))]).sort("problem") for s in (whole, small)
    )
    assert_frame_equal(one.drop("seconds"), other.drop("seconds"), check_exact=True)
    assert one["position_error"].n_unique() == 60
    relabelled = suite(count=60, part=60, methods=[method | {"label": "another"}], targets=None)
    third = parts(relabelled, tmp_path / "relabelled")[0].work.solve()
    assert (third["position_error"] != one["position_error"]).all()
    keys = [(0, 1, "a", 0), (0, 0, "a", 1), (1, 0, "a", 0), (0, 0, "b", 0), (0, 0, "a", 0)]
    assert len({trial_seed(*key) for key in keys}) == 5
    assert trial_seed(0, 0, "a", 0) == 1236197208, "the same in every version and on every machine"


def test_rows_of_a_crash_fit_beside_the_others(tmp_path: Path) -> None:
    work = parts(suite(), tmp_path)[0].work
    assert isinstance(work, AnswersWork)
    first, second = work.halves()
    assert (first.numbers, second.numbers) == (range(350), range(350, 700))
    rows = pl.concat([first.solve(), second.crashed()])
    assert rows["problem"].to_list() == list(range(700))
    row = summary(rows.lazy())
    assert row["crashed"].item() == 350
    assert (
        row["at 1e-3"].item()
        == rows.filter((pl.col("position_error") <= 1e-3) & (pl.col("rotation_error") <= 1e-3)).height
    )
    assert len(work.halves()[0].halves()[0].numbers) == 175
    single = AnswersWork("paper6r", "near_start", {}, 0, Entry("lm", "lm", {}), ("lm",), range(3, 4))
    assert single.halves() == ()


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"options": {"count": 5}}, "key `count`"), ({"count": 0}, "count"), ({"part": "x"}, "part"),
        ({"options": {"spreads": [0.1, 0.2]}}, "gave 2000"), ({"set": "graph_paper", "options": {}}, "graph_paper|count|start"),
        ({"methods": []}, "methods"),
    ],
)  # fmt: skip
def test_wrong_settings_are_named_and_nothing_is_written(changes: dict[str, Any], word: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=word):
        run_suite(suite(**changes), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_the_kind_is_found_by_its_key(tmp_path: Path) -> None:
    file = tmp_path / "suite.toml"
    file.write_text(
        '[[answers]]\nid = "a"\nrobot = "ur5e"\nset = "near_start"\ncount = 10\nmethods = [{ solver = "lm" }]\n'
    )
    assert load_suite(str(file)).kinds == (load_kind("answers"),)
