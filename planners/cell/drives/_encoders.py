"""Detection of encoders whose readings do not change while their set-points move."""

from __future__ import annotations

import numpy as np

from optik.types import Array


class Unmoved:
    """The time for which each joint's reading has been bit-identical, and how far its set-point moved since then."""

    def __init__(self) -> None:
        self._read = self._low = self._high = self._since = np.array(np.nan)

    def moved(self, read: Array, asked: Array, t: float) -> Array:
        """Return how far each set-point moved since the reading of its joint last changed (n,) [rad, m]."""
        fresh = read != self._read  # NaN always counts as a new reading
        self._read = read.copy()
        self._since = np.where(fresh, t, self._since)
        self._low = np.where(fresh, asked, np.minimum(self._low, asked))
        self._high = np.where(fresh, asked, np.maximum(self._high, asked))
        moved: Array = self._high - self._low
        return moved

    def seconds(self, t: float) -> Array:
        """Return for how long each reading has been the same (n,) [s], at a time [s]."""
        seconds: Array = t - self._since
        return seconds
