"""Rigid bodies, and the masses of an arm and its payload: checks, and arrays for kernels."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import ByContent, freeze, replace_fields
from optik.check import check_kind, check_number, real_array
from optik.errors import InvalidInput
from optik.types import Array

FARTHEST_MASS = 5.0
"""Largest distance of a centre of mass from its frame, and largest radius of gyration [m]. The largest industrial arms
reach this far with all links; 1 cm given in millimetres already exceeds it."""
HEAVIEST = 1e4
"""Largest mass of a link or payload [kg]: the mass of the heaviest industrial arms with all links."""
TRIANGLE_SLACK = 0.1
"""Fraction by which the largest principal moment may exceed the sum of the others [1]: measured moments have such errors.
Those of the Puma's third link (Armstrong, Khatib and Burdick 1986) exceed it by 9 %."""
TENSOR_ROUNDING = 1e-6
"""Asymmetry of an inertia tensor, and negative part of its smallest moment, relative to its largest entry [1]: the
rounding errors of entries with seven digits."""
NO_INERTIA = 1e-15
"""Largest entry of an inertia tensor that counts as 0 [kg·m²]: a thousandth of that of 1 mg at 1 mm."""
Body = tuple[float, Array, Array]
"""A rigid body: mass [kg], centre of mass (3,) [m] and inertia about it (3, 3) [kg·m²], in the axes of one frame."""


def join_bodies(bodies: Iterable[Body]) -> Body:
    """Return the composition of several bodies, all in one frame."""
    heavy = [body for body in bodies if body[0] > 0.0]
    if len(heavy) == 1:
        return heavy[0]
    mass = sum(body[0] for body in heavy)
    com, tensor = np.zeros(3), np.zeros((3, 3))
    for part, centre, _about in heavy:
        com += (part / mass) * centre
    for part, centre, about in heavy:
        d = centre - com
        tensor += about + part * (d @ d * np.eye(3) - np.outer(d, d))
    return float(mass), com, tensor


def transform_body(body: Body, T: Array) -> Body:
    """Return a body in another frame, where T is the pose of the present frame."""
    mass, com, tensor = body
    R = T[:3, :3]
    turned = R @ tensor @ R.T
    return mass, R @ com + T[:3, 3], 0.5 * (turned + turned.T)


# ---------------------------------------------------------------- checks


def check_body(body: Body, where: str) -> Body:
    """Check that a body is physically possible; return it with an exactly symmetric tensor."""
    mass = check_number(float(body[0]), f"mass of {where}", "a finite mass ≥ 0 [kg]", least=0.0)
    com, tensor = body[1], body[2]
    if mass > HEAVIEST:
        raise InvalidInput(f"mass of {where}", f"{mass:.6g}", f"kilograms, at most {HEAVIEST:g}; is it in grams?")
    for what, array in (("centre of mass", com), ("inertia", tensor)):
        if not np.isfinite(array).all():
            raise InvalidInput(f"{what} of {where}", "NaN or infinity", "finite numbers")
    away = float(np.abs(com).max())
    if away > FARTHEST_MASS:
        got, wanted = f"{away:.6g} m away from its frame", f"at most {FARTHEST_MASS:g} m; is it in millimetres?"
        raise InvalidInput(f"centre of mass of {where}", got, wanted)
    return mass, com, _check_tensor(mass, tensor, where)


def _check_tensor(mass: float, tensor: Array, where: str) -> Array:
    """Check that a body of this mass can have an inertia tensor; return the exactly symmetric tensor."""
    argument, scale = f"inertia of {where}", float(np.abs(tensor).max())
    if scale < NO_INERTIA:
        return np.zeros((3, 3))
    if mass == 0.0:
        raise InvalidInput(argument, f"up to {scale:.3g} kg·m² with a mass of 0", "0 for a link without mass")
    if np.abs(tensor - tensor.T).max() > TENSOR_ROUNDING * scale:
        raise InvalidInput(argument, "a tensor that is not symmetric", "xy = yx, xz = zx and yz = zy")
    symmetric = 0.5 * (tensor + tensor.T)
    low, middle, high = (float(moment) for moment in np.linalg.eigvalsh(symmetric))
    moments = f"principal moments {low:.4g}, {middle:.4g} and {high:.4g} kg·m²"
    if low < -TENSOR_ROUNDING * scale:
        raise InvalidInput(argument, moments, "moments ≥ 0")
    if low + middle < (1.0 - TRIANGLE_SLACK) * high:
        raise InvalidInput(argument, moments, "moments, each at most the sum of the other two")
    radius = (high / mass) ** 0.5 if mass > 0.0 else 0.0
    if radius > FARTHEST_MASS:
        wanted = f"kg·m² with a radius of gyration of at most {FARTHEST_MASS:g} m; is it in kg·mm² or g·mm²?"
        raise InvalidInput(argument, f"{high:.4g}, a radius of gyration of {radius:.4g} m for {mass:.4g} kg", wanted)
    return symmetric


