"""Claims and misprints are judged from rows; a verdict follows the data and its rule, and can go either way."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from benchmarks.experiments.base import FAILS, HOLDS, PARTLY, UNTESTED
from benchmarks.experiments.claims import CLAIMS, judge
from benchmarks.experiments.misprints import evidence
from benchmarks.experiments.workspace import fit, linear, linear_error, more_iterations, within_two_millimetres
from benchmarks.records import RunFolder


class Rows(RunFolder):
    """A run folder whose one block is given."""

    def __init__(self, frame: pl.DataFrame) -> None:
        super().__init__("nowhere")
        self.frame = frame

    def rows(self, block: str) -> pl.DataFrame | None:
        return self.frame if block == "workspace" else None


def made(error_of_distance: object, iterations_of_distance: object = lambda d: 3 + (20 * d).astype(int)) -> Rows:
    rng = np.random.default_rng(0)
    d = rng.uniform(0.02, 0.6, 600)
    error = error_of_distance(d)  # type: ignore[operator]
    direction = np.abs(rng.normal(size=(600, 3))) + 0.5
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    columns = {f"error_{axis}": error * direction[:, i] for i, axis in enumerate("xyz")}
    frame = pl.DataFrame(
        {
            **columns,
            "position_error": error,
            "rotation_error": 0.0 * error,
            "distance": d,
            "budget": 5,
            "status": np.where(error < 1e-3, "solved", "max_iterations"),
            "iterations": iterations_of_distance(d),  # type: ignore[operator]
            "method": "dls",
            "solver": "dls",
            "method_index": 0,
            "known": True,
        }
    )
    return Rows(frame)


def test_claim_c_holds_for_a_linear_error_and_not_for_a_quadratic_one() -> None:
    assert linear_error(made(lambda d: 0.3 * d)).verdict == HOLDS
    assert linear_error(made(lambda d: 0.3 * d**2)).verdict == FAILS


def test_claim_a_holds_partly_where_far_targets_fail() -> None:
    assert within_two_millimetres(made(lambda d: 0.001 * np.ones_like(d))).verdict == HOLDS
    assert within_two_millimetres(made(lambda d: 0.1 * np.ones_like(d))).verdict == FAILS
    partly = within_two_millimetres(made(lambda d: np.where(d < 0.3, 1e-7, 0.2)))
    assert partly.verdict.startswith(PARTLY)
    assert "within 30" in partly.verdict or "within 29" in partly.verdict


def test_claim_b_follows_the_rank_correlation() -> None:
    near = lambda d: 1e-7 * np.ones_like(d)  # noqa: E731
    assert more_iterations(made(near)).verdict == HOLDS
    assert more_iterations(made(near, lambda d: (50 - 40 * d).astype(int))).verdict == FAILS


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_a_power_law_is_recovered(power: float) -> None:
    d = np.random.default_rng(1).uniform(0.05, 0.5, 500)
    f = fit(d, 0.2 * d**power)
    assert f.exponent == pytest.approx(power, abs=0.05)
    columns = ("error_x", "error_y", "error_z", "position_error")
    assert linear(dict.fromkeys(columns, f)) == (power == 1.0)


def test_every_claim_is_judged_once_and_what_is_not_there_is_not_tested(small_run: RunFolder) -> None:
    findings = {f.key: f for f in judge(small_run)}
    assert list(findings) == ["a", "b", "c", "d", "e", "f", "g"]
    assert len(CLAIMS) == 7
    assert findings["d"].verdict == findings["e"].verdict == UNTESTED
    assert findings["g"].verdict == HOLDS
    assert findings["f"].verdict.startswith(PARTLY)
    assert all(f.rule and f.summary for f in findings.values())


def test_the_evidence_on_eq_9_counts_the_run_s_rows(small_run: RunFolder) -> None:
    rows = small_run.rows("misprint")
    assert rows is not None
    last = rows.filter(pl.col("budget") == 100)
    solved = last.filter((pl.col("method") == "corrected") & (pl.col("status") == "solved")).height
    text = next(m.evidence for m in evidence(small_run) if m.place == "Eq. 9")
    assert "as printed: 0 of 40 solved" in text
    assert f"corrected: {solved} of 40 solved" in text


def test_every_misprint_of_the_notes_has_evidence_with_figures(small_run: RunFolder) -> None:
    places = [m.place for m in evidence(small_run)]
    assert places == ["Table 1", "Eq. 5", "Eq. 9", "Eq. 6 and 12", "Eq. 14", "Eq. 16"]
    assert all(any(c.isdigit() for c in m.evidence) for m in evidence(small_run))
