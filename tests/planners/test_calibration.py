"""Calibration of a laser unit: against SciPy's least squares, drawn noise and the chi-square law of its own covariance."""

import re
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize, stats
from scipy.spatial.transform import Rotation

from optik.errors import InvalidInput
from optik.types import Array
from planners.cell import Calibration, CalibrationStatus, PanTiltLaser, calibrate
from planners.cell.calibration import CONFIDENCE
from tests import oracles
from tests.seeds import shift_seed

UNIT = PanTiltLaser(np.eye(4), angle_noise=1e-3, range_noise=1e-3)
"""The unit as it is known before: 1 mrad and 1 mm, somewhere."""
QUANTILE = 20.06
"""Of the chi-square law with six degrees of freedom at 99.73 %, as three standard deviations of one number."""
CHANCE = 0.9973


def drawn_truth(rng: np.random.Generator) -> PanTiltLaser:
    """The unit where it really stands."""
    return UNIT.with_pose(oracles.pose(rng.normal(size=3) * 2.0, rng.uniform(-1.0, 1.0, 3)))


def drawn_points(truth: PanTiltLaser, rng: np.random.Generator, count: int = 12) -> Array:
    """Known points in front of a unit, 0.5 to 3 m away."""
    return truth.point(*rng.uniform((-1.0, -0.8, 0.5), (1.0, 0.8, 3.0), (count, 3)).T)


def paired(spots: Array, points: Array) -> list[tuple[Array, Array]]:
    return list(zip(spots, points, strict=True))


def drawn(seed: int, count: int = 12) -> tuple[PanTiltLaser, Array, Array]:
    """A true unit, its noisy readings (m, 3) and the points (m, 3)."""
    rng = np.random.default_rng([shift_seed(13), seed])
    truth = drawn_truth(rng)
    points = drawn_points(truth, rng, count)
    return truth, np.stack(truth.read(points, rng), axis=1), points


def moved(T: Array, twist: Array) -> Array:
    """A pose displaced by v and turned by ω about its own origin, along and about the base's axes."""
    return oracles.moved(T, twist[:3], twist[3:])


def pose_error(found: Array, true: Array) -> Array:
    """The twist (v, ω) from the found pose to the true one, by SciPy."""
    turn = Rotation.from_matrix(true[:3, :3] @ found[:3, :3].T).as_rotvec()
    return np.concatenate([true[:3, 3] - found[:3, 3], turn])


def squared_distance(calibration: Calibration, truth: PanTiltLaser) -> float:
    """Squared Mahalanobis distance of the pose's error; infinite for a calibration that failed."""
    if calibration.laser is None:
        return float("inf")
    e = pose_error(calibration.laser.pose, truth.pose)
    return float(e @ np.linalg.solve(calibration.covariance, e))


def plain_residuals(T: Array, spots: Array, points: Array) -> Array:
    """Standardised residuals, written anew: the point by trigonometry in the unit's frame."""
    rows = []
    for (pan, tilt, distance), point in zip(spots, points, strict=True):
        x, y, z = np.linalg.solve(T, [*point, 1.0])[:3]
        turn = complex(np.cos(pan), np.sin(pan)) * complex(x, -y)
        off = (np.angle(turn), tilt - np.arcsin(z / np.linalg.norm((x, y, z))), distance - np.linalg.norm((x, y, z)))
        rows.append(np.divide(off, (UNIT.angle_noise, UNIT.angle_noise, UNIT.range_noise)))
    return np.array(rows)