def check_shape(value: ArrayLike, shape: tuple[int, ...], argument: str) -> Array:
    """Check that a value is an array of a known shape, and return it."""
    return real_array(value, argument, f"numbers of shape {shape}", shape)


if TYPE_CHECKING:
    from optik.dynamics import Bodies

STANDARD_GRAVITY = 9.80665
"""Default acceleration of free fall [m/s²] (3rd CGPM, 1901)."""


class Load(NamedTuple):
    """Masses of an arm with its payload, and viscous [N·m·s/rad, N·s/m] and Coulomb friction [N·m, N], (n,), for kernels."""

    bodies: Bodies
    viscous: Array
    coulomb: Array


@dataclass(frozen=True, eq=False)
class Inertia(ByContent):
    """Masses of the links and inertia and friction of the joints of an arm.

    Link i moves with joint i; its values are given in the frame of that joint (`Robot.frames`). Two objects are equal if
    all numbers are; the source is not compared.

    Parameters
    ----------
    mass : (n,) array
        Masses [kg]; 0 for a link without mass, whose inertia is then 0 too.
    com : (n, 3) array
        Centres of mass in the joint frames [m].
    tensor : (n, 3, 3) array
        Inertia about the centres of mass, in the axes of the joint frames [kg·m²].
    motor, viscous, coulomb : scalar or (n,) array, optional
        Inertia of the motors and gears, reflected to the joints [kg·m², kg]; viscous friction [N·m·s/rad, N·s/m]; Coulomb
        friction [N·m, N].
    source : str, optional
        Source of the numbers.

    Raises
    ------
    InvalidInput
        Wrong shapes, NaN or infinity, negative numbers, a mass of 0 with an inertia, an impossible tensor (not symmetric,
        negative moments, one moment above the sum of the others), or values too large for metres and kilograms. The error
        names the link.
    """

    mass: Array
    com: Array
    tensor: Array
    motor: Array = 0.0  # type: ignore[assignment]
    viscous: Array = 0.0  # type: ignore[assignment]
    coulomb: Array = 0.0  # type: ignore[assignment]
    source: str = ""

    def __post_init__(self) -> None:
        check_kind(self.source, "inertia.source", str, "a string")
        mass = real_array(self.mass, "inertia.mass", "masses, one for each link")
        if mass.ndim != 1 or mass.size == 0:
            raise InvalidInput("inertia.mass", f"shape {mass.shape}", "masses (n,), one for each link")
        n = mass.size
        com = check_shape(self.com, (n, 3), "inertia.com")
        tensor = check_shape(self.tensor, (n, 3, 3), "inertia.tensor")
        bodies = [check_body((mass[i], com[i], tensor[i]), f"link {i + 1}") for i in range(n)]
        for field, part in (("mass", 0), ("com", 1), ("tensor", 2)):
            object.__setattr__(self, field, freeze(np.array([body[part] for body in bodies]), field))
        for field in ("motor", "viscous", "coulomb"):
            object.__setattr__(self, field, _per_joint(getattr(self, field), n, f"inertia.{field}"))

    @property
    def content(self) -> bytes:
        """Bytes of all numbers."""
        arrays = (self.mass, self.com, self.tensor, self.motor, self.viscous, self.coulomb)
        return b"".join(array.tobytes() for array in arrays)

    def transform(self, poses: ArrayLike) -> Inertia:
        """Return the same bodies in other frames.

        Parameters
        ----------
        poses : (n, 4, 4) array
            Poses of the present frames in the new ones, link by link [1, m].

        Returns
        -------
        Inertia
            The same masses, motors and friction.

        Raises
        ------
        InvalidInput
            Not n poses.
        """
        frames = check_shape(poses, (self.mass.size, 4, 4), "poses")
        turned = [transform_body(body, T) for body, T in zip(self.bodies, frames, strict=True)]
        return replace(self, com=np.array([b[1] for b in turned]), tensor=np.array([b[2] for b in turned]))

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The links as rigid bodies, each in the frame of its joint."""
        return tuple((float(m), c, t) for m, c, t in zip(self.mass, self.com, self.tensor, strict=True))

    def replace(self, **values: ArrayLike | str) -> Inertia:
        """Return a copy with some fields replaced.

        Parameters
        ----------
        **values
            mass, motor, viscous and coulomb (n,) [kg, kg·m², N·m·s/rad, N·m, or metres], com (n, 3) [m], tensor
            (n, 3, 3) [kg·m²], source.

        Returns
        -------
        Inertia

        Raises
        ------
        InvalidInput
            A field that does not exist, or values that `Inertia` refuses.
        """
        return replace_fields(self, "inertia", values)


@dataclass(frozen=True, eq=False)
class Payload(ByContent):
    """A rigid body in the tool's frame, with a known mass or an interval of masses.

    Parameters
    ----------
    mass : float or pair of floats
        Mass, or smallest and largest mass [kg]; equal ends are one mass.
    com : (3,) array, optional
        Centre of mass in the tool's frame [m].
    inertia : (3, 3) array, optional
        Inertia about the centre of mass, in the axes of the tool's frame [kg·m²]; by default a point mass. For an
        interval: of the largest mass; it scales with the mass.

    Raises
    ------
    InvalidInput
        A mass that is not above 0, ends in the wrong order, wrong shapes, NaN or infinity, an impossible tensor, or
        values too large for metres and kilograms.
    """

    mass: float | tuple[float, float]
    com: Array = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    inertia: Array = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        low, high = payload_masses(self.mass)
        com = check_shape(self.com, (3,), "payload.com")
        tensor = np.zeros((3, 3)) if self.inertia is None else check_shape(self.inertia, (3, 3), "payload.inertia")
        if high == 0.0:
            raise InvalidInput("payload.mass", repr(self.mass)[:60], "a mass above 0 [kg]")
        _mass, com, tensor = check_body((high, com, tensor), "payload")
        object.__setattr__(self, "mass", high if low == high else (low, high))
        object.__setattr__(self, "com", freeze(com, "payload.com"))
        object.__setattr__(self, "inertia", freeze(tensor, "payload.inertia"))

    @property
    def masses(self) -> tuple[float, ...]:
        """The mass, or the smallest and the largest mass [kg]."""
        return self.mass if isinstance(self.mass, tuple) else (self.mass,)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The payload in the tool's frame: one body, or the lightest and the heaviest."""
        heaviest = self.masses[-1]
        return tuple((mass, self.com, self.inertia * (mass / heaviest)) for mass in self.masses)

    @property
    def content(self) -> bytes:
        """Bytes of all numbers."""
        return b"".join(array.tobytes() for array in (np.array(self.masses), self.com, self.inertia))

    def __str__(self) -> str:
        return " to ".join(f"{mass:.6g}" for mass in self.masses) + " kg"


