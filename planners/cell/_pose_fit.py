"""The pose of a laser unit that fits its readings of known points best: closed-form start, then Gauss–Newton on SE(3)."""

from __future__ import annotations

from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np

from optik.se3 import exp_so3, pose
from optik.types import Array, Flags, Indices

LEVER = 30.0
"""Distance from the pan axis, over the noise of the point, from which on a pan is used [1], and from the unit for a tilt:
nearer, the arctangent is not linear over the noise. At 30 its second-order term is below 0.1 % of a radian."""

TINY = 1e-150
"""Stands for a distance of 0 in a denominator [m]: its square is still a number, and what it divides has the weight 0."""

MOST_TRIPLES = 100
"""Most triples of pairs of which starts are made: with a quarter of outliers, all of 100 have one with a chance of 10⁻²³."""

FLAT_TRIPLE = 0.1
"""Smallest area of a triple's triangle, over the largest one [1]: a flatter one does not fix the rotation, which many points on
one line would not show."""

MOST_FIT_STEPS = 50
"""Most Gauss–Newton steps; from the closed-form start three to five are enough."""

FIT_SETTLED = 1e-6
"""Change of the standardised residuals by a step, in norm, at which the fit has converged [1]: a millionth of the noise, and
still more than rounding changes the sum of their squares."""

MOST_HALVINGS = 20
"""Most halvings of one step: after them it is too short to change the sum of squares, which then is at its minimum."""


class Readings(NamedTuple):
    """Readings of known points, and what each is worth.

    Attributes
    ----------
    spots : (m, 3) array
        Pan, tilt [rad] and range [m] of each pair.
    points : (m, 3) array
        The known points in the arm's base frame [m].
    weights : (m, 3) array
        One over the standard deviation [1/rad, 1/rad, 1/m]; 0 for a pan or tilt that is not used.
    """

    spots: Array
    points: Array
    weights: Array

    @property
    def m(self) -> int:
        """Number of pairs."""
        return len(self.spots)


def readings_of(spots: Array, points: Array, angle_noise: float, range_noise: float) -> Readings:
    """Return readings with their weights."""
    distance = spots[:, 2]
    noise = LEVER * np.maximum(angle_noise * distance, range_noise)
    used = np.stack([distance * np.abs(np.cos(spots[:, 1])) >= noise, distance >= noise, distance > 0.0], axis=1)
    return Readings(spots, points, used / np.array([angle_noise, angle_noise, range_noise]))


def residuals(readings: Readings, T: Array) -> Array:
    """Readings minus what the unit would read of the known points at one pose or at several.

    Where the pan is not used, the tilt is that of the point in the vertical plane of the pan that was read: it goes on
    smoothly across the pan axis, where the tilt itself has a corner.
    """
    y = (readings.points - T[..., None, :3, 3]) @ T[..., :3, :3]
    flat = _along(readings, y)[0]
    distance = np.linalg.norm(y, axis=-1)
    predicted = np.stack([np.arctan2(y[..., 1], y[..., 0]), np.arctan2(y[..., 2], flat), distance], axis=-1)
    e = readings.spots - predicted
    e[..., :2] = np.remainder(e[..., :2] + np.pi, 2 * np.pi) - np.pi
    return np.asarray(e)


def _along(readings: Readings, y: Array) -> tuple[Array, Array]:
    """Horizontal distances of points y (..., m, 3) in the unit's frame, and the directions (..., m, 2) they are measured in."""
    level = np.hypot(y[..., 0], y[..., 1])
    pan = readings.spots[:, 0]
    direction = np.where(
        readings.weights[:, :1] > 0.0,
        y[..., :2] / np.maximum(level, TINY)[..., None],
        np.stack([np.cos(pan), np.sin(pan)], axis=-1),
    )
    return np.sum(y[..., :2] * direction, axis=-1), direction


