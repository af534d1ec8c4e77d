"""The pan-tilt laser: its points against chains of SciPy's rotations, its covariances against drawn noise."""

import pickle
from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import optik
from optik.errors import InvalidInput
from optik.types import Array
from planners.cell import Cell, PanTiltLaser, Plane, Sighting, SightStatus, Spot
from planners.cell.sighting import SHORTEST_NORMAL
from tests import oracles
from tests.seeds import shift_seed

coordinates = st.floats(-5.0, 5.0)
triples = st.tuples(coordinates, coordinates, coordinates)
poses = st.builds(oracles.pose, triples, triples)
pans, tilts, ranges = st.floats(-pi, pi), st.floats(-pi / 2, pi / 2), st.floats(1e-3, 1e3)

UNIT = PanTiltLaser(
    oracles.pose((0.3, -0.8, 2.0), (0.4, -1.2, 0.7)),
    pan_limits=(-2.0, 2.5),
    tilt_limits=(-0.6, 1.2),
    range_limits=(0.1, 20.0),
    angle_noise=1e-3,
    range_noise=2e-3,
)


def turned(T: Array, pan: float, tilt: float, distance: float) -> Array:
    """The point by a chain of frames: pan about z, then tilt about −y, then along x."""
    after_pan = oracles.pose((0.0, 0.0, pan), (0.0, 0.0, 0.0))
    after_tilt = oracles.pose((0.0, -tilt, 0.0), (0.0, 0.0, 0.0))
    return np.asarray((T @ after_pan @ after_tilt @ [distance, 0.0, 0.0, 1.0])[:3])


def covariance(seed: int, scale: float = 1e-3) -> Array:
    """A covariance of a pose's twist, with correlations between all of its six numbers."""
    A = np.random.default_rng(seed).normal(size=(6, 6)) * scale
    return A @ A.T


# ---------------------------------------------------------------- geometry
@given(poses, pans, tilts, ranges)
def test_a_point_is_where_the_chain_of_frames_ends(T: Array, pan: float, tilt: float, distance: float) -> None:
    unit = PanTiltLaser(T)
    assert np.abs(unit.point(pan, tilt, distance) - turned(T, pan, tilt, distance)).max() <= 1e-14 * (10.0 + distance)
    assert np.abs(unit.direction(pan, tilt) - turned(T, pan, tilt, 1.0) + T[:3, 3]).max() <= 1e-14


@pytest.mark.parametrize("seed", range(4))
def test_25_000_round_trips_both_ways_are_exact_to_a_picometre(seed: int) -> None:
    rng = np.random.default_rng(seed)
    unit = PanTiltLaser(oracles.pose(rng.normal(size=3), rng.uniform(-3.0, 3.0, 3)))
    points = rng.uniform(-10.0, 10.0, (25_000, 3))
    assert np.linalg.norm(unit.point(*unit.reading(points)) - points, axis=1).max() <= 1e-12
    spots = rng.uniform((-pi, -pi / 2, 0.05), (pi, pi / 2, 20.0), (25_000, 3))
    there = unit.point(*spots.T)
    assert np.linalg.norm(unit.point(*unit.reading(there)) - there, axis=1).max() <= 1e-12
    back = np.stack(unit.reading(there), axis=1)
    level = np.abs(spots[:, 1]) < 1.5  # nearer to the pan axis the pan is less certain than a picometre
    assert np.abs(back - spots)[level].max() <= 1e-12


@given(poses, triples)
def test_a_sighting_holds_the_readings_that_lead_back_to_the_point(T: Array, point: tuple[float, float, float]) -> None:
    unit = PanTiltLaser(T)
    seen = unit.angles(point)
    if np.linalg.norm(np.asarray(point) - T[:3, 3]) <= 1e-9:
        assert seen.status is SightStatus.AT_UNIT
    else:
        assert seen and seen.spot is not None
        assert np.linalg.norm(unit.point(*seen.spot) - point) <= 1e-13


@pytest.mark.parametrize("distance", [1e-8, 1e-3, 1e3, 5e5])
def test_near_and_far_points_keep_their_digits(distance: float) -> None:
    rng = np.random.default_rng(1)
    spots = rng.uniform((-pi, -1.5, distance), (pi, 1.5, 2 * distance), (200, 3))
    unit = PanTiltLaser(oracles.pose((0.3, -0.8, 2.0), (0.0, 0.0, 0.0)))
    back = np.stack(unit.reading(unit.point(*spots.T)), axis=1)
    assert np.abs(back - spots)[:, :2].max() <= 1e-13
    assert np.abs(back / spots - 1.0)[:, 2].max() <= 1e-15


