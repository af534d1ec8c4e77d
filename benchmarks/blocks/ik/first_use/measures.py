"""Measures of first use: medians over fresh processes."""

from __future__ import annotations

import numpy as np
import polars as pl

from benchmarks.targets import Measure


def median(rows: pl.DataFrame) -> float:
    """Median over processes."""
    return float(np.median(rows["seconds"].to_numpy())) if len(rows) else float("nan")


MEASURES = (
    Measure("import_s", "s", median, "import optik"),
    Measure("first_solve_s", "s", median, "first solve after import, cached code"),
    Measure("compile_s", "s", median, "first solve after import, with compilation"),
)
"""What a target of first use may ask for: medians over fresh processes."""
