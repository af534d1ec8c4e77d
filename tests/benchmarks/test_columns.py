"""Columns: their computations against values by hand, with missing values and without rows, and the table of groups."""

import math
from typing import Any

import polars as pl
import pytest

from benchmarks.blocks import block
from benchmarks.blocks.block import Column, count, largest, mean, median, median_with_range, quantile, share
from benchmarks.report.tables import table_of
from benchmarks.statistics import wilson

ROWS = pl.DataFrame(
    {"ms": [4.0, None, 1.0, 3.0], "good": [True, False, None, True], "late": [True, True, False, False]}
)
LATE, SLOW = pl.col("late"), pl.col("ms") > 2.0


@pytest.mark.parametrize(
    ("of", "value"),
    [
        (median("ms"), 3.0),
        (median("ms", 1e3, among=~LATE), 2000.0),
        (mean("ms"), 8.0 / 3.0),
        (mean("good", 100.0), 200.0 / 3.0),
        (largest("ms", 10.0, among=LATE), 40.0),
        (largest("ms", among=pl.col("ms") > 5.0), None),
        (quantile("ms", 0.25, 1e3), 2000.0),
        (quantile(lambda rows: rows["ms"].drop_nulls().to_numpy() / 2.0, 1.0), 2.0),
        (median_with_range("ms"), (3.0, 1.0, 4.0)),
        (count("good"), 2),
        (count(SLOW), 2),
        (share("good", among=LATE), (50.0, *(100.0 * end for end in wilson(1, 2)))),
        (share("good", among=pl.col("ms") > 3.5), (100.0, *(100.0 * end for end in wilson(1, 1)))),
        (share("good", among=pl.col("ms") > 5.0), None),
    ],
)
def test_a_computation_counts_what_is_there(of: Any, value: Any) -> None:
    assert of(ROWS) == (value if value is None else pytest.approx(value))


def test_the_value_of_a_measure_is_a_number() -> None:
    assert Column("a", "a", of=block.median_with_interval("ms")).value(ROWS) == 3.0
    assert math.isnan(Column("a", "a", of=largest("ms")).value(ROWS.clear()))
    assert math.isnan(Column("a", "a").value(ROWS))
    assert Column("a", "a", of=lambda rows, one, to: len(one) - len(to), relative=True).value(ROWS, "abc", "a") == 2.0


def test_a_table_has_what_is_given_and_what_is_computed_where_there_are_rows() -> None:
    columns = [Column("label", "Method"), Column("most", "longest", "ms", of=largest("ms"))]
    table = table_of("x", "X", iter(columns), [({"label": "a"}, ROWS), ({"label": "b", "most": "absent"}, None)])
    assert table.rows == ({"label": "a", "most": 4.0}, {"label": "b", "most": "absent"})
    assert table.columns == tuple(columns)