# ---------------------------------------------------------------- the fit
@pytest.mark.parametrize("seed", range(5))
def test_the_pose_and_its_covariance_are_those_of_scipys_least_squares(seed: int) -> None:
    truth, spots, points = drawn(seed)
    found = calibrate(paired(spots, points), UNIT)

    def cost(twist: Array) -> Array:
        return plain_residuals(moved(truth.pose, twist), spots, points).ravel()

    best = optimize.least_squares(cost, np.zeros(6), jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    off = pose_error(found.laser.pose, moved(truth.pose, best.x))
    sigma = np.sqrt(np.diag(found.covariance))
    assert np.abs(off / sigma).max() <= 1e-4
    assert found.chi_squared == pytest.approx(2.0 * best.cost, rel=1e-9)
    J = optimize.approx_fprime(
        np.zeros(6), lambda t: plain_residuals(moved(found.laser.pose, t), spots, points).ravel(), 1e-7
    )
    assert found.covariance / np.outer(sigma, sigma) == pytest.approx(
        np.linalg.inv(J.T @ J) / np.outer(sigma, sigma), abs=1e-4
    )
    assert (found.laser.pose_covariance == found.covariance).all()


@given(st.integers(0, 2**31), st.integers(4, 30))
def test_exact_readings_give_the_exact_pose(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    truth = drawn_truth(rng)
    points = truth.point(*rng.uniform((-3.1, -1.5, 0.5), (3.1, 1.5, 3.0), (count, 3)).T)
    found = calibrate(paired(np.stack(truth.reading(points), axis=1), points), UNIT)
    if found.status is CalibrationStatus.COLLINEAR:  # four random points may nearly be
        return
    assert found
    assert np.abs(pose_error(found.laser.pose, truth.pose)).max() <= 1e-8
    assert np.abs(found.residuals).max() <= 1e-8
    assert not found.outliers


def test_residuals_are_readings_minus_what_the_found_unit_reads() -> None:
    _, spots, points = drawn(3)
    found = calibrate(paired(spots, points), UNIT)
    assert found.residuals == pytest.approx(spots - np.stack(found.laser.reading(points), axis=1), abs=1e-12)
    assert found.residuals.std() <= 2e-3
    assert found.freedom == 36 - 6
    assert (found.laser.angle_noise, found.laser.range_noise) == (1e-3, 1e-3)


def test_a_pan_at_the_half_turn_is_read_on_either_side() -> None:
    truth = UNIT.with_pose(oracles.pose((0.2, 0.1, 1.0), (0.3, 0.2, 0.1)))
    rng = np.random.default_rng(5)
    spots = rng.uniform((np.pi - 0.2, -0.8, 0.5), (np.pi + 0.2, 0.8, 3.0), (12, 3))
    points = truth.point(*spots.T)
    spots[:, 0] = np.where(np.arange(12) % 2, spots[:, 0], spots[:, 0] - 2 * np.pi)
    found = calibrate(paired(spots, points), UNIT)
    assert found
    assert np.abs(pose_error(found.laser.pose, truth.pose)).max() <= 1e-8


def test_points_beside_the_pan_axis_do_not_spoil_the_pose_or_its_covariance() -> None:
    distances = []
    for seed in range(30):
        rng = np.random.default_rng([shift_seed(17), seed])
        truth = drawn_truth(rng)
        spots = rng.uniform((-3.1, -1.5, 0.5), (3.1, 1.5, 3.0), (12, 3))
        spots[:4, 1] = np.pi / 2 - 10.0 ** rng.uniform(-6, -1, 4)
        points = truth.point(*spots.T)
        found = calibrate(paired(np.stack(truth.read(points, rng), axis=1), points), UNIT)
        assert found.status is not CalibrationStatus.NOT_CONVERGED
        distances.append(squared_distance(found, truth))
    assert stats.kstest(distances, stats.chi2(6).cdf).pvalue >= 1e-3


def test_a_pan_beside_the_pan_axis_is_not_used() -> None:
    truth, spots, points = drawn(4)
    points[0] = truth.point(0.0, np.pi / 2 - 1e-5, 2.0)
    spots[0] = (2.7, np.pi / 2, 2.0)  # any pan, for that point
    found = calibrate(paired(spots, points), UNIT)
    assert found
    assert not found.outliers
    assert found.freedom == 36 - 6 - 1
    assert squared_distance(found, truth) <= QUANTILE


# ---------------------------------------------------------------- the covariance
@cache
def distances_of(trials: int) -> Array:
    """Squared Mahalanobis distances of the pose's error, of 12 noisy pairs each, outliers searched for."""
    found = []
    for seed in range(trials):
        truth, spots, points = drawn(seed)
        found.append(squared_distance(calibrate(paired(spots, points), UNIT), truth))
    return np.array(found)


def test_the_errors_of_80_calibrations_follow_the_chi_square_law() -> None:
    distances = distances_of(80)
    misses = int(np.count_nonzero(distances > QUANTILE))
    # A calibration is refused as inconsistent with a probability of 0.1 %, which counts as a miss, too.
    assert stats.binomtest(misses, 80, 1.0 - CHANCE + 1e-3, alternative="greater").pvalue >= 1e-4
    assert stats.kstest(distances, stats.chi2(6).cdf).pvalue >= 1e-3


@pytest.mark.soak
def test_of_10_000_calibrations_99_0_to_99_95_percent_have_the_pose_inside_the_ellipsoid() -> None:
    share = float(np.mean(distances_of(10_000) <= QUANTILE))
    assert 0.990 <= share <= 0.9995, share


def test_the_covariance_of_the_pose_is_that_of_repeated_calibrations() -> None:
    truth, _, points = drawn(6)
    rng = np.random.default_rng(shift_seed(1))
    found = [calibrate(paired(np.stack(truth.read(points, rng), axis=1), points), UNIT) for _ in range(60)]
    errors = np.array([pose_error(c.laser.pose, truth.pose) for c in found if c])
    expected = np.mean([c.covariance for c in found], axis=0)
    whitened = np.linalg.solve(np.linalg.cholesky(expected), errors.T)
    assert np.cov(whitened) == pytest.approx(np.eye(6), abs=5.0 * np.sqrt(2.0 / len(errors)))
    assert np.abs(whitened.mean(axis=1)).max() <= 4.0 / np.sqrt(len(errors))


# ---------------------------------------------------------------- outliers
def spoilt(seed: int, count: int, pairs: int = 12) -> tuple[PanTiltLaser, Array, Array, tuple[int, ...]]:
    """Readings of which some have a gross error in pan, tilt, range or all: 20 standard deviations or more."""
    truth, spots, points = drawn(seed, pairs)
    rng = np.random.default_rng([shift_seed(7), seed])
    bad = np.sort(rng.choice(pairs, count, replace=False))
    for i in bad:
        which = rng.integers(4)
        off = rng.choice([-1.0, 1.0], 3) * rng.uniform(0.02, 0.5, 3)
        spots[i] += off if which == 3 else off * (np.arange(3) == which)
    return truth, np.maximum(spots, (-np.inf, -np.inf, 0.01)), points, tuple(int(i) for i in bad)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_outliers_are_found_and_not_the_other_pairs(count: int) -> None:
    for seed in range(8):
        truth, spots, points, bad = spoilt(seed, count)
        found = calibrate(paired(spots, points), UNIT)
        assert found, found.reason
        assert found.outliers == bad
        assert squared_distance(found, truth) <= QUANTILE
        without = np.delete(np.arange(12), bad)
        again = calibrate(paired(spots[without], points[without]), UNIT)
        assert np.abs(pose_error(found.laser.pose, again.laser.pose)).max() <= 1e-8
        assert found.covariance == pytest.approx(again.covariance, rel=1e-6)
        assert found.freedom == again.freedom


@pytest.mark.parametrize("seed", range(4))
def test_outliers_are_found_where_most_points_are_on_one_line(seed: int) -> None:
    truth, _, points = drawn(seed)
    points[:8] = points[0] + np.linspace(0.0, 1.0, 8)[:, None] * (points[1] - points[0])
    spots = np.stack(truth.read(points, np.random.default_rng(seed)), axis=1)
    spots[:8] = np.stack(truth.reading(points[:8]), axis=1)  # a triple of them fits most pairs best
    spots[10] += (0.2, 0.3, 0.4)
    found = calibrate(paired(spots, points), UNIT)
    assert found, found.reason
    assert found.outliers == (10,)
    assert squared_distance(found, truth) <= QUANTILE


@pytest.mark.soak
@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_of_2_000_calibrations_the_outliers_are_found_and_hardly_ever_another_pair(count: int) -> None:
    wrong = 0
    for seed in range(2000):
        _, spots, points, bad = spoilt(seed, count)
        wrong += calibrate(paired(spots, points), UNIT).outliers != bad
    assert stats.binomtest(wrong, 2000, 1e-3, alternative="greater").pvalue >= 1e-4, wrong


def test_the_distance_of_a_pair_is_that_from_the_fit_of_the_others() -> None:
    _, spots, points = drawn(8)
    spots[3] += (2e-3, -1e-3, 2e-3)  # suspicious, and no outlier
    found = calibrate(paired(spots, points), UNIT)
    assert not found.outliers
    for i in (0, 3, 7):
        rest = np.delete(np.arange(12), i)
        other = calibrate(paired(spots[rest], points[rest]), UNIT)
        T = other.laser.pose
        e = plain_residuals(T, spots[[i]], points[[i]]).ravel()
        J = optimize.approx_fprime(
            np.zeros(6), lambda t, i=i, T=T: plain_residuals(moved(T, t), spots[[i]], points[[i]]).ravel(), 1e-7
        )
        expected = float(e @ np.linalg.solve(np.eye(3) + J @ other.covariance @ J.T, e))
        assert found.distances[i] == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("pairs", [8, 12, 30, 100])
def test_a_pair_is_an_outlier_just_beyond_the_quantile_of_the_farthest_of_all_pairs(pairs: int) -> None:
    """One pair is moved until its distance is 0.99 and 1.01 of the quantile at which noise loses none of all pairs."""
    truth, _, points = drawn(pairs, pairs)
    spots = np.stack(truth.reading(points), axis=1)
    rng = np.random.default_rng([3, pairs])
    away = rng.normal(size=3) * (UNIT.angle_noise, UNIT.angle_noise, UNIT.range_noise)
    quantile = stats.chi2(3).isf((1.0 - CONFIDENCE) / pairs)

    def found(size: float) -> Calibration:
        moved_ = spots.copy()
        moved_[2] += size * away
        return calibrate(paired(moved_, points), UNIT)

    size = 1.0
    for _ in range(4):  # distances grow with the square
        size *= np.sqrt(0.99 * quantile / found(size).distances[2])
    assert found(size).distances[2] == pytest.approx(0.99 * quantile, rel=1e-3)
    assert found(size) and found(size).outliers == ()
    beyond = found(size * np.sqrt(1.01 / 0.99))
    assert beyond and beyond.outliers == (2,)


def test_a_calibration_is_inconsistent_just_beyond_the_quantile_of_its_residuals() -> None:
    truth, _, points = drawn(1)
    rng = np.random.default_rng(5)
    noise = rng.choice([-1.0, 1.0], (12, 3)) * (UNIT.angle_noise, UNIT.angle_noise, UNIT.range_noise)
    most = stats.chi2(30).isf(1.0 - CONFIDENCE)

    def found(size: float) -> Calibration:
        return calibrate(paired(np.stack(truth.reading(points), axis=1) + size * noise, points), UNIT)

    size = 1.0
    for _ in range(6):
        size *= np.sqrt(0.99 * most / found(size).chi_squared)
    assert found(size).freedom == 30 and found(size).chi_squared == pytest.approx(0.99 * most, rel=1e-3)
    assert found(size)
    assert found(size * np.sqrt(1.01 / 0.99)).status is CalibrationStatus.INCONSISTENT


def test_more_outliers_than_may_be_left_out_are_a_status() -> None:
    _, spots, points, _ = spoilt(0, 8)
    found = calibrate(paired(spots, points), UNIT)
    assert found.status is CalibrationStatus.TOO_MANY_OUTLIERS
    assert found.laser is None
    assert "at most 3" in found.reason
    assert found.advice


@pytest.mark.parametrize("pairs", [3, 4])
def test_of_four_pairs_none_is_left_out_but_a_wrong_one_is_noticed(pairs: int) -> None:
    _, spots, points = drawn(2, pairs)
    assert calibrate(paired(spots, points), UNIT)
    spots[1] += (0.1, 0.0, 0.1)
    found = calibrate(paired(spots, points), UNIT)
    assert found.status is CalibrationStatus.INCONSISTENT
    assert not found
    assert found.outliers == ()
    assert found.laser is None


# ---------------------------------------------------------------- points that do not do
@pytest.mark.parametrize("off", [0.0, 1e-4])
def test_points_on_a_line_are_a_status(off: float) -> None:
    truth = drawn_truth(np.random.default_rng(1))
    rng = np.random.default_rng(2)
    points = truth.pose[:3, 3] + truth.pose[:3, 0] + np.linspace(0.0, 2.0, 12)[:, None] * (0.3, 0.5, -0.2)
    points += off * rng.normal(size=points.shape)
    found = calibrate(paired(np.stack(truth.read(points, rng), axis=1), points), UNIT)
    assert found.status is CalibrationStatus.COLLINEAR
    assert found.laser is None
    assert "line" in found.reason
    assert bool(np.isnan(found.covariance).all()) == (off == 0.0)


@pytest.mark.parametrize("size", [0.002, 0.0])
def test_points_that_are_too_near_to_each_other_are_not_called_a_line(size: float) -> None:
    truth = drawn_truth(np.random.default_rng(1))
    rng = np.random.default_rng(2)
    points = truth.pose[:3, 3] + truth.pose[:3, 0] + rng.uniform(-0.5 * size, 0.5 * size, (12, 3))
    found = calibrate(paired(np.stack(truth.read(points, rng), axis=1), points), UNIT)
    assert found.status is CalibrationStatus.COLLINEAR and "farther apart" in found.advice
    assert "line" not in found.reason and f"span only {1e3 * np.ptp(points, axis=0).max():.3g} mm" in found.reason


@pytest.mark.parametrize("through", [0.0, 1.0])
def test_points_on_the_graph_paper_are_enough_even_with_the_unit_in_their_plane(through: float) -> None:
    rng = np.random.default_rng(3)
    truth = drawn_truth(rng)
    R, p = truth.pose[:3, :3], truth.pose[:3, 3]
    local = np.column_stack([rng.uniform(0.8, 2.0, 12), rng.uniform(-0.7, 0.7, 12), np.full(12, 0.3 * through)])
    points = p + local @ R.T
    found = calibrate(paired(np.stack(truth.read(points, rng), axis=1), points), UNIT)
    assert found
    assert squared_distance(found, truth) <= QUANTILE


@pytest.mark.parametrize(
    ("argument", "pairs", "laser"),
    [
        ("pairs", [((0.1, 0.2, 1.0), (1.0, 0.0, 0.0))] * 2, UNIT),
        ("pairs", 3, UNIT),
        ("pairs", [1, 2, 3], UNIT),
        ("pairs[1][0]", [((0, 0, 1), (1, 0, 0)), ((0, np.nan, 1), (1, 0, 0)), ((0, 0, 1), (1, 0, 0))], UNIT),
        ("pairs[2][1]", [((0, 0, 1), (1, 0, 0)), ((0, 0, 1), (1, 0, 0)), ((0, 0, 1), (1, 0))], UNIT),
        ("pairs[1][0]", [((0, 0, 1), (1, 0, 0)), ((0, 0, 0), (1, 0, 0)), ((0, 0, 1), (1, 0, 0))], UNIT),
        ("laser", [((0, 0, 1), (1, 0, 0))] * 3, PanTiltLaser(np.eye(4), range_noise=1e-3)),
        ("laser", [((0, 0, 1), (1, 0, 0))] * 3, PanTiltLaser(np.eye(4), angle_noise=1e-3)),
        ("laser", [((0, 0, 1), (1, 0, 0))] * 3, np.eye(4)),
    ],
)
def test_a_wrong_argument_is_named(argument: str, pairs: object, laser: object) -> None:
    with pytest.raises(InvalidInput, match="^" + re.escape(argument) + ": "):
        calibrate(pairs, laser)


def test_the_same_pairs_give_the_same_pose_in_any_order() -> None:
    _, spots, points, _ = spoilt(5, 3, 40)
    order = np.random.default_rng(1).permutation(40)
    first, second = (calibrate(paired(s, p), UNIT) for s, p in ((spots, points), (spots[order], points[order])))
    assert first
    assert sorted(order[list(second.outliers)]) == list(first.outliers)
    assert np.abs(pose_error(first.laser.pose, second.laser.pose)).max() <= 1e-8
