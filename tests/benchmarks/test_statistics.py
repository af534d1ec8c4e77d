"""Statistics against formulas written out, and against SciPy."""

from __future__ import annotations

import math

import numpy as np
import polars as pl
import pytest
from scipy.stats import binomtest

from benchmarks.kinds.budgets.measures import MEASURES, paired, succeeded, success
from benchmarks.statistics import binned, quantiles, wilson


@pytest.mark.parametrize(("k", "n"), [(0, 1), (1, 1), (0, 250), (219, 250), (250, 250), (3, 7)])
def test_wilson_is_scipys(k: int, n: int) -> None:
    for confidence in (0.95, 0.99):
        expected = binomtest(k, n).proportion_ci(confidence, method="wilson")
        assert wilson(k, n, confidence) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_wilson_of_nothing_is_undefined() -> None:
    assert all(math.isnan(x) for x in wilson(0, 0))


def test_quantiles_interpolate_between_order_statistics() -> None:
    assert quantiles([4.0, 1.0, 3.0, 2.0], (0.0, 0.5, 0.95, 1.0)) == pytest.approx((1.0, 2.5, 3.85, 4.0))
    assert all(math.isnan(x) for x in quantiles([], (0.5, 0.95)))


def test_binned_quantiles_are_those_of_each_bin() -> None:
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0.0, 500.0, 400), rng.lognormal(size=400)
    table = binned(pl.DataFrame({"x": x, "y": y}), "x", "y", width=50.0, least=10)
    assert table["count"].sum() == 400
    for row in table.iter_rows(named=True):
        inside = y[np.abs(x - row["middle"]) <= 25.0]
        assert row["count"] == len(inside)
        assert (row["q0.5"], row["q0.95"]) == pytest.approx(tuple(np.quantile(inside, [0.5, 0.95])))


def test_bins_with_few_rows_are_left_out() -> None:
    rows = pl.DataFrame({"x": [1.0] * 10 + [11.0] * 9, "y": [1.0] * 19})
    assert binned(rows, "x", "y", width=10.0, least=10)["middle"].to_list() == [5.0]


def test_success_needs_both_errors_and_the_limits() -> None:
    rows = pl.DataFrame(
        {
            "position_error": [1e-7, 1e-7, 1e-2, 1e-7, 5e-4],
            "rotation_error": [1e-7, 1e-2, 1e-7, 1e-7, 5e-4],
            "status": ["solved", "stalled", "stalled", "outside_limits", "max_iterations"],
        }
    )
    assert rows.select(ok=succeeded(1e-6))["ok"].to_list() == [True, False, False, False, False]
    assert rows.select(ok=succeeded(1e-3))["ok"].to_list() == [True, False, False, False, True]
    assert success(rows, 1e-3)[0] == pytest.approx(40.0)


def test_pairs_are_the_problems_that_every_method_was_run_on() -> None:
    rows = pl.DataFrame({"problem": [0, 1, 2, 1, 2, 3, 1, 3], "method": [*"aaa", *"bbb", *"cc"]})
    assert sorted(set(paired(rows)["problem"])) == [1]


def test_metrics_of_no_rows_are_undefined() -> None:
    schema = {"position_error": float, "rotation_error": float, "status": str, "iterations": int}
    for metric in MEASURES:
        values = metric.compute(pl.DataFrame(schema=schema))
        assert len(values) == len(metric.parts)
        assert all(math.isnan(v) for v in values)