@pytest.mark.parametrize("above", [1.0, -1.0])
def test_on_the_pan_axis_the_pan_is_the_one_nearest_to_zero_that_is_allowed(above: float) -> None:
    for limits, pan in (((-1.0, 1.0), 0.0), ((0.5, 2.0), 0.5), ((-2.0, -0.5), -0.5)):
        unit = PanTiltLaser(UNIT.pose, pan_limits=limits)
        point = unit.pose[:3, 3] + above * 1.7 * unit.pose[:3, 2]
        seen = unit.angles(point)
        assert seen.spot == pytest.approx((pan, above * pi / 2, 1.7), abs=1e-15)
        assert np.linalg.norm(unit.point(*seen.spot) - point) <= 1e-14
        assert unit.reading(point).pan == 0.0


def test_a_pan_is_turned_into_the_limits_where_one_of_its_turns_is_inside() -> None:
    unit = PanTiltLaser(np.eye(4), pan_limits=(0.0, 2 * pi))
    seen = unit.angles((0.0, -1.0, 0.0))
    assert seen.spot == pytest.approx((1.5 * pi, 0.0, 1.0), abs=1e-15)


def test_arrays_broadcast_and_agree_with_one_at_a_time() -> None:
    unit = UNIT.with_pose(UNIT.pose, covariance(3))
    pan, tilt, distance = np.linspace(-1, 1, 4)[:, None], np.linspace(-0.5, 1, 5), 2.0
    assert unit.direction(pan, tilt).shape == unit.point(pan, tilt, distance).shape == (4, 5, 3)
    assert unit.covariance(pan, tilt, distance).shape == (4, 5, 3, 3)
    by_reading, by_pose = unit.jacobians(pan, tilt, distance)
    assert (by_reading.shape, by_pose.shape) == ((4, 5, 3, 3), (4, 5, 3, 6))
    for i, j in np.ndindex(4, 5):
        one = unit.point(pan[i, 0], tilt[j], distance)
        assert np.abs(unit.point(pan, tilt, distance)[i, j] - one).max() <= 1e-15
        one = unit.covariance(pan[i, 0], tilt[j], distance)
        assert np.abs(unit.covariance(pan, tilt, distance)[i, j] - one).max() <= 1e-18


# ---------------------------------------------------------------- statuses of a point
def status_of(sighting: Sighting) -> SightStatus:
    """The status of a failure that says why and what to do, and holds nothing that could be taken for a point."""
    assert not sighting
    assert sighting.reason
    assert sighting.advice
    assert sighting.point is sighting.spot is sighting.covariance is None
    return sighting.status


@pytest.mark.parametrize(
    ("spot", "status"),
    [
        (Spot(2.6, 0.0, 1.0), SightStatus.BEHIND),  # 149°: outside the limit of 2.5, behind the unit
        (Spot(-2.1, 0.5, 1.0), SightStatus.BEHIND),
        (Spot(0.3, 1.3, 1.0), SightStatus.OUTSIDE_ANGLES),
        (Spot(0.3, -0.7, 1.0), SightStatus.OUTSIDE_ANGLES),
        (Spot(0.3, 0.2, 0.099), SightStatus.OUT_OF_RANGE),
        (Spot(0.3, 0.2, 20.1), SightStatus.OUT_OF_RANGE),
        (Spot(0.3, 0.2, 0.0), SightStatus.AT_UNIT),
    ],
)
def test_a_point_outside_the_limits_has_a_status(spot: Spot, status: SightStatus) -> None:
    assert status_of(UNIT.angles(turned(UNIT.pose, *spot))) is status


def test_a_point_in_front_but_outside_the_pan_limits_is_not_behind() -> None:
    unit = PanTiltLaser(np.eye(4), pan_limits=(-0.5, 0.5))
    assert status_of(unit.angles((1.0, 1.0, 0.0))) is SightStatus.OUTSIDE_ANGLES
    assert "45°" in unit.angles((1.0, 1.0, 0.0)).reason


@pytest.mark.parametrize(
    "spot", [(-2.0, 0.3, 1.0), (2.5, 0.3, 1.0), (0.0, 1.2, 1.0), (0.0, -0.6, 0.1), (0.0, 0.0, 20.0)]
)
def test_a_point_at_a_limit_is_inside(spot: tuple[float, float, float]) -> None:
    assert UNIT.angles(turned(UNIT.pose, *spot)).spot == pytest.approx(spot, abs=1e-12)


