"""Statistics of a comparison: summaries, intervals, paired tests and performance profiles."""

from __future__ import annotations

from benchmarks.statistics.intervals import median_interval, percentage, ratio_interval, wilson
from benchmarks.statistics.paired import (
    SIGNIFICANT,
    McNemar,
    holm,
    is_too_few,
    mcnemar,
    mcnemar_p,
    not_beaten,
    not_longer,
    not_told_apart,
    signed_rank,
)
from benchmarks.statistics.summaries import binned, performance_profile, quantiles, shifted_geometric_mean

__all__ = [
    "SIGNIFICANT", "McNemar", "binned", "holm", "is_too_few", "mcnemar", "mcnemar_p", "median_interval", "not_beaten",
    "not_longer", "not_told_apart", "percentage", "performance_profile", "quantiles", "ratio_interval",
    "shifted_geometric_mean", "signed_rank", "wilson",
]  # fmt: skip
