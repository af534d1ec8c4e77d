"""Limit on the tilt of an open container: the angle between its axis and the direction opposite to the apparent gravity."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

from optik.check import check_number
from optik.errors import InvalidInput
from planners.limits._specific_force import TiltLimit
from planners.limits.record import Record, check_place


@dataclass(frozen=True)
class OpenContainer(Record):
    """A container that must not spill.

    Parameters
    ----------
    angle : float
        Greatest angle between the container's axis and the direction opposite to the apparent gravity [rad].
    axis : (3,) or str
        The axis that points up, in the tool's frame; or a name such as ``"-z"``.
    com : (3,) array, optional
        The point at which the acceleration counts, in the tool's frame [m]; by default the payload's centre of mass, or the
        tool's point.
    """

    angle: float = field(metadata={"unit": "rad"})
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    com: tuple[float, float, float] | None = field(default=None, metadata={"unit": "m"})

    def __post_init__(self) -> None:
        expected = "an angle above 0 and below π/2 [rad]"
        object.__setattr__(self, "angle", check_number(self.angle, "open_container.angle", expected, above=0.0))
        if not self.angle < 1.5707:
            raise InvalidInput(
                "open_container.angle", f"{self.angle:.6g}", expected, advice="np.deg2rad converts degrees"
            )
        check_place(self, "open_container")

    @property
    def largest_angle(self) -> float:
        """The greatest angle [rad]."""
        return self.angle

    def scaled(self, factor: float) -> OpenContainer:
        """Return the container with its angle multiplied by a factor.

        Parameters
        ----------
        factor : float
            The factor [1].

        Returns
        -------
        OpenContainer
        """
        return replace(self, angle=factor * self.angle)


class OpenContainerLimit(TiltLimit):
    """The surface of the content stays within the spill angle, if it follows the apparent gravity at once.

    It is quasi-static: a liquid that swings reaches more.
    """

    name: ClassVar[str] = "open_container"
    record: ClassVar[Any] = OpenContainer


METHOD = OpenContainerLimit