# ---------------------------------------------------------------- planes
@given(poses, st.floats(-1.5, 1.5), st.floats(-1.0, 1.0), triples, triples)
def test_a_beam_meets_a_plane_where_both_equations_hold(T: Array, pan: float, tilt: float, a: Array, n: Array) -> None:
    if np.linalg.norm(n) < 1e-3:
        return
    plane, unit = Plane(a, n), PanTiltLaser(T)
    d = turned(T, pan, tilt, 1.0) - T[:3, 3]
    along = float(d @ plane.normal)
    if abs(along) < 1e-3:
        return
    seen = unit.intersect_plane(pan, tilt, plane)
    distance = float((np.asarray(a) - T[:3, 3]) @ plane.normal) / along
    if distance < -1e-9:
        assert status_of(seen) is SightStatus.BEHIND
    elif distance > 1e-9:
        assert abs(float(plane.distance(seen.point))) <= 1e-11
        assert np.linalg.norm(np.cross(seen.point - T[:3, 3], d)) <= 1e-11
        assert seen.spot == pytest.approx((pan, tilt, distance), rel=1e-9)


def test_a_normal_may_be_short_but_has_a_length() -> None:
    for size in (SHORTEST_NORMAL, 1.01 * SHORTEST_NORMAL, 1e6):
        np.testing.assert_allclose(Plane((0, 0, 0), (0, 0, size)).normal, (0, 0, 1), atol=1e-15)
    with pytest.raises(InvalidInput, match="normal"):
        Plane((0, 0, 0), (0, 0, 0.99 * SHORTEST_NORMAL))


def test_a_reading_of_a_cell_carries_its_true_point() -> None:
    cell = Cell(optik.load("paper6r"), replace(UNIT, angle_noise=1e-3, range_noise=1e-3), "ideal")
    points = UNIT.point(*np.random.default_rng(2).uniform((-1.0, -0.8, 0.5), (1.0, 0.8, 3.0), (5, 3)).T)
    spots = [cell.read(point) for point in points]
    for spot, point in zip(spots, points, strict=True):
        assert cell.truth(spot)[1] and cell.truth(pickle.loads(pickle.dumps(spot)))[1]
        np.testing.assert_array_equal(cell.truth(spot)[0], point)
        where, known = cell.truth(Spot(*spot))
        assert not known and 0.0 < np.abs(where - point).max() < 0.05
    assert np.shape(cell.read(points[0], 2).pan) == (2,)
    with pytest.raises(InvalidInput, match="readings"):
        cell.read(points[0], 0)


def test_a_beam_along_a_plane_is_parallel() -> None:
    unit = PanTiltLaser(np.eye(4))
    floor = Plane((0.0, 0.0, -1.0), (0.0, 0.0, 3.0))
    assert status_of(unit.intersect_plane(0.7, 0.0, floor)) is SightStatus.PARALLEL
    assert status_of(unit.intersect_plane(0.7, 1e-12, floor)) is SightStatus.PARALLEL
    assert status_of(unit.intersect_plane(0.7, 0.1, floor)) is SightStatus.BEHIND
    assert unit.intersect_plane(0.7, -0.1, floor)
    inside = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    assert status_of(unit.intersect_plane(0.7, 0.0, inside)) is SightStatus.PARALLEL
    assert status_of(unit.intersect_plane(0.7, -0.1, inside)) is SightStatus.AT_UNIT


def test_the_limits_hold_on_a_plane() -> None:
    wall = Plane(turned(UNIT.pose, 0.0, 0.0, 5.0), UNIT.pose[:3, 0])
    assert UNIT.intersect_plane(0.3, 0.2, wall)
    assert status_of(UNIT.intersect_plane(0.3, 1.3, wall)) is SightStatus.OUTSIDE_ANGLES
    assert status_of(UNIT.intersect_plane(1.4, 0.2, wall)) is SightStatus.OUT_OF_RANGE


@given(poses, triples, triples)
def test_a_moved_plane_holds_the_moved_points(T: Array, a: Array, n: Array) -> None:
    if np.linalg.norm(n) < 1e-3:
        return
    plane = Plane(a, n)
    on = np.cross(plane.normal, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, 0.2, 0.9]]) + plane.point
    there = on @ T[:3, :3].T + T[:3, 3]
    assert np.abs(plane.transform(T).distance(there)).max() <= 1e-13
    assert float(plane.transform(T).distance(there[0] + 2.0 * T[:3, :3] @ plane.normal)) == pytest.approx(
        2.0, abs=1e-13
    )


