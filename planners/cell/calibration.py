"""calibrate: the pose of a laser unit from its readings of known points, with its covariance and outliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.check import check_kind, format_value
from optik.errors import InvalidInput
from optik.se3 import exp_so3, pose
from optik.types import Array, Flags, Indices
from planners.cell.laser import PanTiltLaser
from planners.cell.sighting import Spot, check_one_vector, copy_read_only

LEVER = 30.0
"""Least distance from the pan axis of a used pan, and from the unit of a used tilt, over the noise of the point [1]: nearer,
the arctangent is not linear over the noise. At 30 its second-order term is below 0.1 % of a radian."""

TINY = 1e-150
"""Replacement of a distance of 0 in a denominator [m]: its square is above 0, and the weight of the quotient is 0."""

MOST_TRIPLES = 100
"""Largest number of triples of pairs for initial guesses: with a quarter of outliers, all of 100 contain one with a probability
of 10⁻²³."""

FLAT_TRIPLE = 0.1
"""Smallest area of a triple's triangle, over the largest one [1]: a flatter triangle does not determine the rotation."""

MOST_FIT_STEPS = 50
"""Largest number of Gauss–Newton steps; from the closed-form initial guess three to five are enough."""

FIT_CONVERGED = 1e-6
"""Norm of the change of the standardised residuals in a step below which the fit has converged [1]: a millionth of the noise,
and more than rounding changes the sum of their squares."""

MOST_HALVINGS = 20
"""Largest number of halvings of a step: after them the step is too short to change the sum of squares, which is minimal."""


class Readings(NamedTuple):
    """Readings of known points with their weights, (m, 3) each."""

    spots: Array  # pan, tilt [rad] and range [m]
    points: Array  # in the arm's base frame [m]
    weights: Array  # one over the standard deviation [1/rad, 1/rad, 1/m]; 0 for a pan or tilt that is not used

    @property
    def m(self) -> int:
        """Number of pairs."""
        return len(self.spots)


def weight_readings(spots: Array, points: Array, angle_noise: float, range_noise: float) -> Readings:
    """Return readings with their weights."""
    distance = spots[:, 2]
    noise = LEVER * np.maximum(angle_noise * distance, range_noise)
    used = np.stack([distance * np.abs(np.cos(spots[:, 1])) >= noise, distance >= noise, distance > 0.0], axis=1)
    return Readings(spots, points, used / np.array([angle_noise, angle_noise, range_noise]))


def compute_residuals(readings: Readings, T: Array) -> Array:
    """Return the readings minus the predicted readings of the known points, at one pose or at several.

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
    """Return the horizontal distances of points y (..., m, 3) in the unit's frame, and their directions (..., m, 2)."""
    level = np.hypot(y[..., 0], y[..., 1])
    pan = readings.spots[:, 0]
    direction = np.where(
        readings.weights[:, :1] > 0.0,
        y[..., :2] / np.maximum(level, TINY)[..., None],
        np.stack([np.cos(pan), np.sin(pan)], axis=-1),
    )
    return np.sum(y[..., :2] * direction, axis=-1), direction


def standardise(readings: Readings, T: Array) -> tuple[Array, Array]:
    """Return the residuals at a pose in standard deviations, and the derivative of the prediction in the same unit."""
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
    return compute_residuals(readings, T) * readings.weights, J * readings.weights[:, :, None]


def fit_pose(readings: Readings, inliers: Flags, T: Array) -> tuple[Array, bool]:
    """Fit a pose to some pairs by least squares of the standardised residuals, with damped Gauss–Newton steps."""
    chosen = Readings(*(field[inliers] for field in readings))
    for _ in range(MOST_FIT_STEPS):
        e, J = standardise(chosen, T)
        step = np.linalg.lstsq(J.reshape(-1, 6), e.ravel(), rcond=None)[0]
        if np.linalg.norm(J @ step) <= FIT_CONVERGED:
            return T, True
        cost = float(np.sum(e**2))
        for _ in range(MOST_HALVINGS):
            ahead = pose(exp_so3(step[3:]) @ T[:3, :3], T[:3, 3] + step[:3])
            if float(np.sum((compute_residuals(chosen, ahead) * chosen.weights) ** 2)) <= cost:
                break
            step = step / 2.0
        else:
            return T, True
        T = ahead
    return T, False


