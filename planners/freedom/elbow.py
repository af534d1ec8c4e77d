"""Elbow of an arm with more than six joints: the motion in its null space, which leaves the tool where it is."""

from typing import Any

from optik.errors import InvalidInput
from planners.freedom.base import Bounds, Freedom


class Elbow(Freedom):
    """Null-space coordinates w · q of a redundant arm, with w the null vectors of its Jacobian in the mean of the path.

    Bounds are on the distance from the coordinates of the initial joint path, which is 0 at first.
    """

    name = "elbow"

    def check(self, value: Any) -> Bounds:  # noqa: D102
        low, high = super().check(value)
        if not low <= 0.0 <= high:
            expected = "a pair with lower ≤ 0 ≤ upper: 0 is the initial joint path"
            raise InvalidInput(self.name, f"({low:g}, {high:g})", expected)
        return low, high


METHOD = Elbow
