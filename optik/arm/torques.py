"""An arm with masses: copies with other masses or another payload, and torques."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any, Self

from numpy.typing import ArrayLike

from optik.arm.inertia import Inertia, Load, Payload, arm_loads, payload_masses
from optik.arm.model import ArmModel
from optik.errors import InvalidInput


class ArmDynamics(ArmModel):
    """An arm's data with what follows from its masses; the part of `optik.Robot` that concerns torques."""

    def with_gravity(self, direction: ArrayLike | None = None, magnitude: float | None = None) -> Self:
        """Return the arm under another gravity.

        Parameters
        ----------
        direction : (3,) array, optional
            Direction of gravity in the base frame, of any length [1]; by default the present one.
        magnitude : float, optional
            Acceleration of free fall [m/s²], 0 without weight; by default the present one.

        Returns
        -------
        ArmModel or Robot
            The arm with everything else as it is.

        Raises
        ------
        InvalidInput
            A negative magnitude, NaN or infinity.
        RobotModelError
            No direction.
        """
        changes: dict[str, Any] = {"gravity": direction, "gravity_magnitude": magnitude}
        return replace(self, **{name: value for name, value in changes.items() if value is not None})

    def with_inertia(self, inertia: Inertia | None = None, **fields: ArrayLike | str) -> Self:
        """Return the arm with other masses.

        Parameters
        ----------
        inertia : Inertia, optional
            Masses of all links; by default the present ones.
        **fields
            Single fields of `Inertia` in place of those, such as motor, viscous and coulomb, scalars or (n,) arrays
            [kg·m², N·m·s/rad, N·m], which most files do not state. Fields that are not named stay as they are.

        Returns
        -------
        ArmModel or Robot
            The arm with the same kinematics, limits and payload.

        Raises
        ------
        InvalidInput
            A field that does not exist, values that `Inertia` refuses, or fields for an arm whose masses are unknown.
        RobotModelError
            Masses of another number of links.
        """
        new = self.inertia if inertia is None else inertia
        if not isinstance(new, Inertia):
            got = repr(inertia)[:60] if inertia is not None else f"none for {self.name!r}, whose masses are unknown"
            raise InvalidInput("inertia", got, "Inertia(mass, com, tensor)")
        return replace(self, inertia=new.replaced(**fields) if fields else new)

    def with_payload(
        self,
        mass: float | tuple[float, float] | None,
        com: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None,
    ) -> Self:
        """Return the arm with a rigid body in its tool, in place of the present payload.

        The body keeps its place in the tool's frame: a `with_tool` that moves the tool moves the payload with it.

        Parameters
        ----------
        mass : float or pair of floats, or None
            Mass [kg], or an interval (lightest, heaviest), which is planned for its worst; None or 0 for no payload.
        com : (3,) array, optional
            Centre of mass in the tool's frame [m]; by default its origin.
        inertia : (3, 3) array, optional
            Inertia about the centre of mass, in the axes of the tool's frame [kg·m²]; by default a point mass. Of an
            interval it is the inertia of the largest mass, and scales with the mass.

        Returns
        -------
        ArmModel or Robot
            The arm with the same kinematics, limits and masses.

        Raises
        ------
        InvalidInput
            Values that `Payload` refuses.
        RobotModelError
            The masses of the arm are unknown, so that torques could not count the payload.
        """
        if mass is None or payload_masses(mass)[1] == 0.0:
            return replace(self, payload=None)
        changes: dict[str, Any] = {"mass": mass, "com": com, "inertia": inertia}
        return replace(self, payload=Payload(**changes))

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
