"""Cells that several sections share: values of measures, and targets with their outcomes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from benchmarks.report.numbers import number, percent
from benchmarks.targets import Measure, Outcome

VERDICTS = {True: ("met", "good"), False: ("missed", "bad"), None: ("not measured", "none")}
"""Words and look of an outcome."""


def cells(measure: Measure, values: Sequence[float]) -> list[str]:
    """Return the values of a measure as tables show them."""
    if measure.show == "share":
        value, low, high = values
        return [percent(value), "–" if math.isnan(low) else f"[{low:.1f}, {high:.1f}]"]
    if measure.show == "count":
        return [f"{v:.0f}" if v == round(v, 0) else number(v) for v in values]
    if measure.show == "exact":
        return [number(v) if math.isnan(v) else f"{v:.7g}" for v in values]
    return [number(v) for v in values]


def target_row(o: Outcome) -> dict[str, Any]:
    """Return a target and its outcome as tables show them."""
    words, look = VERDICTS[o.held]
    if o.target.goal:
        words += " (a goal)"
        look = "partly" if o.held is False else look
    value = cells(o.measure, [o.value])[0] if o.measure.show == "exact" else number(o.value)
    return {
        "where": o.where, "what": o.what, "value": value, "asked": o.asked, "unit": o.unit, "words": words, "look": look,
        "note": o.note, "number": o.value,
    }  # fmt: skip
