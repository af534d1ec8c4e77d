"""Tilt of the tool's axis z within a cone about the given one."""

from planners.freedom.base import Freedom


class Tilt(Freedom):
    """Tilt of the tool's axis z: a turn about x by α, then about y by β.

    The axis stays in the cone of half-angle r while α² + β² ≤ r², since cos α cos β ≥ cos √(α² + β²).
    """

    name = "tilt"
    screws = ((0.0, 0.0, 0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 1.0, 0.0))
    round = True


METHOD = Tilt
