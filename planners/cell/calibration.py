"""calibrate: the pose of a laser unit from its readings of known points, with its covariance and the outliers found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from optik.check import shown
from optik.errors import InvalidInput
from optik.types import Array, Flags
from planners.cell._checks import fixed, vector
from planners.cell._pose_fit import Readings, fit_pose, readings_of, residuals, robust_start, standardised
from planners.cell.laser import PanTiltLaser
from planners.cell.sighting import Spot

CONFIDENCE = 0.999
"""Probability that normal noise alone loses no pair as an outlier, and that it does not make a calibration inconsistent."""

FEWEST_PAIRS = 3
"""A pose needs three points that are not on one line."""

FEWEST_KEPT = 4
"""Pairs that must remain before one is left out: three fit almost any readings, and could not show which of them is wrong."""

MOST_LEFT_OUT = 0.25
"""Largest share of the pairs that may be outliers [1]: where more disagree, it is not they that are wrong but the stated noise
or the known points as a whole."""

MOST_TURN = 0.05
"""Largest standard deviation of the unit's rotation about any axis [rad]: beyond it the pose is not linear over the noise."""

LEAST_VARIANCE = 1e-6
"""Variance of a residual, over that of its noise, below which it says nothing [1]: the pair alone fixes the pose there."""

SAME_LINE = 1e-7
"""Smallest singular value of the derivatives, over the largest, up to which the pose is not fixed [1]: rounding is at 1e-15."""

NARROW = 0.1
"""Largest ratio of width to length at which a set of points counts as a line [1]."""

SEARCH_ROUNDS = 10
"""Rounds in which pairs may come back; after them they only leave, so that the search ends."""


