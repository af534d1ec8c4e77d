"""Worst values of a motion over its limits: what the judgement of a limit returns."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from optik.types import Array


class Extreme(NamedTuple):
    """Exact worst absolute value of each joint (n,), its ratio to the limit (n,), and its time [s] (n,)."""

    value: Array
    ratio: Array
    time: Array

    def worst(self, names: tuple[str, ...]) -> tuple[float, str, float]:
        """Return the worst ratio, its joint and its time; NaN and an empty name where no joint is limited."""
        if np.isnan(self.ratio).all():
            return float("nan"), "", float("nan")
        i = int(np.nanargmax(self.ratio))
        return float(self.ratio[i]), names[i], float(self.time[i])

    def to_dict(self) -> dict[str, Any]:
        """Plain data for files: lists of n numbers, None for infinite and undefined ones."""
        return {k: plain(v) for k, v in self._asdict().items()}


class ToolExtreme(NamedTuple):
    """Proved bound on a value of the whole arm, its ratio to the limit (NaN without one), and when it is nearly reached [s]."""

    value: float
    ratio: float
    time: float

    def worst(self, names: tuple[str, ...]) -> tuple[float, str, float]:
        """Return the ratio, what is limited, and the time."""
        return self.ratio, names[0], self.time

    def to_dict(self) -> dict[str, Any]:
        """Plain data for files; None for a ratio that is infinite or undefined."""
        return {"value": self.value, "ratio": self.ratio if np.isfinite(self.ratio) else None, "time": self.time}


def plain(values: Array) -> list[float | None]:
    """List of numbers that JSON can hold."""
    return [float(v) if np.isfinite(v) else None for v in values]
