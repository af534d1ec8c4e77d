"""Torques of an arm whose masses are known."""

from __future__ import annotations

from functools import cached_property

from optik.arm.inertia import Load, arm_loads
from optik.arm.model import ArmModel
from optik.errors import InvalidInput


class ArmDynamics(ArmModel):
    """An arm's data with what follows from its masses; the part of `optik.Robot` that concerns torques."""

    @cached_property
    def loads(self) -> tuple[Load, ...]:
        """What the joints move, payload and gravity included, as compiled kernels take it.

        One load, or two for a payload whose mass is an interval: the lightest and the heaviest. Torques are affine in the
        payload's mass, so no mass between them needs more torque than both.

        Raises
        ------
        InvalidInput
            The masses of the arm are unknown.
        """
        if self.inertia is None:
            wanted = "an arm with masses: with_inertia(...), or a file that states them"
            raise InvalidInput("robot", f"{self.name!r}, whose masses are unknown", wanted)
        return arm_loads(self.inertia, self.payload, self.tool, self.gravity_magnitude * self.gravity)