class CalibrationStatus(StrEnum):
    """How a calibration ended. Only FOUND is success.

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
    """The pose of a unit, how well it is known, and what disagrees. ``bool(calibration)`` is success.

    Attributes
    ----------
    status : CalibrationStatus
        FOUND, or why not.
    reason, advice : str
        Why it failed, with numbers, and what to change; empty where it did not.
    laser : PanTiltLaser or None
        The unit at the pose found, with its covariance; None where the calibration failed.
    residuals : (m, 3) array
        Readings minus what the unit at that pose would read, outliers included: pan, tilt [rad], range [m].
    distances : (m,) array
        Squared Mahalanobis distance of each pair from the pose that the other pairs give [1], by which outliers are found.
    outliers : tuple of int
        Indices of the pairs left out.
    covariance : (6, 6) array
        Of the small twist (v, ω) from the found pose to the true one, p + v and Exp(ω) R, along and about the axes of the
        arm's base frame, at the unit's origin [m², m·rad, rad²]; NaN where the points do not fix the pose.
    chi_squared : float
        Sum of the squared standardised residuals of the pairs kept [1].
    freedom : int
        Its degrees of freedom: readings used, less the six of the pose.
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
    """Find the pose of a laser unit from what it reads of known points.

    The pose minimises the sum of squared residuals in pan, tilt and range, each over its standard deviation as the unit
    states it. A pan near the pan axis, and a tilt near the unit, are not used where the angle is not linear over the noise.

    A pair is an outlier if its squared Mahalanobis distance from the pose of the other pairs exceeds the chi-square
    quantile at which normal noise loses none of all pairs with a probability of 99.9 %. The search for them starts at a
    pose that no outliers spoil as long as they are fewer than half. At most a quarter of the pairs are left out, and at least
    four are kept.

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
    readings = _readings(pairs, laser)
    T, kept = robust_start(readings)
    T, converged, kept = _search(readings, T, kept)
    e, J = standardised(readings, T)
    covariance = _inverse(J[kept])
    out = tuple(int(i) for i in np.flatnonzero(~kept))
    chi_squared, freedom = float(np.sum(e[kept] ** 2)), max(int(np.count_nonzero(readings.weights[kept])) - 6, 0)
    status, reason, advice = _judged(readings, kept, converged, covariance, chi_squared, freedom)
    found = status is CalibrationStatus.FOUND
    return Calibration(
        status,
        reason,
        advice,
        laser.with_pose(T, covariance) if found else None,
        residuals(readings, T),
        _distances(e, J, kept),
        out,
        fixed(covariance),
        chi_squared,
        freedom,
    )


def _search(readings: Readings, T: Array, kept: Flags) -> tuple[Array, bool, Flags]:
    """Fit, test every pair against the fit of the others, and repeat until the same pairs pass."""
    from scipy.special import chdtri

    every = np.ones(readings.m, dtype=bool)
    if readings.m <= FEWEST_KEPT or _largest_turn(_inverse(standardised(readings, T)[1])) > MOST_TURN:
        return *fit_pose(readings, every, T), every  # none may be left out, or none can be tested
    used = np.count_nonzero(readings.weights, axis=1)
    threshold = chdtri(used, (1.0 - CONFIDENCE) / readings.m)
    for turn in range(SEARCH_ROUNDS + readings.m):
        T, converged = fit_pose(readings, kept, T)
        passed = _distances(*standardised(readings, T), kept) <= threshold
        after = passed & kept if turn >= SEARCH_ROUNDS else passed
        if not converged or (after == kept).all():
            break
        kept = after
        if np.count_nonzero(kept) < FEWEST_PAIRS:
            break
    return T, converged, kept


def _distances(e: Array, J: Array, kept: Flags) -> Array:
    """Squared Mahalanobis distances of pairs from the fit of the others, (m,)."""
    # The residuals of a pair that is kept have the covariance I − J C Jᵀ, as the fit was drawn towards them; those of
    # another I + J C Jᵀ. The first gives the distance from the fit without that pair, to first order.
    spread = J @ _inverse(J[kept]) @ J.swapaxes(1, 2)
    if not np.isfinite(spread).all():
        return np.zeros(len(e))  # the points do not fix the pose: no pair can be tested
    values, vectors = np.linalg.eigh(np.eye(3) + np.where(kept, -1.0, 1.0)[:, None, None] * spread)
    along = np.einsum("mji,mj->mi", vectors, e)
    return np.asarray(
        np.sum(np.where(values > LEAST_VARIANCE, along**2 / np.maximum(values, LEAST_VARIANCE), 0.0), axis=1)
    )


def _inverse(J: Array) -> Array:
    """Covariance of the pose from standardised derivatives (k, 3, 6): (Σ JᵀJ)⁻¹; NaN where they do not fix the pose."""
    _, s, Vt = np.linalg.svd(J.reshape(-1, 6), full_matrices=False)
    if len(s) < 6 or s[5] <= SAME_LINE * s[0]:
        return np.full((6, 6), np.nan)
    scaled = Vt / s[:, None]
    return np.asarray(scaled.T @ scaled)


def _judged(
    readings: Readings, kept: Flags, converged: bool, covariance: Array, chi_squared: float, freedom: int
) -> tuple[CalibrationStatus, str, str]:
    """Status, reason and advice of a calibration."""
    from scipy.special import chdtri

    out, most = int(np.count_nonzero(~kept)), _most_outliers(readings.m)
    if out > most:
        reason = f"{out} of {readings.m} pairs disagree with the rest, and at most {most} may be left out"
        return (
            CalibrationStatus.TOO_MANY_OUTLIERS,
            reason,
            "check the known points and the stated noise; read more points",
        )
    turn = _largest_turn(covariance)
    if turn > MOST_TURN:
        known = f"known to {turn:.3g} rad only" if np.isfinite(turn) else "not fixed at all"
        points = readings.points[kept]
        length, width = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[:2]
        if length > SAME_LINE and width <= NARROW * length:
            why, advice = (
                "the points lie on one line, or nearly on one",
                "add points away from that line, spread in two directions",
            )
        else:
            span = 1e3 * float(np.ptp(points, axis=0).max())
            why, advice = f"the points span only {span:.3g} mm, too little for this noise", "add points farther apart"
        return CalibrationStatus.COLLINEAR, f"the unit's rotation is {known}: {why}", advice
    if not converged:
        return CalibrationStatus.NOT_CONVERGED, "the least-squares fit came to no end", "check the pairs"
    most_squares = float(chdtri(freedom, 1.0 - CONFIDENCE)) if freedom > 0 else float("inf")
    if chi_squared > most_squares:
        reason = (
            f"chi² = {chi_squared:.4g} with {freedom} degrees of freedom, above {most_squares:.4g}: more than the noise"
        )
        return CalibrationStatus.INCONSISTENT, reason, "check the known points, and that the unit's noise is not larger"
    return CalibrationStatus.FOUND, "", ""


def _most_outliers(m: int) -> int:
    """How many of m pairs may be left out: at most a quarter, and so few that enough are kept."""
    return max(0, min(int(MOST_LEFT_OUT * m), m - FEWEST_KEPT))


def _largest_turn(covariance: Array) -> float:
    """Largest standard deviation of the rotation about any axis [rad]; infinite where the pose is not fixed."""
    if not np.isfinite(covariance).all():
        return float("inf")
    return float(np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1]))


def _readings(pairs: Sequence[tuple[Spot | ArrayLike, ArrayLike]], laser: PanTiltLaser) -> Readings:
    """The pairs as arrays with their weights, checked."""
    if not isinstance(laser, PanTiltLaser):
        raise InvalidInput("laser", shown(laser), "a planners.cell.PanTiltLaser")
    for name, noise in (("angle_noise", laser.angle_noise), ("range_noise", laser.range_noise)):
        if noise == 0.0:
            raise InvalidInput(
                "laser", f"{name} = 0", "a unit whose noise is stated, by which the readings are weighted"
            )
    expected = f"a sequence of at least {FEWEST_PAIRS} pairs (spot, point)"
    try:
        rows = [(spot, point) for spot, point in pairs]
    except (TypeError, ValueError):
        raise InvalidInput("pairs", shown(pairs), expected) from None
    if len(rows) < FEWEST_PAIRS:
        raise InvalidInput("pairs", f"{len(rows)} pairs", expected)
    spots = np.array([vector(np.asarray(spot), f"pairs[{i}][0]") for i, (spot, _) in enumerate(rows)])
    points = np.array([vector(np.asarray(point), f"pairs[{i}][1]") for i, (_, point) in enumerate(rows)])
    if not (spots[:, 2] > 0.0).all():
        i = int(np.argmin(spots[:, 2]))
        raise InvalidInput(f"pairs[{i}][0]", f"the range {spots[i, 2]:g} m", "a range above 0")
    return readings_of(spots, points, laser.angle_noise, laser.range_noise)
