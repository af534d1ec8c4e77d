"""The data of an arm: joints, limits, base, tool, gravity, masses and shapes; their checks and modified copies."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from optik import dynamics, se3
from optik.arm.inertia import STANDARD_GRAVITY, Inertia, Load, Payload, arm_loads, payload_masses
from optik.arm.limits import JointLimits, freeze
from optik.arm.linkage import Linkage
from optik.arm.motors import Motors, couple, find_outside, maker_joints, with_motors
from optik.arm.shapes.model import PAYLOAD, Shapes
from optik.check import check_flag, check_keywords, check_kind, check_number, check_words, format_value, real_array
from optik.errors import AssumptionWarning, InvalidInput, RobotModelError
from optik.kinematics import Chain
from optik.types import Array, Flags

UNIT_LENGTH = 1e-14
"""A gravity vector whose length differs from 1 by less [1] is kept to the last bit, so that a copy of an arm equals it."""


@dataclass(frozen=True, eq=False)
class ArmModel:
    """The data of a serial arm, whose joints turn about or slide along their z axes."""

    name: str
    fixed: Array
    prismatic: Flags
    tool: Array
    limits: JointLimits
    joint_names: tuple[str, ...] = ()
    gravity: Array = (0.0, 0.0, -1.0)  # type: ignore[assignment]
    source: str = ""
    gravity_magnitude: float = STANDARD_GRAVITY
    inertia: Inertia | None = None
    payload: Payload | None = None
    shapes: Shapes | None = None
    motors: Motors | None = None
    linkage: Linkage | None = None

    def __post_init__(self) -> None:
        for field in ("name", "source"):
            check_kind(getattr(self, field), field, str, "a string")
        check_kind(self.limits, "limits", JointLimits, "JointLimits(lower, upper)")
        fixed = _check_fixed(self.name, self.fixed)
        links, n = len(fixed), len(fixed)
        if self.linkage is not None:
            if not isinstance(self.linkage, Linkage) or len(self.linkage.names) != links or self.motors is not None:
                raise InvalidInput("linkage", repr(self.linkage)[:60], f"a Linkage of {links} axes, without motors")
            n = self.linkage.matrix.shape[1]
        if self.limits.lower.size != n:
            raise RobotModelError(self.name, f"{n} joints but limits for {self.limits.lower.size}")
        checked = {
            "fixed": fixed,
            "prismatic": _check_prismatic(self.name, self.prismatic, n),
            "tool": freeze(se3.nearest_pose(se3.check_pose(self.tool, "tool")), "tool"),
            "joint_names": _check_names(self.name, self.joint_names, n),
            "gravity": _check_gravity(self.name, self.gravity),
            "gravity_magnitude": check_number(
                self.gravity_magnitude, "gravity_magnitude", "an acceleration ≥ 0 [m/s²]", least=0.0
            ),
            "shapes": _check_shapes(self.name, self.shapes, links),
        }
        _check_masses(self.name, self.inertia, self.payload, links)
        if self.motors is not None and not (isinstance(self.motors, Motors) and len(self.motors.names) == n):
            raise InvalidInput("motors", repr(self.motors)[:60], f"Motors of {n} joints")
        if self.motors is not None or hasattr(self.limits, "motors"):
            checked["limits"] = couple(self.limits, self.motors)
        for field, value in checked.items():
            object.__setattr__(self, field, value)
        if self.shapes is not None and not self.shapes.names:
            names = tuple(self.link_names[i] for i in self.shapes.capsules[0].tolist())
            object.__setattr__(self, "shapes", replace(self.shapes, names=names))

    # ------------------------------------------------------------ identity

    @cached_property
    def _content(self) -> bytes:
        digest = hashlib.sha256(repr((self.name, self.joint_names)).encode())
        lim = self.limits
        for array in (self.fixed, self.prismatic, self.tool, self.gravity, lim.lower, lim.upper):
            digest.update(array.tobytes())
        for limit in (lim.velocity, lim.acceleration, lim.jerk):
            digest.update(b"-" if limit is None else limit.tobytes())
        # Only what is known, so that fingerprints of arms without it do not change.
        later: dict[str, Any] = {name: getattr(lim, name) for name in ("torque", "torque_rate", "deceleration")}
        gravity = None if self.gravity_magnitude == STANDARD_GRAVITY else repr(self.gravity_magnitude).encode()
        later |= {"velocity_by_position": lim.velocity_by_position, "gravity": gravity}
        later |= {name: getattr(self, name) for name in ("inertia", "payload", "motors", "linkage")}
        for name, part in later.items():
            if part is not None:
                part = part.tobytes() if isinstance(part, np.ndarray) else getattr(part, "content", part)
                digest.update(name.encode() + part)
        if self.shapes is not None:
            digest.update(self.shapes.content)
        return digest.digest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ArmModel) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(self._arguments().values())

    def _arguments(self) -> dict[str, Any]:
        """Return the constructor's arguments by name."""
        return {field.name: getattr(self, field.name) for field in fields(ArmModel)}

    @property
    def fingerprint(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of the content, equal on all machines."""
        return self._content.hex()[:16]

    @cached_property
    def chain(self) -> Chain:
        """The arm as kernels take it: (fixed, prismatic, tool)."""
        if (follow := self.linkage) is None:
            return self.fixed, self.prismatic, self.tool
        relations = freeze(np.stack([follow.joint, follow.factor, follow.offset], axis=1), "linkage")
        return self.fixed, follow.prismatic, self.tool, relations

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.prismatic.shape[0])

    @cached_property
    def axes(self) -> Self:
        """The arm whose joints are the axes of the chain: of a linkage one without relations, else the arm itself."""
        if (follow := self.linkage) is None:
            return self
        limits = follow.limit_axes(self.limits)
        given: dict[str, Any] = {"prismatic": follow.prismatic, "joint_names": follow.names, "limits": limits}
        return replace(self, **given, linkage=None)

    @cached_property
    def turning(self) -> Flags:
        """Joints (n,) whose whole turns leave all links in place [1]."""
        return ~self.prismatic if self.linkage is None else self.linkage.turning

    def spread(self, q: Array, order: int = 0) -> Array:
        """Return the values (..., N) of the axes of the chain, or their derivatives, from those of the joints (..., n)."""
        return q if self.linkage is None else self.linkage.spread(q, order)

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """Names (n + 1) of the links: "base", then the names of the joints that move them, of a linkage of its axes."""
        base, names = "base", self.joint_names if self.linkage is None else self.linkage.names
        while base in names:
            base += "_"
        return base, *names

    def configuration(self, q: ArrayLike, argument: str = "q", *, batch: bool = False) -> Array:
        """Check configurations; return them as a float64 array."""
        array = real_array(q, argument, f"{self.n} joint values")
        if array.ndim == 0 or array.shape[-1] != self.n or (array.ndim > 1 and not batch):
            wanted = f"shape ({self.n},) or (..., {self.n})" if batch else f"shape ({self.n},)"
            raise InvalidInput(argument, f"shape {np.shape(q)}", f"joint values of {wanted} for {self.name}")
        if not np.isfinite(array).all():
            raise InvalidInput(argument, "NaN or infinity", "finite joint values")
        return array

    # ------------------------------------------------------------ copies

    def with_base(self, base: ArrayLike) -> Self:
        """Return the arm mounted at a pose of a new base frame: new.fk(q) = base @ self.fk(q).

        The transform multiplies the present base. Gravity keeps its physical direction and is expressed in the new base
        frame.
        """
        T = se3.check_pose(base, "base")
        fixed = np.array(self.fixed)
        fixed[0] = T @ fixed[0]
        shapes = None if self.shapes is None else self.shapes.transform_part(0, T)
        return replace(self, fixed=fixed, gravity=T[:3, :3] @ self.gravity, shapes=shapes)

    @check_keywords
    def with_tool(self, tool: ArrayLike, *, add: bool = False) -> Self:
        """Return the arm with another tool."""
        T = se3.check_pose(tool, "tool")
        new = self.tool @ T if check_flag(add, "add") else T
        shapes = self.shapes
        if shapes is not None and PAYLOAD in shapes.names:
            shapes = shapes.transform_part(PAYLOAD, new @ se3.inverse(self.tool))
        return replace(self, tool=new, shapes=shapes)

    def with_limits(self, limits: JointLimits | None = None, **fields: ArrayLike | None) -> Self:
        """Return the arm with other limits."""
        new = self.limits if limits is None else limits
        check_kind(new, "limits", JointLimits, "JointLimits(lower, upper)")
        return replace(self, limits=new.replace(**fields) if fields else new)

    def with_motors(
        self, matrix: ArrayLike, *, offset: ArrayLike | None = None, names: Sequence[str] | None = None
    ) -> Self:
        """Return the arm whose axes are coupled to motors, q = matrix m + offset.

        The present limits, rotor inertias and frictions become those of the motors.

        Parameters
        ----------
        matrix : (n, n) array
            Axes over motors [1].
        offset : (n,) array, optional
            Axes with all motors at 0 [rad, m]; by default 0.
        names : sequence of str, optional
            Names of the motors; by default motor1 and so on.

        Returns
        -------
        Robot
            Its `limits` are those of the axes that the motors imply; `motors.of` and `motors.axes` convert.

        Raises
        ------
        InvalidInput
            A singular matrix, or wrong lengths.
        """
        return with_motors(self, matrix, offset, names)  # type: ignore[no-any-return]

    def with_shapes(self, shapes: Shapes | None) -> Self:
        """Return the arm with other shapes."""
        return replace(self, shapes=shapes)


# ---------------------------------------------------------------- checks


def _check_fixed(name: str, value: ArrayLike) -> Array:
    """Check the transforms between the joints (n, 4, 4); return each with the nearest rotation."""
    fixed = freeze(value, "fixed")
    n = fixed.shape[0] if fixed.ndim == 3 else 0
    if fixed.shape != (n, 4, 4) or n == 0:
        raise RobotModelError(name, f"fixed transforms of shape {fixed.shape}, expected (n, 4, 4)")
    for i in range(n):
        try:
            se3.check_pose(fixed[i], f"joint {i + 1}")
        except InvalidInput as error:
            raise RobotModelError(name, str(error)) from None
    return freeze([se3.nearest_pose(T) for T in fixed], "fixed")


def _check_prismatic(name: str, value: ArrayLike, n: int) -> Flags:
    given = np.asarray(value, dtype=object)
    if given.shape != (n,):
        raise RobotModelError(name, f"prismatic has shape {given.shape}, expected ({n},)")
    prismatic = np.array([check_flag(slides, f"prismatic[{i}]") for i, slides in enumerate(given)])
    prismatic.setflags(write=False)
    return prismatic


def _check_names(name: str, value: Iterable[str], n: int) -> tuple[str, ...]:
    joint_names = check_words(value, "joint_names") or tuple(f"joint{i + 1}" for i in range(n))
    if len(joint_names) != n or len(set(joint_names)) != n:
        raise RobotModelError(name, f"{n} joints need {n} different names, got {joint_names}")
    return joint_names


def _check_masses(name: str, inertia: Inertia | None, payload: Payload | None, n: int) -> None:
    check_kind(inertia, "inertia", Inertia | None, "Inertia(mass, com, tensor)")
    check_kind(payload, "payload", Payload | None, "Payload(mass, com, inertia)")
    if inertia is not None and inertia.mass.size != n:
        raise RobotModelError(name, f"{n} joints but masses of {inertia.mass.size} links")
    if payload is not None and inertia is None:
        raise RobotModelError(name, f"a payload of {payload}, but the masses of the arm are unknown; see with_inertia")


def _check_shapes(name: str, value: Shapes | None, n: int) -> Shapes | None:
    if value is None:
        return None
    check_kind(value, "shapes", Shapes, "Shapes(capsules)")
    if (last := int(value.capsules[0].max(initial=0))) > n:
        raise RobotModelError(name, f"a capsule on link {last}, but the last link is {n}")
    return value


def _check_gravity(name: str, value: ArrayLike) -> Array:
    """Check the direction of gravity (3,); return it with length 1."""
    gravity = freeze(value, "gravity")
    if gravity.shape != (3,) or not np.isfinite(gravity).all() or not gravity.any():
        raise RobotModelError(name, f"gravity is {format_value(value)}, not a direction (3,)")
    norm = float(np.linalg.norm(gravity))
    if not 0.0 < norm < np.inf:  # the squares overflow or vanish
        gravity = gravity / np.abs(gravity).max()
        norm = float(np.linalg.norm(gravity))
    return gravity if abs(norm - 1.0) <= UNIT_LENGTH else freeze(gravity / norm, "gravity")


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

    @check_keywords
    def with_payload(
        self, mass: float | tuple[float, float] | None, com: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None, shapes: Sequence[Any] | None = None,
    ) -> Self:  # fmt: skip
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
        return self.shapes.with_part(PAYLOAD, len(self.fixed), payload, self.tool)

    @cached_property
    def loads(self) -> tuple[Load, ...]:
        """Masses, friction and gravity of the arm with its payload, as kernels take them.

        One load, or two for an interval of payload masses: the lightest and the heaviest. Torques are affine in the
        payload's mass, so the extreme torques of the interval are those of its ends.
        """
        if self.inertia is None:
            wanted = "an arm with masses: with_inertia(...), or a file that states them"
            raise InvalidInput("robot", f"{self.name!r}, whose masses are unknown", wanted)
        loads = arm_loads(self.inertia, self.payload, self.tool, self.gravity_magnitude * self.gravity)
        if self.linkage is None:
            return loads
        return tuple(self.linkage.join_friction(load) for load in loads)

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


def unit_factors(arm: ArmModel) -> Array:
    """Return the factors (n,) that convert joint values from rad to degrees, and from m to mm, as text shows them."""
    return np.where(arm.prismatic, 1000.0, 180.0 / np.pi)


def unit_names(arm: ArmModel) -> list[str]:
    """Return the units of the joints in text."""
    return [" mm" if slides else "°" for slides in arm.prismatic]


def check_range(arm: ArmModel, q: Array, name: str) -> Array:
    """Return typed joints if they are inside their ranges; warn of angles that look like radians."""
    if not arm.limits.contains(q):
        which, value, lower, upper, i = find_outside(arm, q)
        scale, unit = unit_factors(arm)[i], unit_names(arm)[i]
        room = f"within [{lower * scale:g}, {upper * scale:g}]{unit}, its range"
        raise InvalidInput(name, f"{which} = {value * scale:g}{unit}", f"{which} {room}")
    typed = np.rad2deg(maker_joints(arm, q))[..., ~arm.prismatic]
    if (np.abs(typed) <= 2.0 * np.pi).all() and (np.abs(typed - np.round(typed)) > 1e-6).any():
        words = f"{name}: angles of at most {np.abs(typed).max():.3g}° are read as degrees; are these radians?"
        warnings.warn(words, AssumptionWarning, stacklevel=3)
    return q