# ---------------------------------------------------------------- noise
@given(poses, pans, tilts, st.floats(0.1, 10.0))
@settings(max_examples=20)
def test_the_jacobians_are_those_of_differences(T: Array, pan: float, tilt: float, distance: float) -> None:
    by_reading, by_pose = PanTiltLaser(T).jacobians(pan, tilt, distance)
    h = 1e-6
    for k, step in enumerate(np.eye(3) * h):
        ahead, back = np.add((pan, tilt, distance), step), np.subtract((pan, tilt, distance), step)
        assert by_reading[:, k] == pytest.approx((turned(T, *ahead) - turned(T, *back)) / (2 * h), abs=1e-8)
    for k, step in enumerate(np.eye(6) * h):
        there = []
        for sign in (1.0, -1.0):
            moved = np.eye(4)
            moved[:3, :3] = Rotation.from_rotvec(sign * step[3:]).as_matrix() @ T[:3, :3]
            moved[:3, 3] = T[:3, 3] + sign * step[:3]
            there.append(turned(moved, pan, tilt, distance))
        assert by_pose[:, k] == pytest.approx((there[0] - there[1]) / (2 * h), abs=1e-8)


def drawn_points(unit: PanTiltLaser, spot: Spot, count: int, seed: int) -> tuple[Array, Array]:
    """Origins and directions of beams at noisy angles from units at noisy poses, drawn without the library; and ranges."""
    rng = np.random.default_rng(seed)
    twists = rng.multivariate_normal(np.zeros(6), unit.pose_covariance, count)
    angles = rng.normal(spot[:2], unit.angle_noise, (count, 2))
    local = Rotation.from_euler("ZY", angles * [1.0, -1.0]).apply([1.0, 0.0, 0.0])
    turns = Rotation.from_rotvec(twists[:, 3:]) * Rotation.from_matrix(unit.pose[:3, :3])
    return unit.pose[:3, 3] + twists[:, :3], turns.apply(local)


def assert_same_covariance(found: Array, drawn: Array) -> None:
    """Equal within five standard errors of a drawn covariance, entry by entry."""
    expected = np.cov(drawn.T)
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs(found - expected).max() <= 0.0 + (5.0 * size * np.sqrt(2.0 / len(drawn))).max()
    assert np.trace(found) == pytest.approx(np.trace(expected), rel=5.0 * np.sqrt(2.0 / len(drawn)))


def test_the_covariance_of_a_point_is_that_of_drawn_noise() -> None:
    unit, spot = UNIT.with_pose(UNIT.pose, covariance(7)), Spot(0.7, 0.4, 3.0)
    origins, directions = drawn_points(unit, spot, 40_000, 1)
    ranges = np.random.default_rng(2).normal(3.0, unit.range_noise, 40_000)
    assert_same_covariance(unit.covariance(*spot), origins + ranges[:, None] * directions)
    assert unit.angles(unit.point(*spot)).covariance == pytest.approx(unit.covariance(*spot), abs=1e-15)


def test_the_covariance_on_a_plane_is_that_of_drawn_beams_and_lies_in_the_plane() -> None:
    unit = UNIT.with_pose(UNIT.pose, covariance(7))
    plane = Plane(turned(unit.pose, 0.5, 0.2, 2.0), unit.pose[:3, :3] @ (1.0, 0.9, -0.5))
    seen = unit.intersect_plane(0.7, 0.4, plane)
    origins, directions = drawn_points(unit, seen.spot, 40_000, 1)
    distances = ((plane.point - origins) @ plane.normal) / (directions @ plane.normal)
    assert_same_covariance(seen.covariance, origins + distances[:, None] * directions)
    assert np.abs(seen.covariance @ plane.normal).max() <= 1e-18
    assert np.linalg.matrix_rank(seen.covariance, tol=1e-12) == 2
    without = PanTiltLaser(unit.pose, angle_noise=unit.angle_noise, pose_covariance=unit.pose_covariance)
    assert without.intersect_plane(0.7, 0.4, plane).covariance == pytest.approx(seen.covariance, abs=1e-18)


def test_a_reading_has_the_noise_that_the_unit_states() -> None:
    point = turned(UNIT.pose, 0.4, 0.3, 2.0)
    drawn = np.stack(UNIT.read(np.tile(point, (20_000, 1)), np.random.default_rng(shift_seed(5))), axis=1) - (
        0.4,
        0.3,
        2.0,
    )
    assert drawn.std(axis=0) == pytest.approx((1e-3, 1e-3, 2e-3), rel=5.0 / np.sqrt(2 * 20_000))
    assert np.abs(drawn.mean(axis=0)).max() <= 5.0 * 2e-3 / np.sqrt(20_000)
    assert UNIT.read(point, np.random.default_rng(1)) == UNIT.read(point, np.random.default_rng(1))
    assert all(np.ndim(x) == 0 for x in UNIT.read(point, np.random.default_rng(1)))