def arm_loads(inertia: Inertia, payload: Payload | None, tool: Array, gravity: Array) -> tuple[Load, ...]:
    """Return the load of an arm with its payload, or two loads for an interval of payload masses."""
    found = []
    for carried in (None,) if payload is None else payload.bodies:
        *links, last = inertia.bodies
        if carried is not None:
            last = join_bodies([last, transform_body(carried, tool)])
        mass, com, tensor = (freeze(np.array(part), "load") for part in zip(*links, last, strict=True))
        bodies = (mass, com, tensor, inertia.motor, freeze(gravity, "gravity"))
        found.append(Load(bodies, inertia.viscous, inertia.coulomb))
    return tuple(found)


# ---------------------------------------------------------------- checks


def payload_masses(mass: Any) -> tuple[float, float]:
    """Check the mass of a payload; return the smallest and largest mass."""
    expected = "a finite mass ≥ 0 [kg], or an interval (lightest, heaviest)"
    masses = real_array(mass, "payload.mass", expected)
    if masses.shape not in ((), (2,)):
        raise InvalidInput("payload.mass", f"shape {masses.shape}", expected)
    low, high = (float(m) for m in (masses if masses.ndim else (masses, masses)))
    for value in (low, high):
        check_number(value, "payload.mass", expected, least=0.0)
    if low > high:
        raise InvalidInput("payload.mass", f"{low:.6g} to {high:.6g} kg", "the lightest first")
    return low, high


def _per_joint(value: ArrayLike, n: int, argument: str) -> Array:
    expected = f"a finite number ≥ 0, or {n} of them"
    array = real_array(value, argument, expected)
    if array.shape not in ((), (n,)):
        raise InvalidInput(argument, f"shape {array.shape}", expected)
    if not (np.isfinite(array) & (array >= 0.0)).all():
        raise InvalidInput(argument, np.array2string(array, precision=6)[:60], expected)
    return freeze(np.broadcast_to(array, (n,)), argument)