def fit_closed_form(spots: Array, points: Array) -> Array:
    """Return the poses that map measured points to known ones with the least sum of squared distances (Kabsch 1976)."""
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


def find_robust_pose(readings: Readings) -> tuple[Array, Flags]:
    """Return an initial guess that tolerates outliers below a half: the pose of the triple with the least median of squares."""
    triples = _triples(readings.m)
    candidates = fit_closed_form(readings.spots[triples], readings.points[triples])
    squares = np.sum((compute_residuals(readings, candidates) * readings.weights) ** 2, axis=-1)
    half = readings.m // 2 + 1
    median = np.partition(squares, half - 1, axis=1)[:, half - 1]
    a, b, c = readings.points[triples].swapaxes(0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    best = int(np.argmin(np.where(area >= FLAT_TRIPLE * area.max(), median, np.inf)))
    inliers = np.zeros(readings.m, dtype=bool)
    inliers[triples[best]] = True
    inliers[np.argsort(squares[best])[:half]] = True
    return candidates[best], inliers


def _triples(m: int) -> Indices:
    """Return all triples of m pairs (k, 3), or `MOST_TRIPLES` random ones, the same in every run."""
    if comb(m, 3) <= MOST_TRIPLES:
        return np.array(list(combinations(range(m), 3)))
    order = np.random.default_rng(0).random((MOST_TRIPLES, m)).argsort(axis=1)
    return np.asarray(order[:, :3])


CONFIDENCE = 0.999
"""Probability that normal noise alone makes no pair an outlier, and that it does not make a calibration inconsistent."""

FEWEST_PAIRS = 3
"""Least number of pairs: a pose needs three points that are not on one line."""

FEWEST_KEPT = 4
"""Least number of pairs without the outliers: three fit almost any readings, and do not show which of them is wrong."""

MOST_LEFT_OUT = 0.25
"""Largest fraction of outliers [1]: if more pairs disagree, the stated noise or the known points are wrong."""

MOST_TURN = 0.05
"""Largest standard deviation of the unit's rotation about any axis [rad]: beyond it the pose is not linear over the noise."""

LEAST_VARIANCE = 1e-6
"""Least variance of a residual that is used, over that of its noise [1]: below it the pair alone determines the pose."""

SAME_LINE = 1e-7
"""Largest ratio of the smallest to the largest singular value of the derivatives at which the pose is not determined [1];
rounding is at 1e-15."""

NARROW = 0.1
"""Largest ratio of width to length at which a set of points counts as a line [1]."""

SEARCH_ROUNDS = 10
"""Number of rounds in which excluded pairs may return; afterwards pairs are only excluded, so that the search ends."""


class CalibrationStatus(StrEnum):
    """The status of a calibration. Only FOUND is success.

    COLLINEAR: the points do not determine the rotation, because they lie nearly on one line or too close together.
    TOO_MANY_OUTLIERS: more pairs disagree than may be excluded. INCONSISTENT: the residuals are larger than the stated noise
    allows. NOT_CONVERGED: the least-squares fit did not converge.
    """

    FOUND = "found"
    COLLINEAR = "collinear"
    TOO_MANY_OUTLIERS = "too_many_outliers"
    INCONSISTENT = "inconsistent"
    NOT_CONVERGED = "not_converged"


@dataclass(frozen=True, eq=False)
class Calibration:
    """The result of a calibration: pose, covariance and outliers. ``bool(calibration)`` is success.

    Attributes
    ----------
    status : CalibrationStatus
        FOUND, or another status.
    reason, advice : str
        Why it failed, with numbers, and what to change; empty for FOUND.
    laser : PanTiltLaser or None
        The unit at the found pose, with its covariance; None if the calibration failed.
    residuals : (m, 3) array
        Readings minus predicted readings at that pose, including outliers: pan, tilt [rad], range [m].
    distances : (m,) array
        Squared Mahalanobis distance of each pair from the pose of the other pairs [1]; outliers exceed a threshold.
    outliers : tuple of int
        Indices of the excluded pairs.
    covariance : (6, 6) array
        Covariance of the small twist (v, ω) from the found pose to the true one, p + v and Exp(ω) R, along and about the axes
        of the arm's base frame, at the unit's origin [m², m·rad, rad²]; NaN if the points do not determine the pose.
    chi_squared : float
        Sum of the squared standardised residuals of the pairs that are not outliers [1].
    freedom : int
        Its degrees of freedom: number of used readings minus the six of the pose.
    """

    status: CalibrationStatus
    reason: str
    advice: str
    laser: PanTiltLaser | None
    residuals: Array
    distances: Array
    outliers: tuple[int, ...]
    covariance: Array
    chi_squared: float
    freedom: int

    def __bool__(self) -> bool:
        return self.status is CalibrationStatus.FOUND


def calibrate(pairs: Sequence[tuple[Spot | ArrayLike, ArrayLike]], laser: PanTiltLaser) -> Calibration:
    """Find the pose of a laser unit from its readings of known points.

    The pose minimises the sum of squared residuals in pan, tilt and range, each over the unit's standard deviation. A pan
    near the pan axis, and a tilt near the unit, are not used, because the angle is not linear over the noise.

    A pair is an outlier if its squared Mahalanobis distance from the pose of the other pairs exceeds a chi-square quantile.
    At that quantile, normal noise makes none of all pairs an outlier with a probability of 99.9 %. The initial guess
    tolerates outliers of fewer than half of the pairs. At most a quarter of the pairs are excluded, and at least four remain.

    Parameters
    ----------
    pairs : sequence of (spot, point)
        Readings (pan [rad], tilt [rad], range [m]) and the known points (3,) in the arm's base frame [m], at least 3.
    laser : PanTiltLaser
        The unit: its noise and limits. Its pose is not used.

    Returns
    -------
    Calibration
        FOUND, or COLLINEAR, TOO_MANY_OUTLIERS, INCONSISTENT or NOT_CONVERGED.

    Raises
    ------
    InvalidInput
        Fewer than 3 pairs, NaN, a range that is not above 0, or a unit whose noise is 0 or not stated.
    """
    readings = _check_pairs(pairs, laser)
    T, inliers = find_robust_pose(readings)
    T, converged, inliers = _search(readings, T, inliers)
    e, J = standardise(readings, T)
    covariance = _pose_covariance(J[inliers])
    out = tuple(int(i) for i in np.flatnonzero(~inliers))
    chi_squared, freedom = float(np.sum(e[inliers] ** 2)), max(int(np.count_nonzero(readings.weights[inliers])) - 6, 0)
    status, reason, advice = _judge(readings, inliers, converged, covariance, chi_squared, freedom)
    succeeded = status is CalibrationStatus.FOUND
    return Calibration(
        status,
        reason,
        advice,
        laser.with_pose(T, covariance) if succeeded else None,
        compute_residuals(readings, T),
        _distances(e, J, inliers),
        out,
        copy_read_only(covariance),
        chi_squared,
        freedom,
    )


def _search(readings: Readings, T: Array, inliers: Flags) -> tuple[Array, bool, Flags]:
    """Fit, test every pair against the fit of the others, and repeat until the same pairs pass."""
    from scipy.special import chdtri

    every = np.ones(readings.m, dtype=bool)
    if readings.m <= FEWEST_KEPT or _largest_turn(_pose_covariance(standardise(readings, T)[1])) > MOST_TURN:
        return *fit_pose(readings, every, T), every  # no pair may be excluded, or none can be tested
    used = np.count_nonzero(readings.weights, axis=1)
    threshold = chdtri(used, (1.0 - CONFIDENCE) / readings.m)
    for turn in range(SEARCH_ROUNDS + readings.m):
        T, converged = fit_pose(readings, inliers, T)
        passed = _distances(*standardise(readings, T), inliers) <= threshold
        after = passed & inliers if turn >= SEARCH_ROUNDS else passed
        if not converged or (after == inliers).all():
            break
        inliers = after
        if np.count_nonzero(inliers) < FEWEST_PAIRS:
            break
    return T, converged, inliers


def _distances(e: Array, J: Array, inliers: Flags) -> Array:
    """Return the squared Mahalanobis distances (m,) of pairs from the fit of the others."""
    # The residuals of a fitted pair have the covariance I − J C Jᵀ, those of an excluded pair I + J C Jᵀ. The first gives the
    # distance from the fit without that pair, to first order.
    spread = J @ _pose_covariance(J[inliers]) @ J.swapaxes(1, 2)
    if not np.isfinite(spread).all():
        return np.zeros(len(e))  # the points do not determine the pose: no pair can be tested
    values, vectors = np.linalg.eigh(np.eye(3) + np.where(inliers, -1.0, 1.0)[:, None, None] * spread)
    along = np.einsum("mji,mj->mi", vectors, e)
    return np.asarray(
        np.sum(np.where(values > LEAST_VARIANCE, along**2 / np.maximum(values, LEAST_VARIANCE), 0.0), axis=1)
    )


def _pose_covariance(J: Array) -> Array:
    """Return the covariance of the pose from standardised derivatives (k, 3, 6): (Σ JᵀJ)⁻¹; NaN if it is not determined."""
    _, s, Vt = np.linalg.svd(J.reshape(-1, 6), full_matrices=False)
    if len(s) < 6 or s[5] <= SAME_LINE * s[0]:
        return np.full((6, 6), np.nan)
    scaled = Vt / s[:, None]
    return np.asarray(scaled.T @ scaled)


def _judge(
    readings: Readings, inliers: Flags, converged: bool, covariance: Array, chi_squared: float, freedom: int
) -> tuple[CalibrationStatus, str, str]:
    """Return status, reason and advice of a calibration."""
    from scipy.special import chdtri

    out, most = int(np.count_nonzero(~inliers)), max(0, min(int(MOST_LEFT_OUT * readings.m), readings.m - FEWEST_KEPT))
    if out > most:
        reason = f"{out} of {readings.m} pairs are outliers, and at most {most} may be excluded"
        advice = "check the known points and the stated noise; read more points"
        return CalibrationStatus.TOO_MANY_OUTLIERS, reason, advice
    turn = _largest_turn(covariance)
    if turn > MOST_TURN:
        known = f"known only to {turn:.3g} rad" if np.isfinite(turn) else "not determined"
        points = readings.points[inliers]
        length, width = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[:2]
        if length > SAME_LINE and width <= NARROW * length:
            why = "the points are nearly on one line"
            advice = "add points away from that line, spread in two directions"
        else:
            span = 1e3 * float(np.ptp(points, axis=0).max())
            why, advice = f"the points span only {span:.3g} mm, too little for this noise", "add points farther apart"
        return CalibrationStatus.COLLINEAR, f"the unit's rotation is {known}: {why}", advice
    if not converged:
        return CalibrationStatus.NOT_CONVERGED, "the least-squares fit did not converge", "check the pairs"
    most_squares = float(chdtri(freedom, 1.0 - CONFIDENCE)) if freedom > 0 else float("inf")
    if chi_squared > most_squares:
        size = f"chi² = {chi_squared:.4g} with {freedom} degrees of freedom"
        reason = f"the residuals are larger than the stated noise allows: {size}, above {most_squares:.4g}"
        return CalibrationStatus.INCONSISTENT, reason, "check the known points and the stated noise"
    return CalibrationStatus.FOUND, "", ""


def _largest_turn(covariance: Array) -> float:
    """Return the largest standard deviation of the rotation about any axis [rad]; infinite if it is not determined."""
    if not np.isfinite(covariance).all():
        return float("inf")
    return float(np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1]))