def standardised(readings: Readings, T: Array) -> tuple[Array, Array]:
    """Residuals at a pose in standard deviations, and the derivative of what is predicted, in the same unit."""
    R, arm = T[:3, :3], readings.points - T[:3, 3]
    y = arm @ R
    flat, direction = _along(readings, y)
    level, distance = np.maximum(np.hypot(y[:, 0], y[:, 1]), TINY), np.maximum(np.linalg.norm(y, axis=1), TINY)
    in_plane = np.maximum(np.hypot(flat, y[:, 2]), TINY)
    unit = np.zeros((readings.m, 3, 3))  # derivatives of pan, tilt and range by the point in the unit's frame
    unit[:, 0, 0], unit[:, 0, 1] = -y[:, 1] / level**2, y[:, 0] / level**2
    unit[:, 1, :2] = -direction * (y[:, 2] / in_plane**2)[:, None]
    unit[:, 1, 2] = flat / in_plane**2
    unit[:, 2] = y / distance[:, None]
    by_point = unit @ R.T  # by the point in the base frame; moving the origin does the opposite
    J = np.concatenate([-by_point, np.cross(by_point, arm[:, None, :])], axis=2)
    return residuals(readings, T) * readings.weights, J * readings.weights[:, :, None]


def fit_pose(readings: Readings, kept: Flags, T: Array) -> tuple[Array, bool]:
    """Least squares of the standardised residuals of some pairs, by Gauss–Newton steps that are halved until they descend."""
    chosen = Readings(*(field[kept] for field in readings))
    for _ in range(MOST_FIT_STEPS):
        e, J = standardised(chosen, T)
        step = np.linalg.lstsq(J.reshape(-1, 6), e.ravel(), rcond=None)[0]
        if np.linalg.norm(J @ step) <= FIT_SETTLED:
            return T, True
        cost = float(np.sum(e**2))
        for _ in range(MOST_HALVINGS):
            ahead = pose(exp_so3(step[3:]) @ T[:3, :3], T[:3, 3] + step[:3])
            if float(np.sum((residuals(chosen, ahead) * chosen.weights) ** 2)) <= cost:
                break
            step = step / 2.0
        else:
            return T, True
        T = ahead
    return T, False


def closed_form(spots: Array, points: Array) -> Array:
    """Poses that carry points measured by the unit onto known ones with the least sum of squared distances (Kabsch 1976)."""
    pan, tilt, distance = np.moveaxis(spots, -1, 0)
    flat = distance * np.cos(tilt)
    seen = np.stack([flat * np.cos(pan), flat * np.sin(pan), distance * np.sin(tilt)], axis=-1)
    a, b = seen.mean(axis=-2, keepdims=True), points.mean(axis=-2, keepdims=True)
    U, _, Vt = np.linalg.svd((points - b).swapaxes(-1, -2) @ (seen - a))
    U[..., :, 2] *= np.linalg.det(U @ Vt)[..., None]  # a rotation, not a reflection
    T = np.zeros((*U.shape[:-2], 4, 4))
    T[..., :3, :3] = U @ Vt
    T[..., :3, 3] = b[..., 0, :] - np.einsum("...ij,...j->...i", T[..., :3, :3], a[..., 0, :])
    T[..., 3, 3] = 1.0
    return T


def robust_start(readings: Readings) -> tuple[Array, Flags]:
    """Start that outliers below a half do not spoil: of the poses of many triples, that with the least median of squares."""
    triples = _triples(readings.m)
    candidates = closed_form(readings.spots[triples], readings.points[triples])
    squares = np.sum((residuals(readings, candidates) * readings.weights) ** 2, axis=-1)
    half = readings.m // 2 + 1
    median = np.partition(squares, half - 1, axis=1)[:, half - 1]
    a, b, c = readings.points[triples].swapaxes(0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    best = int(np.argmin(np.where(area >= FLAT_TRIPLE * area.max(), median, np.inf)))
    kept = np.zeros(readings.m, dtype=bool)
    kept[triples[best]] = True
    kept[np.argsort(squares[best])[:half]] = True
    return candidates[best], kept


def _triples(m: int) -> Indices:
    """All triples of m pairs, or `MOST_TRIPLES` random ones, the same in every run, (k, 3)."""
    if comb(m, 3) <= MOST_TRIPLES:
        return np.array(list(combinations(range(m), 3)))
    order = np.random.default_rng(0).random((MOST_TRIPLES, m)).argsort(axis=1)
    return np.asarray(order[:, :3])