def test_a_range_is_read_as_no_less_than_zero() -> None:
    unit = PanTiltLaser(np.eye(4), range_noise=1.0)
    assert min(unit.read(np.full((50, 3), 1e-3), np.random.default_rng(0)).range) == 0.0


# ---------------------------------------------------------------- input
@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("pose", np.full((4, 4), np.nan)), ("pose", np.eye(3)), ("angle_noise", float("nan")), ("angle_noise", -1e-3),
        ("angle_noise", None), ("range_noise", inf), ("range_noise", -1.0), ("pan_limits", (1.0, -1.0)),
        ("pan_limits", (float("nan"), 1.0)), ("pan_limits", (-7.0, 0.0)), ("tilt_limits", (-1.6, 0.0)),
        ("tilt_limits", (0.0,)), ("range_limits", (-0.1, 1.0)), ("range_limits", (2.0, 1.0)),
        ("pose_covariance", np.eye(3)), ("pose_covariance", np.full((6, 6), np.nan)), ("pose_covariance", -np.eye(6)),
        ("pose_covariance", np.triu(np.ones((6, 6)))),
    ],
)  # fmt: skip
def test_a_wrong_argument_is_named(argument: str, value: object) -> None:
    with pytest.raises(InvalidInput, match=rf"^{argument}: "):
        PanTiltLaser(**{"pose": np.eye(4), argument: value})


@pytest.mark.parametrize(
    ("argument", "call"),
    [
        ("pan", lambda: UNIT.point(float("nan"), 0.0, 1.0)),
        ("tilt", lambda: UNIT.point(0.0, inf, 1.0)),
        ("range", lambda: UNIT.point(0.0, 0.0, -1.0)),
        ("range", lambda: UNIT.covariance(0.0, 0.0, "far")),
        ("pan, tilt, range", lambda: UNIT.point([0.0, 1.0], [0.0, 1.0, 2.0], 1.0)),
        ("point", lambda: UNIT.angles((0.0, float("nan"), 1.0))),
        ("point", lambda: UNIT.angles(np.zeros((2, 3)))),
        ("point", lambda: UNIT.angles((1e7, 0.0, 0.0))),
        ("points", lambda: UNIT.reading(np.zeros(4))),
        ("plane", lambda: UNIT.intersect_plane(0.0, 0.0, ((0, 0, 0), (0, 0, 1)))),
        ("tilt", lambda: UNIT.intersect_plane(0.0, float("nan"), Plane((0, 0, 0), (0, 0, 1)))),
        ("normal", lambda: Plane((0, 0, 0), (0, 0, 0))),
        ("normal", lambda: Plane((0, 0, 0), (0, 0, float("nan")))),
        ("point", lambda: Plane((0, 0), (0, 0, 1))),
        ("T", lambda: Plane((0, 0, 0), (0, 0, 1)).transform(np.zeros((4, 4)))),
        ("pose", lambda: UNIT.with_pose(np.zeros((4, 4)))),
    ],
)
def test_a_wrong_value_is_named(argument: str, call: object) -> None:
    with pytest.raises(InvalidInput, match=rf"^{argument}: "):
        call()


def test_a_unit_at_another_pose_keeps_limits_and_noise_but_not_the_covariance_of_its_old_pose() -> None:
    known = UNIT.with_pose(np.eye(4), covariance(1))
    assert known.pose_covariance == pytest.approx(covariance(1), abs=1e-18)
    there = known.with_pose(UNIT.pose)
    assert there.pose_covariance is None
    assert (there.pan_limits, there.tilt_limits, there.range_limits) == ((-2.0, 2.5), (-0.6, 1.2), (0.1, 20.0))
    assert (there.angle_noise, there.range_noise) == (1e-3, 2e-3)


def test_a_unit_is_immutable_and_can_be_sent_to_another_process() -> None:
    with pytest.raises(ValueError, match="read-only"):
        UNIT.pose[0, 0] = 2.0
    with pytest.raises(AttributeError):
        UNIT.angle_noise = 0.0
    other = pickle.loads(pickle.dumps(UNIT))
    assert (other.point(0.3, 0.2, 1.0) == UNIT.point(0.3, 0.2, 1.0)).all()


def test_a_pose_of_seven_digits_becomes_a_rotation_and_keeps_round_trips_exact() -> None:
    unit = PanTiltLaser(np.round(UNIT.pose, 7))
    points = np.random.default_rng(3).uniform(-5.0, 5.0, (1000, 3))
    assert np.linalg.norm(unit.point(*unit.reading(points)) - points, axis=1).max() <= 1e-12
