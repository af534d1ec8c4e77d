"""Curve: what a path, a joint path and a trajectory have in common, an interval [0, end] and ``curve(x, order)``."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from optik.errors import InvalidInput
from optik.types import Array


class Curve(ABC):
    """A function of one parameter in [0, end], with derivatives."""

    parameter = "x"
    highest_order = 3

    @property
    @abstractmethod
    def end(self) -> float:
        """Upper end of the interval; the lower one is 0."""

    @abstractmethod
    def _evaluate(self, x: Array, order: int) -> Array:
        """Values (k, ...) of the derivative at x (k,), which lies in the interval."""

    def __call__(self, x: ArrayLike, order: int = 0) -> Array:
        """Value or derivative.

        Parameters
        ----------
        x : scalar or (k,) array
            In [0, end]; rounding beyond the ends is forgiven.
        order : int
            0 for the value, 1 to 3 for derivatives.

        Returns
        -------
        array
            One value for a scalar x, or k of them stacked along the first axis.

        Raises
        ------
        InvalidInput
            x outside the interval or not finite, or another order.
        """
        if order not in range(self.highest_order + 1):
            raise InvalidInput("order", repr(order), f"0 to {self.highest_order}")
        try:
            at = np.asarray(x, dtype=np.float64)
        except (TypeError, ValueError):
            raise InvalidInput(self.parameter, repr(x)[:60], "a number or an array of numbers") from None
        if at.ndim > 1:
            raise InvalidInput(self.parameter, f"shape {at.shape}", "a scalar or a one-dimensional array")
        slack = 1e-9 * max(self.end, 1e-9)
        if at.size and not ((at >= -slack) & (at <= self.end + slack)).all():
            wrong = at.ravel()[np.argmax(~((at.ravel() >= -slack) & (at.ravel() <= self.end + slack)))]
            raise InvalidInput(self.parameter, f"{wrong:.9g}", f"values in [0, {self.end:.9g}]")
        values = self._evaluate(np.atleast_1d(np.clip(at, 0.0, self.end)), order)
        return values[0] if at.ndim == 0 else values
