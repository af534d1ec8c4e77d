"""PanTiltLaser: a pan-tilt laser unit, the conversion of its readings to points and back, and readings with noise."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from math import inf, pi

import numpy as np
from numpy.typing import ArrayLike

from optik.check import check_count, check_kind, check_number, format_value
from optik.errors import InvalidInput
from optik.se3 import check_pose, nearest_pose
from optik.types import Array, Flags
from planners.cell import sighting
from planners.cell.sighting import Limits, Plane, Sighting, SightStatus, SimulatedSpot, Spot, check_covariance

# ---------------- panTiltLaser


ANGLE_SLACK = 1e-9
"""Tolerance on the pan and tilt limits [rad], for rounding of a spot at a limit."""

RANGE_SLACK = 1e-9
"""Tolerance on the range limits [m], for rounding of a spot at a limit; a nearer point counts as the unit's origin."""

GRAZING = 1e-9
"""Largest sine of the angle between a beam and a plane that count as parallel [1]: 1 m from the plane, such a beam would meet
it 10⁶ km away."""

ON_PAN_AXIS = 8 * np.finfo(np.float64).eps
"""Largest distance from the pan axis of a point that counts as on it, over the size of the coordinates [1]: rounding errors of
that size would make the pan random."""

TURN_UNIT = "move or turn the unit so that the spot is inside its limits"
"""Advice for a spot outside the limits of pan or tilt."""


