"""Dynamics of an arm: masses, payload and torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from optik import dynamics
from optik.arm.inertia import Inertia, Load, Payload, arm_loads, payload_masses
from optik.arm.model import ArmModel
from optik.arm.shapes.model import PAYLOAD, Shapes
from optik.errors import InvalidInput
from optik.types import Array


class ArmDynamics(ArmModel):
    """An arm with masses: the part of `optik.Robot` for dynamics."""

    def with_gravity(self, direction: ArrayLike | None = None, magnitude: float | None = None) -> Self:
        """Return the arm under another gravity."""
        changes: dict[str, Any] = {"gravity": direction, "gravity_magnitude": magnitude}
        return replace(self, **{name: value for name, value in changes.items() if value is not None})

    def with_inertia(self, inertia: Inertia | None = None, **fields: ArrayLike | str) -> Self:
        """Return the arm with other masses."""
        new = self.inertia if inertia is None else inertia
        if not isinstance(new, Inertia):
            got = repr(inertia)[:60] if inertia is not None else f"none for {self.name!r}, whose masses are unknown"
            raise InvalidInput("inertia", got, "Inertia(mass, com, tensor)")
        return replace(self, inertia=new.replace(**fields) if fields else new)

    def with_payload(
        self,
        mass: float | tuple[float, float] | None,
        com: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None,
        shapes: Sequence[Any] | None = None,
    ) -> Self:
        """Return the arm with a rigid body in its tool, which replaces the present payload.

        The body is fixed in the tool's frame and moves with it, also in `with_tool`.
        """
        if mass is None or payload_masses(mass)[1] == 0.0:
            return replace(self, payload=None, shapes=self._replace_payload_shapes(None))
        changes: dict[str, Any] = {"mass": mass, "com": com, "inertia": inertia}
        return replace(self, payload=Payload(**changes), shapes=self._replace_payload_shapes(shapes))

    def _replace_payload_shapes(self, payload: Sequence[Any] | None) -> Shapes | None:
        """Return the arm's shapes with the payload's shapes replaced."""
        if payload is None:
            carries = self.shapes is not None and PAYLOAD in self.shapes.names
            return self.shapes.without_part(PAYLOAD) if self.shapes is not None and carries else self.shapes
        if self.shapes is None:
            wanted = "an arm with shapes, for a payload with shapes: with_shapes(...)"
            raise InvalidInput("robot", f"{self.name!r}, which has none", wanted)
        return self.shapes.with_part(PAYLOAD, self.n, payload, self.tool)

    @cached_property
    def loads(self) -> tuple[Load, ...]:
        """Masses, friction and gravity of the arm with its payload, as kernels take them.

        One load, or two for an interval of payload masses: the lightest and the heaviest. Torques are affine in the
        payload's mass, so the extreme torques of the interval are those of its ends.
        """
        if self.inertia is None:
            wanted = "an arm with masses: with_inertia(...), or a file that states them"
            raise InvalidInput("robot", f"{self.name!r}, whose masses are unknown", wanted)
        return arm_loads(self.inertia, self.payload, self.tool, self.gravity_magnitude * self.gravity)

    def torques(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Return the joint torques of a motion (inverse dynamics), with payload and friction.

        Coulomb friction is f·sign(q̇), and 0 at rest.
        """
        load = self._load("torques")
        given = {"q": q, "dq": dq, "ddq": ddq}
        parts = [self.configuration(value, name, batch=True) for name, value in given.items()]
        try:
            shape = np.broadcast_shapes(*(part.shape for part in parts))
        except ValueError:
            got = ", ".join(f"{name} {part.shape}" for name, part in zip(given, parts, strict=True))
            raise InvalidInput("q, dq, ddq", f"shapes {got}", "shapes that broadcast to one") from None
        states = np.stack([np.broadcast_to(part, shape) for part in parts], axis=-2)
        out = np.empty(shape)
        friction = (load.viscous, load.coulomb)
        dynamics.joint_torques(
            self.chain, load.bodies, friction, states.reshape(-1, 3, self.n), out.reshape(-1, self.n)
        )
        return out

    def gravity_torques(self, q: ArrayLike) -> Array:
        """Return the joint torques at rest under gravity, with payload."""
        rest = np.zeros(self.n)
        return self.torques(q, rest, rest)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Return the mass matrices M of torque = M q̈ + …, with payload and the motors' inertia on the diagonal."""
        load, q = self._load("mass_matrix"), self.configuration(q, batch=True)
        out = np.empty((*q.shape, self.n))
        dynamics.mass_matrices(self.chain, load.bodies, q.reshape(-1, self.n), out.reshape(-1, self.n, self.n))
        return out

    def _load(self, asked: str) -> Load:
        """Return the only load; raise InvalidInput for an interval of payload masses."""
        if len(self.loads) == 1:
            return self.loads[0]
        heaviest = self.payload.masses[-1] if self.payload is not None else 0.0
        wanted = f"one mass, such as robot.with_payload({heaviest:g}).{asked}(...)"
        raise InvalidInput("payload", f"an interval, {self.payload}", wanted)
