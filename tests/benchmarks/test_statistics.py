"""Statistics against formulas written out, and against SciPy."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Sequence

import numpy as np
import polars as pl
import pytest
from scipy.stats import binomtest

from benchmarks import statistics
from benchmarks.blocks.budgets import succeeded, success
from benchmarks.blocks.entries import shared
from benchmarks.report.budgets import METHOD_COLUMNS
from benchmarks.statistics import median_interval, quantiles, ratio_interval, shifted_geometric_mean, signed_rank
from tests.seeds import shift_seed


@pytest.mark.parametrize(("k", "n"), [(0, 1), (1, 1), (0, 250), (219, 250), (250, 250), (3, 7)])
def test_wilson_is_scipys(k: int, n: int) -> None:
    for confidence in (0.95, 0.99):
        expected = binomtest(k, n).proportion_ci(confidence, method="wilson")
        assert statistics.wilson(k, n, confidence) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_wilson_of_nothing_is_undefined() -> None:
    assert all(math.isnan(x) for x in statistics.wilson(0, 0))


def test_quantiles_interpolate_between_order_statistics() -> None:
    assert quantiles([4.0, 1.0, 3.0, 2.0], (0.0, 0.5, 0.95, 1.0)) == pytest.approx((1.0, 2.5, 3.85, 4.0))
    assert all(math.isnan(x) for x in quantiles([], (0.5, 0.95)))


def test_binned_quantiles_are_those_of_each_bin() -> None:
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0.0, 500.0, 400), rng.lognormal(size=400)
    table = statistics.binned(pl.DataFrame({"x": x, "y": y}), "x", "y", width=50.0, least=10)
    assert table["count"].sum() == 400
    for row in table.iter_rows(named=True):
        inside = y[np.abs(x - row["middle"]) <= 25.0]
        assert row["count"] == len(inside)
        assert (row["q0.5"], row["q0.95"]) == pytest.approx(tuple(np.quantile(inside, [0.5, 0.95])))


def test_bins_with_few_rows_are_left_out() -> None:
    rows = pl.DataFrame({"x": [1.0] * 10 + [11.0] * 9, "y": [1.0] * 19})
    assert statistics.binned(rows, "x", "y", width=10.0, least=10)["middle"].to_list() == [5.0]


def test_a_shifted_geometric_mean_is_the_root_of_a_product() -> None:
    assert shifted_geometric_mean([1.0, 9.0, 99.0], 1.0) == pytest.approx((2 * 10 * 100) ** (1 / 3) - 1)
    assert shifted_geometric_mean([5.0], 10.0) == pytest.approx(5.0)
    assert math.isnan(shifted_geometric_mean([], 1.0))


@pytest.mark.parametrize(("only_a", "only_b"), [(0, 0), (1, 0), (6, 1), (3, 12), (8, 8), (0, 30)])
def test_mcnemar_is_the_sum_of_binomial_terms_no_more_likely(only_a: int, only_b: int) -> None:
    a = [True] * 5 + [True] * only_a + [False] * only_b + [False] * 4
    b = [True] * 5 + [False] * only_a + [True] * only_b + [False] * 4
    found = statistics.mcnemar(a, b)
    assert (found.both, found.first, found.second, found.neither) == (5, only_a, only_b, 4)
    n = only_a + only_b
    terms = [math.comb(n, k) for k in range(n + 1)]
    assert found.p == pytest.approx(sum(t for t in terms if t <= terms[only_a]) / 2**n)


def test_mcnemar_of_a_published_example() -> None:
    # Agresti, Categorical Data Analysis (1990), table 10.1: approval ratings 794, 150, 86, 570
    a = np.repeat([True, True, False, False], [794, 150, 86, 570])
    b = np.repeat([True, False, True, False], [794, 150, 86, 570])
    assert statistics.mcnemar(a, b).p == pytest.approx(3.7e-5, rel=0.1)


def signs_counted(differences: Sequence[float]) -> float:
    """p-value of the signed-rank test by all 2^n choices of signs."""
    size = np.abs(differences)
    ranks = np.array([(size < d).sum() + ((size == d).sum() + 1) / 2 for d in size])
    seen = abs(float(np.sign(differences) @ ranks))
    sums = [abs(float(np.array(signs) @ ranks)) for signs in itertools.product((-1, 1), repeat=len(ranks))]
    return float(np.mean(np.array(sums) >= seen - 1e-9))


@pytest.mark.parametrize("seed", range(3))
def test_the_signed_rank_test_is_that_of_all_signs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y = rng.lognormal(size=(2, 11))
    assert signed_rank(x, y) == pytest.approx(signs_counted(np.log(x / y)))
    assert signed_rank(1e3 * x, 1e3 * y) == pytest.approx(signed_rank(x, y))


def test_ties_of_the_best_are_decided_problem_by_problem_where_intervals_overlap() -> None:
    solved = {
        "best": np.arange(100) < 92,
        "nested": np.arange(100) < 84,  # 8 against 0: p = 0.008, although the Wilson intervals overlap
        "crossed": (np.arange(100) >= 10) & (np.arange(100) < 98),  # 10 against 6
    }
    p_values = {label: statistics.mcnemar(solved["best"], x).p for label, x in solved.items() if label != "best"}
    assert statistics.not_told_apart("best", p_values) == ("best", "crossed")


def test_ties_of_the_shortest_are_decided_in_pairs() -> None:
    base = np.geomspace(1.0, 100.0, 20)
    wobble = np.where(np.arange(20) % 2, 1.1, 0.9)
    times = {"same": base * wobble, "best": base, "longer": 1.01 * base, "fails": np.where(base > 2, np.inf, base)}
    assert statistics.not_longer("best", times) == ("best", "same")
    assert statistics.not_longer("longer", times) == (
        "longer",
        "same",
        "best",
    )  # what is shorter is not shown to be longer
    assert signed_rank(times["fails"], times["fails"]) == 1.0


def test_a_signed_rank_test_without_differences_or_pairs() -> None:
    assert signed_rank([1.0, 2.0], [1.0, 2.0]) == 1.0
    assert math.isnan(signed_rank([], []))


def test_holm_is_the_closed_test_of_bonferroni() -> None:
    rng = np.random.default_rng(4)
    p = rng.uniform(0.0, 0.3, 5)
    sets = [c for k in range(1, 6) for c in itertools.combinations(range(5), k)]
    closed = [max(min(1.0, len(c) * min(p[j] for j in c)) for c in sets if i in c) for i in range(5)]
    assert statistics.holm(list(p)) == pytest.approx(closed)
    with_nan = statistics.holm([p[0], float("nan"), p[1]])
    assert with_nan[::2] == pytest.approx(statistics.holm([p[0], p[1]]))
    assert math.isnan(with_nan[1])


def resampled(x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
    """Ratios of medians of pairs that were drawn again, one after another."""
    rng = np.random.default_rng(99)
    picked = [rng.integers(len(x), size=len(x)) for _ in range(count)]
    return np.array([sorted(x[i])[len(x) // 2] / sorted(y[i])[len(x) // 2] for i in picked])


def test_a_bootstrap_interval_is_that_of_a_plain_loop() -> None:
    rng = np.random.default_rng(shift_seed(6))
    x = rng.lognormal(size=301)
    y = x * rng.lognormal(0.5, 0.3, size=301)
    plain = np.quantile(resampled(x, y, 3000), [0.025, 0.975])
    value, low, high = ratio_interval(x, y)
    assert value == pytest.approx(np.median(x) / np.median(y))
    assert (low, high) == pytest.approx(tuple(plain), rel=0.03)
    assert low < value < high
    assert ratio_interval(x, y) == ratio_interval(x.copy(), y.copy())
    single = median_interval(x)
    alone = np.quantile(resampled(x, np.ones_like(x), 3000), [0.025, 0.975])
    assert single[1:] == pytest.approx(tuple(alone), rel=0.05)


def test_a_bootstrap_interval_covers_the_median_as_often_as_it_says() -> None:
    rng = np.random.default_rng(shift_seed(8))
    held = [low <= 1.0 <= high for _, low, high in (median_interval(rng.lognormal(size=40)) for _ in range(60))]
    assert 0.85 <= np.mean(held) <= 1.0


def test_intervals_of_failures_of_few_and_of_many_values() -> None:
    assert median_interval([1.0, 2.0, np.inf]) == (2.0, 1.0, np.inf)
    assert median_interval([3.0])[0] == 3.0
    assert math.isnan(median_interval([3.0])[1])
    assert all(math.isnan(v) for v in (*median_interval([]), *ratio_interval([], [])))
    many = np.random.default_rng(1).lognormal(size=20_000)
    value, low, high = median_interval(many)
    assert value == np.median(many)
    assert low < value < high
    assert high - low == pytest.approx(2 * 1.96 * 1.2533 / math.sqrt(2000), rel=0.2)  # of the part that was drawn


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
    assert sorted(set(shared(rows)["problem"])) == [1]


def test_metrics_of_no_rows_are_undefined() -> None:
    schema = {"position_error": float, "rotation_error": float, "status": str, "iterations": int}
    found = [column.of(pl.DataFrame(schema=schema)) for column in METHOD_COLUMNS if column.of is not None]
    assert len(found) == 8
    assert all(value is None or math.isnan(value) for value in found)


def test_quantiles_of_infinite_values_are_finite_below_them_and_infinite_from_there() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert quantiles([1.0, 2.0, math.inf], (0.0, 0.5, 0.75, 1.0)) == (1.0, 2.0, math.inf, math.inf)
        assert quantiles([math.inf, math.inf], (0.5, 0.95)) == (math.inf, math.inf)
