"""Base class of the freedoms of a path: their screws, units and bounds."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from optik.check import check_number
from optik.errors import InvalidInput
from optik.tables import warn_of_assumptions

Bounds = tuple[float, float]
"""Least and greatest value of each coordinate of a freedom; the greatest is the radius of a disc for `Freedom.round`."""


class Freedom:
    """Base of a freedom: coordinates along a path that the planner may choose.

    A freedom is a subclass in a file of its own in this folder, named by ``METHOD``; the file's stem is its ``name``. Each
    coordinate moves the tool along a screw that is fixed in the tool's frame, after the freedoms that are given before it.

    Attributes
    ----------
    name : str
        Name of the freedom's module, its keyword in `planners.free`.
    unit : {"rad", "m"}
        Unit of its coordinates.
    screws : tuple of 6 numbers each
        Twist (v, ω) of the tool by a unit of each coordinate, in the tool's frame, with |ω| 1 or 0; empty for coordinates in
        the null space of an arm with more than six joints, which do not move the tool.
    round : bool
        Whether the bound is on the norm of the coordinates, not on each.
    """

    name: ClassVar[str]
    unit: ClassVar[str] = "rad"
    screws: ClassVar[tuple[tuple[float, ...], ...]] = ()
    round: ClassVar[bool] = False

    def check(self, value: Any) -> Bounds:
        """Return the bounds of the coordinates from the value that a user gives.

        Parameters
        ----------
        value : float, pair of float, or True
            x for [−x, x], (lower, upper), or no bounds [as `unit`]; of a ``round`` freedom the greatest norm.

        Returns
        -------
        tuple of float
            Lower and upper bound [as `unit`].

        Raises
        ------
        InvalidInput
            No number above 0, no pair with lower < upper, or a pair for a ``round`` freedom.
        """
        pair = "" if self.round else ", a pair (lower, upper)"
        allowed = f"a number of {self.unit} above 0{pair}, or True"
        value = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
        if value is True:
            return -np.inf, np.inf
        if isinstance(value, tuple | list) and len(value) == 2 and not self.round:
            low, high = (check_number(x, self.name, allowed) for x in value)
            if not low < high:
                raise InvalidInput(self.name, f"({low:g}, {high:g})", "a pair (lower, upper) with lower < upper")
            return low, high
        if isinstance(value, bool | tuple | list | str) or value is None:
            raise InvalidInput(self.name, repr(value)[:60], allowed)
        most = check_number(value, self.name, allowed, above=0.0)
        if self.round and self.unit == "rad" and most > np.pi:
            raise InvalidInput(self.name, most, "at most π", unit="rad")
        if self.unit == "rad" and most > 4.0 * np.pi:
            turns = f"{most:.4g} rad is {0.5 * most / np.pi:.3g} full turns: are these degrees?"
            warn_of_assumptions(self.name, [turns], 4)
        return -most, most


METHOD_BASE = Freedom
"""Base class of the METHOD of every module here and of every plug-in."""