def _check_pairs(pairs: Sequence[tuple[Spot | ArrayLike, ArrayLike]], laser: PanTiltLaser) -> Readings:
    """Return the checked pairs as arrays with their weights."""
    check_kind(laser, "laser", PanTiltLaser, "a planners.cell.PanTiltLaser")
    for name, noise in (("angle_noise", laser.angle_noise), ("range_noise", laser.range_noise)):
        if noise == 0.0:
            raise InvalidInput(
                "laser", f"{name} = 0", "a unit whose noise is stated, by which the readings are weighted"
            )
    expected = f"a sequence of at least {FEWEST_PAIRS} pairs (spot, point)"
    try:
        rows = [(spot, point) for spot, point in pairs]
    except (TypeError, ValueError):
        raise InvalidInput("pairs", format_value(pairs), expected) from None
    if len(rows) < FEWEST_PAIRS:
        raise InvalidInput("pairs", f"{len(rows)} pairs", expected)
    spots = np.array([check_one_vector(np.asarray(spot), f"pairs[{i}][0]") for i, (spot, _) in enumerate(rows)])
    points = np.array([check_one_vector(np.asarray(point), f"pairs[{i}][1]") for i, (_, point) in enumerate(rows)])
    if not (spots[:, 2] > 0.0).all():
        i = int(np.argmin(spots[:, 2]))
        raise InvalidInput(f"pairs[{i}][0]", f"the range {spots[i, 2]:g} m", "a range above 0")
    return weight_readings(spots, points, laser.angle_noise, laser.range_noise)