@dataclass(frozen=True, eq=False)
class PanTiltLaser:
    """A pan-tilt unit with a laser that measures the range along its beam.

    At pan = tilt = 0 the beam is the unit's x axis. Pan rotates it about the unit's z axis, then tilt about the rotated
    −y axis, so that a positive tilt raises it: d = (cos p · cos t, sin p · cos t, sin t). The beam starts at the unit's
    origin. Points and planes are in the arm's base frame.

    The noise of a reading is normal and independent: ``angle_noise`` in pan and in tilt, ``range_noise`` in range. The
    calibration error is a small twist (v, ω) of the pose, along and about the axes of the base frame: the true origin is
    p + v, the true rotation Exp(ω) R. Methods raise InvalidInput for NaN, infinity, a negative range, a matrix that is no pose,
    and shapes that do not fit.

    Parameters
    ----------
    pose : (4, 4) array
        The unit's frame in the arm's base frame [1, m].
    pan_limits : (2,) floats
        Limits of pan, within ±2π [rad]; a pan may be given modulo 2π.
    tilt_limits : (2,) floats
        Limits of tilt, within ±π/2 [rad].
    range_limits : (2,) floats
        Limits of the range, not below 0 [m]; the upper one may be infinite.
    angle_noise : float
        Standard deviation of pan and of tilt [rad].
    range_noise : float
        Standard deviation of the range [m].
    pose_covariance : (6, 6) array, optional
        Covariance of the twist (v, ω) of the pose, as `calibrate` returns it [m², m·rad, rad²]; by default the pose is exact.

    Raises
    ------
    InvalidInput
        A matrix that is no pose, limits out of order, a negative or NaN noise, or a matrix that is no covariance.
    """

    pose: Array
    _: KW_ONLY
    pan_limits: Limits = (-pi, pi)
    tilt_limits: Limits = (-pi / 2, pi / 2)
    range_limits: Limits = (0.0, inf)
    angle_noise: float = 0.0
    range_noise: float = 0.0
    pose_covariance: Array | None = None

    def __post_init__(self) -> None:
        expected = "a standard deviation ≥ 0"
        values = {
            "pose": sighting.copy_read_only(nearest_pose(check_pose(self.pose, "pose"))),
            "pan_limits": sighting.check_limits(self.pan_limits, "pan_limits", -2 * pi, 2 * pi, "[−2π, 2π]"),
            "tilt_limits": sighting.check_limits(self.tilt_limits, "tilt_limits", -pi / 2, pi / 2, "[−π/2, π/2]"),
            "range_limits": sighting.check_limits(self.range_limits, "range_limits", 0.0, inf, "[0, ∞]"),
            "angle_noise": check_number(self.angle_noise, "angle_noise", expected, least=0.0),
            "range_noise": check_number(self.range_noise, "range_noise", expected, least=0.0),
            "pose_covariance": None if self.pose_covariance is None else check_covariance(self.pose_covariance),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    # ------------------------------------------------------------ geometry

    def direction(self, pan: ArrayLike, tilt: ArrayLike) -> Array:
        """Return the directions of the beam in the arm's base frame.

        Parameters
        ----------
        pan, tilt : scalar or (...,) arrays
            Angles; they broadcast [rad].

        Returns
        -------
        (3,) or (..., 3) array
            Vectors of length 1 [1].
        """
        pan, tilt, _ = sighting.check_readings(pan, tilt, 0.0)
        return np.asarray(_beam_directions(pan, tilt) @ self.pose[:3, :3].T)

    def point(self, pan: ArrayLike, tilt: ArrayLike, range: ArrayLike) -> Array:
        """Return the points of readings; limits are not checked, because a noisy reading may exceed them.

        Parameters
        ----------
        pan, tilt : scalar or (...,) arrays
            Angles; all three arguments broadcast [rad].
        range : scalar or (...,) array
            Distances along the beam [m].

        Returns
        -------
        (3,) or (..., 3) array
            Points in the arm's base frame [m].
        """
        pan, tilt, range = sighting.check_readings(pan, tilt, range)
        return np.asarray(self.pose[:3, 3] + range[..., None] * (_beam_directions(pan, tilt) @ self.pose[:3, :3].T))

    def reading(self, points: ArrayLike) -> Spot:
        """Return the readings of points without noise and without limits; `angles` checks one point against the limits.

        Parameters
        ----------
        points : (3,) or (..., 3) array
            In the arm's base frame [m].

        Returns
        -------
        Spot
            Pan in (−π, π], tilt in [−π/2, π/2] [rad], range [m]. On the pan axis the pan is not determined; it is 0.
        """
        points = sighting.check_vectors(points, "points")
        x, y, z = np.moveaxis((points - self.pose[:3, 3]) @ self.pose[:3, :3], -1, 0)
        off_axis = np.hypot(x, y)
        pan = np.where(self._on_pan_axis(points), 0.0, np.arctan2(y, x))
        return Spot(pan, np.arctan2(z, off_axis), np.hypot(off_axis, z))

    def jacobians(self, pan: ArrayLike, tilt: ArrayLike, range: ArrayLike) -> tuple[Array, Array]:
        """Return the derivatives of points by their readings, and by a small twist of the unit's pose.

        Parameters
        ----------
        pan, tilt : scalar or (...,) arrays
            Angles; all three arguments broadcast [rad].
        range : scalar or (...,) array
            Distances along the beam [m].

        Returns
        -------
        by_reading : (3, 3) or (..., 3, 3) array
            Columns pan, tilt [m/rad] and range [1].
        by_pose : (3, 6) or (..., 3, 6) array
            Columns v [1] and ω [m/rad], along and about the axes of the base frame, at the unit's origin.
        """
        pan, tilt, range = sighting.check_readings(pan, tilt, range)
        beam, across = _beam_directions(pan, tilt), range * np.cos(tilt)
        panned = np.stack([-np.sin(pan) * across, np.cos(pan) * across, np.zeros_like(across)], axis=-1)
        tilted = range[..., None] * _beam_directions(pan, tilt + pi / 2)
        R = self.pose[:3, :3]
        by_reading = R @ np.stack([panned, tilted, beam], axis=-1)
        arm = range[..., None] * by_reading[..., 2]
        by_pose = np.zeros((*range.shape, 3, 6))
        by_pose[..., :3] = np.eye(3)
        by_pose[..., 3:] = np.cross(np.eye(3), arm[..., None, :], axis=-1).swapaxes(-1, -2)
        return by_reading, by_pose

    def covariance(self, pan: ArrayLike, tilt: ArrayLike, range: ArrayLike) -> Array:
        """Return the covariance of measured points from the noise of reading and calibration, to first order.

        Parameters
        ----------
        pan, tilt : scalar or (...,) arrays
            Angles; all three arguments broadcast [rad].
        range : scalar or (...,) array
            Distances along the beam [m].

        Returns
        -------
        (3, 3) or (..., 3, 3) array
            Covariances in the axes of the base frame [m²].
        """
        by_reading, by_pose = self.jacobians(pan, tilt, range)
        scaled = by_reading * (self.angle_noise, self.angle_noise, self.range_noise)
        total = scaled @ scaled.swapaxes(-1, -2)
        if self.pose_covariance is not None:
            total = total + by_pose @ self.pose_covariance @ by_pose.swapaxes(-1, -2)
        return np.asarray(total)

    def with_pose(self, pose: ArrayLike, covariance: ArrayLike | None = None) -> PanTiltLaser:
        """Return the unit at another pose, with the same limits and noise of readings.

        Parameters
        ----------
        pose : (4, 4) array
            The unit's frame in the arm's base frame [1, m].
        covariance : (6, 6) array, optional
            Covariance of the twist (v, ω) of that pose [m², m·rad, rad²]; by default the new pose is exact.

        Returns
        -------
        PanTiltLaser
            The unit at that pose.
        """
        checked = None if covariance is None else check_covariance(covariance)
        return replace(self, pose=check_pose(pose, "pose"), pose_covariance=checked)

    def read(self, point: ArrayLike, rng: np.random.Generator) -> Spot:
        """Return a noisy reading of a true point by this unit, for simulations.

        Parameters
        ----------
        point : (3,) or (..., 3) array
            True points in the arm's base frame [m].
        rng : Generator
            Source of the noise; the same state gives the same readings.

        Returns
        -------
        Spot
            Pan and tilt [rad], range [m], with this unit's noise; a range is not below 0.
        """
        exact = np.stack(self.reading(point), axis=-1)
        noisy = rng.normal(exact, (self.angle_noise, self.angle_noise, self.range_noise))
        return Spot(noisy[..., 0], noisy[..., 1], np.maximum(noisy[..., 2], 0.0))

    def angles(self, point: ArrayLike) -> Sighting:
        """Return the pan, tilt and range at which the beam meets a point, and whether the unit can reach them.

        Parameters
        ----------
        point : (3,) array
            In the arm's base frame [m].

        Returns
        -------
        Sighting
            FOUND, OUTSIDE_ANGLES, BEHIND (outside the pan limits and behind the unit), OUT_OF_RANGE or AT_UNIT. On the
            pan axis the pan is not determined; it is the one inside the limits that is nearest to 0.
        """
        point = sighting.check_one_vector(point, "point")
        spot = Spot(*(float(x) for x in self.reading(point)))
        if spot.range <= RANGE_SLACK:
            return Sighting(SightStatus.AT_UNIT, "the point is the unit's origin", "choose a point away from the unit")
        ahead = float((point - self.pose[:3, 3]) @ self.pose[:3, 0]) > 0.0
        if self._on_pan_axis(point):
            spot = spot._replace(pan=float(np.clip(0.0, *self.pan_limits)))
        return self._judge(spot, point, ahead)

    def intersect_plane(self, pan: float, tilt: float, plane: Plane) -> Sighting:
        """Return where the beam meets a plane, such as the graph paper; the range follows from the plane.

        Parameters
        ----------
        pan, tilt : float
            Angles [rad].
        plane : Plane
            In the arm's base frame.

        Returns
        -------
        Sighting
            FOUND, OUTSIDE_ANGLES, PARALLEL, BEHIND (the beam points away from the plane), OUT_OF_RANGE or AT_UNIT (the unit's
            origin lies on the plane). The covariance is that of the point on the plane, of rank 2: `covariance` without
            range noise, projected along the beam onto the plane.

        Raises
        ------
        InvalidInput
            NaN or infinity, or no Plane.
        """
        check_kind(plane, "plane", Plane, "a planners.cell.Plane")
        pan, tilt = (check_number(x, name, "an angle [rad]") for x, name in ((pan, "pan"), (tilt, "tilt")))
        d = self.direction(pan, tilt)
        along, lever = float(plane.normal @ d), -float(plane.distance(self.pose[:3, 3]))
        if abs(along) <= GRAZING:
            reason = f"the beam is parallel to the plane, at a distance of {abs(lever):.3g} m"
            return Sighting(SightStatus.PARALLEL, reason, "turn the beam towards the plane")
        distance = lever / along
        if abs(distance) <= RANGE_SLACK:
            return Sighting(SightStatus.AT_UNIT, "the unit's origin lies on the plane", "move the unit off the plane")
        if distance < 0.0:
            reason = f"the beam points away from the plane, which is {-distance:.3g} m behind the unit"
            return Sighting(SightStatus.BEHIND, reason, "turn the beam by half a turn, or move the unit")
        point = self.pose[:3, 3] + distance * d
        onto = np.eye(3) - np.outer(d, plane.normal) / along  # along the beam onto the plane
        return self._judge(Spot(pan, tilt, distance), point, True, onto)

    def _judge(self, spot: Spot, point: Array, ahead: bool, onto: Array | None = None) -> Sighting:
        """Return the sighting of a spot: FOUND if pan, tilt and range are inside the limits."""
        pan, tilt, distance = (float(x) for x in spot)
        turned = _turn_into(pan, self.pan_limits)
        if turned is None:
            status = SightStatus.OUTSIDE_ANGLES if ahead else SightStatus.BEHIND
            where = "" if ahead else "the point is behind the unit: "
            return Sighting(status, where + _describe_outside("pan", pan, self.pan_limits), TURN_UNIT)
        if not _is_inside(tilt, self.tilt_limits, ANGLE_SLACK):
            return Sighting(SightStatus.OUTSIDE_ANGLES, _describe_outside("tilt", tilt, self.tilt_limits), TURN_UNIT)
        if not _is_inside(distance, self.range_limits, RANGE_SLACK):
            low, high = self.range_limits
            reason = f"the range {distance:.6g} m is outside [{low:.6g}, {high:.6g}] m"
            return Sighting(SightStatus.OUT_OF_RANGE, reason, "move the unit, or choose a point within its range")
        covariance = self.covariance(turned, tilt, distance)
        if onto is not None:
            covariance = onto @ covariance @ onto.T
        return Sighting(SightStatus.FOUND, "", "", point, Spot(turned, tilt, distance), covariance)

    def _on_pan_axis(self, points: Array) -> Flags:
        """Return whether points lie on the pan axis, to rounding."""
        y = (points - self.pose[:3, 3]) @ self.pose[:3, :2]
        size = np.linalg.norm(points, axis=-1) + np.linalg.norm(self.pose[:3, 3])
        return np.asarray(np.hypot(y[..., 0], y[..., 1]) <= ON_PAN_AXIS * size)


def _beam_directions(pan: Array, tilt: Array) -> Array:
    """Return the directions (..., 3) of the beam in the unit's own frame."""
    flat = np.cos(tilt)
    return np.stack([np.cos(pan) * flat, np.sin(pan) * flat, np.sin(tilt)], axis=-1)


def _turn_into(pan: float, limits: Limits) -> float | None:
    """Return the pan, or the same direction a turn away, that is inside the limits; None if there is none."""
    turns = (pan, pan + 2 * pi, pan - 2 * pi)
    return next((p for p in turns if _is_inside(p, limits, ANGLE_SLACK)), None)


def _is_inside(value: float, limits: Limits, slack: float) -> bool:
    return limits[0] - slack <= value <= limits[1] + slack


def _describe_outside(name: str, angle: float, limits: Limits) -> str:
    low, high = np.degrees(limits)
    return f"{name} {np.degrees(angle):.6g}° is outside [{low:.6g}, {high:.6g}]°"


# ---------------- readings of a laser unit


MOST_READINGS = 10_000
"""Largest number of readings of one point; their mean has a hundredth of the noise."""


def read_point(unit: PanTiltLaser, point: Array, readings: int, rng: np.random.Generator) -> SimulatedSpot:
    """Return a noisy reading of a true point (3,) by a unit, or arrays of several; it carries the point."""
    check_count(readings, "readings", 1, MOST_READINGS)
    spot = SimulatedSpot(*unit.read(point if readings == 1 else np.tile(point, (readings, 1)), rng))
    spot.true_point = point
    return spot


def find_truth(unit: PanTiltLaser, spot: Spot, plane: Plane | None) -> tuple[Array, bool]:
    """Return the true point of a reading, and whether it is known.

    If it is not known, the reading is taken as exact: the mean of its points, without the limits of the unit.
    """
    if isinstance(spot, SimulatedSpot) and spot.true_point is not None:
        return spot.true_point, True
    if plane is None:
        return np.atleast_2d(unit.point(*spot)).mean(axis=0), False
    seen = locate_spot(unit, spot, plane)
    if seen.point is None:
        wanted = "a beam of the true unit that meets the plane"
        raise InvalidInput("spot", f"a reading off the plane: {seen.reason}", wanted)
    return seen.point, False


def locate_spot(unit: PanTiltLaser, spot: Spot, plane: Plane | None) -> Sighting:
    """Return the spot as a unit locates it: the mean of its readings."""
    rows = _rows(spot, plane)
    sightings = []
    for row in rows.tolist():
        seen = _locate_reading(unit, row, plane)
        if not seen:
            return seen
        sightings.append(seen)
    if len(sightings) == 1:
        return sightings[0]
    mean = unit.angles(np.mean(np.stack([seen.point for seen in sightings if seen.point is not None]), axis=0))
    # The noise of the readings averages out; the error of the calibration does not.
    noise = _find_noise(unit, rows, plane)
    if not mean or noise is None or sightings[0].covariance is None:
        return mean
    return replace(mean, covariance=sightings[0].covariance - noise * (1.0 - 1.0 / len(sightings)))


def find_variance(unit: PanTiltLaser, spot: Spot, plane: Plane | None) -> float:
    """Return the variance of a measured point by the noise of its readings alone, summed over the three axes."""
    rows = _rows(spot, plane)
    noise = _find_noise(unit, rows, plane)
    return 0.0 if noise is None else float(np.trace(noise)) / len(rows)


def _find_noise(unit: PanTiltLaser, rows: Array, plane: Plane | None) -> Array | None:
    """Return the covariance (3, 3) of the first of some readings, without that of the unit's pose [m²]."""
    return _locate_reading(unit.with_pose(unit.pose), rows[0].tolist(), plane).covariance


def _rows(spot: Spot, plane: Plane | None) -> Array:
    """Return the checked readings (k, 3) [rad, rad, m]; on a plane the range is not used."""
    try:
        rows: Array = np.atleast_2d(np.stack(np.broadcast_arrays(*(np.asarray(x, float) for x in spot)), axis=-1))
    except (TypeError, ValueError):
        raise InvalidInput("spot", format_value(spot), "pan, tilt [rad] and range [m]") from None
    if rows.ndim != 2 or not len(rows):
        raise InvalidInput("spot", f"readings of shape {rows.shape[:-1]}", "one reading, or arrays (k,) of several")
    for name, values in zip(Spot._fields, rows.T, strict=True):
        if not np.isfinite(values).all() and (plane is None or name != "range"):
            raise InvalidInput("spot", f"{name} = {values[~np.isfinite(values)][0]}", "finite pan, tilt and range")
    return rows


def _locate_reading(unit: PanTiltLaser, row: list[float], plane: Plane | None) -> Sighting:
    """Return the spot as a unit locates it by one reading."""
    pan, tilt, distance = row
    return unit.angles(unit.point(pan, tilt, distance)) if plane is None else unit.intersect_plane(pan, tilt, plane)
