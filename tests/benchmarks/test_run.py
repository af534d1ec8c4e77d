"""A run is whole, repeatable for any number of workers, can be continued, and its rows are what really happened."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from benchmarks.blocks.base import load_kind
from benchmarks.blocks.budgets import at_budgets
from benchmarks.problems.base import ProblemSet
from benchmarks.records import RunFolder, slug
from benchmarks.run import run_suite
from benchmarks.suite import load_suite
from optik import load
from optik.arm.robot import Robot
from optik.errors import InvalidInput, OutputError
from optik.ik import make_solver
from tests.benchmarks.conftest import SMALL, small


def test_a_finished_run_says_so_and_can_be_repeated(small_run: RunFolder) -> None:
    manifest = small_run.manifest()
    assert manifest["complete"] is True
    assert manifest["settings"] == SMALL
    assert manifest["provenance"]["versions"]["numpy"] == np.__version__
    assert manifest["command"].startswith("optik bench run")


def test_rows_hold_every_problem_method_and_budget(small_run: RunFolder) -> None:
    rows = small_run.rows("budgets", "workspace")
    assert rows.filter(pl.col("method") == "dls λ=0.01").height == 49 * 4
    assert rows.filter(pl.col("method") == "ipopt").height == 6 * 4
    assert rows.select("method", "problem", "budget").is_duplicated().sum() == 0


def test_what_a_method_solves_does_not_change_what_is_known(copied: RunFolder) -> None:
    problems = copied.read("problems/workspace.parquet")
    copied.write("problems/workspace.parquet", problems.with_columns(known=pl.col("problem") == 0))
    rows = copied.rows("budgets", "workspace")
    assert set(rows.filter(pl.col("known"))["problem"]) == {0}
    assert rows.filter(~pl.col("known") & (pl.col("status") == "solved")).height > 0, "a method solved another"


def test_errors_at_a_budget_are_those_of_a_run_stopped_there(small_run: RunFolder) -> None:
    rows = small_run.rows("budgets", "workspace")
    problems = small_run.read("problems/workspace.parquet")
    robot = load("paper6r")
    for row in rows.sample(40, seed=1).iter_rows(named=True):
        options = {"damping": 0.01} if row["solver"] == "dls" else {}
        solver = make_solver(robot, row["solver"], max_iterations=row["budget"], **options)
        problem = problems.filter(pl.col("problem") == row["problem"]).row(0, named=True)
        result = solver.solve(np.array(problem["target"]).reshape(4, 4), problem["start"], trace=True)
        assert result.iterations == row["iterations"]
        np.testing.assert_allclose(
            result.trace[-1][:3], [row["error_x"], row["error_y"], row["error_z"]], rtol=0, atol=1e-12
        )
        assert np.linalg.norm(result.trace[-1][3:]) == pytest.approx(row["rotation_error"], abs=1e-12)
        assert str(result.status) == row["status"]


def test_the_row_of_a_budget_counts_rises_and_the_peak() -> None:
    robot = load("paper6r")
    solver = make_solver(robot, "dls", max_iterations=30)
    q = np.deg2rad([20.0, -35, 40, 25, 50, -30])
    result = solver.solve(robot.fk(q + 0.8), q, trace=True)
    size = [float(np.linalg.norm(e)) for e in result.trace]
    row = at_budgets(result, (2, 6))
    assert row["peak"] == pytest.approx([max(size[:3]) / size[0], max(size[:7]) / size[0]])
    assert row["rises"].tolist() == [sum(b > a for a, b in pairwise(size[: k + 1])) for k in (2, 6)]


def test_answers_are_the_same_for_any_number_of_workers(small_run: RunFolder, tmp_path: Path) -> None:
    two = run_suite(small(timing=[LINE | {"laws": [{"law": "ruckig"}]}]), tmp_path / "two", workers=2)
    for block in ("workspace", "misprint"):
        one, other = small_run.rows("budgets", block), two.rows("budgets", block)
        assert_frame_equal(one, other, check_exact=True)


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(OutputError, match="something else"):
        run_suite(small(), tmp_path)
    with pytest.raises(OutputError, match="file"):
        run_suite(small(), tmp_path / "thesis.tex")
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_folder_of_other_settings_is_left_alone(small_run: RunFolder) -> None:
    before = (small_run.path / "run.json").read_text()
    with pytest.raises(OutputError, match="other settings"):
        run_suite(small(seed=8), small_run.path)
    assert (small_run.path / "run.json").read_text() == before


GRID, NEAR = SMALL["budgets"]
(LINE,) = SMALL["timing"]
(MOVE,) = LINE["lines"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"budgets": [GRID | {"options": GRID["options"] | {"spacing_m": 0}}]}, "spacing_m"),
        ({"budgets": [NEAR | {"options": {"count": "x"}}]}, "count"),
        ({"budgets": [NEAR | {"options": {"counts": 3}}]}, "counts"),
        ({"budgets": [NEAR | {"methods": [{"solver": "dls", "options": {"dampening": 0.1}}]}]}, "dampening"),
        (
            {"timing": [LINE | {"lines": [MOVE | {"robot": "puma560", "start_deg": [0, 45, -180, 0, 45, 0]}]}]},
            "velocity",
        ),
        ({"timing": [LINE | {"lines": [MOVE | {"move_m": [0.0, 0.0, 0.0]}]}]}, "move_m"),
    ],
)
def test_nothing_is_written_where_a_method_a_set_or_the_line_cannot_be_made(
    changes: dict[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInput, match=words):
        run_suite(small(**changes), tmp_path / "run")
    assert not (tmp_path / "run").exists()


@cache
def graph_paper() -> tuple[Robot, ProblemSet]:
    return load_suite("paper").of("budgets")[0].draw(0)


def test_ik_rows_without_their_problems_are_said(copied: RunFolder) -> None:
    (copied.path / "problems" / "workspace.parquet").unlink()
    with pytest.raises(InvalidInput, match="workspace"):
        load_kind("budgets").rows(copied, small().of("budgets")[0])


def test_a_manifest_that_lacks_something_is_no_run(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text('{"format": "optik-run/4"}')
    with pytest.raises(InvalidInput, match="run"):
        RunFolder(tmp_path).manifest()


@pytest.mark.parametrize("block", load_suite("paper").of("budgets"), ids=lambda b: b.id)
def test_problem_sets_of_the_paper_suite_are_what_they_say(block: Any) -> None:
    robot, problems = block.draw(2026)
    assert isinstance(problems, ProblemSet)
    again = block.draw(2026)[1]
    np.testing.assert_array_equal(problems.targets, again.targets)
    np.testing.assert_array_equal(problems.starts, again.starts)
    assert robot.limits.contains(problems.starts).all()
    assert np.isfinite(problems.sigma[problems.known]).all()
    assert np.isnan(problems.sigma[~problems.known]).all()


def test_graph_paper_keeps_the_orientation_and_lies_on_its_planes_and_no_target_on_two() -> None:
    robot, problems = graph_paper()
    assert len(np.unique(problems.targets[:, :3, 3].round(6), axis=0)) == len(problems)
    T0 = robot.fk(problems.starts[0])
    assert (problems.targets[:, :3, :3] == T0[:3, :3]).all()
    offset = problems.targets[:, :3, 3] - T0[:3, 3]
    on_y = np.array([g.startswith("X–Z") for g in problems.group])
    for axis, on in ((1, on_y), (2, ~on_y)):
        np.testing.assert_allclose(np.unique(offset[on, axis].round(9)), [-0.2, -0.1, 0.0, 0.1, 0.2])


def test_a_smaller_choice_of_problems_is_part_of_a_larger_one() -> None:
    _, problems = graph_paper()
    few, more, all_of_them = (problems.chosen(most) for most in (50, 1000, None))
    assert set(few) < set(more) < set(all_of_them)
    assert len(few) == 50
    assert problems.known[more].all()
    np.testing.assert_array_equal(all_of_them, np.arange(len(problems)))


def test_slugs_spell_greek_and_keep_labels_apart() -> None:
    assert slug("dls λ=0.01") == "dls-lambda-0.01"
    assert slug("α=0.25") != slug("α=0.5")


def test_a_damaged_json_file_is_named(copied: RunFolder) -> None:
    (copied.path / "rows/timing/line.json").write_text("[")
    with pytest.raises(InvalidInput, match="damaged"):
        copied.read_json("rows/timing/line.json")
