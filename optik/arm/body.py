"""Rigid bodies: their composition, their transforms, and checks that they are physically possible."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from optik.check import check_number, real_array
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
        raise InvalidInput(argument, moments, "moments of which none exceeds the sum of the other two")
    radius = (high / mass) ** 0.5 if mass > 0.0 else 0.0
    if radius > FARTHEST_MASS:
        wanted = f"kg·m² with a radius of gyration of at most {FARTHEST_MASS:g} m; is it in kg·mm² or g·mm²?"
        raise InvalidInput(argument, f"{high:.4g}, a radius of gyration of {radius:.4g} m for {mass:.4g} kg", wanted)
    return symmetric


def check_shape(value: ArrayLike, shape: tuple[int, ...], argument: str) -> Array:
    """Check that a value is an array of a known shape, and return it."""
    array = real_array(value, argument, f"numbers of shape {shape}")
    if array.shape != shape:
        raise InvalidInput(argument, f"shape {array.shape}", f"numbers of shape {shape}")
    return array
