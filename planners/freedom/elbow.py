"""Elbow of an arm with more than six joints: the motion in its null space, which leaves the tool where it is."""

from planners.freedom.base import Freedom


class Elbow(Freedom):
    """Null-space coordinates w · q of a redundant arm, with w the null vectors of its Jacobian in the mean of the path.

    Bounds are on the distance from the coordinates of the initial joint path.
    """

    name = "elbow"


METHOD = Elbow
