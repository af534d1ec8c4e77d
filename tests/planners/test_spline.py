"""Curves near points: what the points are, how near and how smooth the curve is, its derivatives and bounds, and its plans."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import optik
from optik.errors import AssumptionWarning, InvalidInput
from optik.types import Array
from planners import MotionLimits, Spline, make_law, plan
from planners.paths import make_path
from planners.paths.base import Path as Curve
from tests import oracles
from tests.figures.spline import KINDS, arm, derivatives, distances, drawn, excess, scan, turned, uneven
from tests.planners.cases import START, paper6r

UP = np.eye(3)


def wave(count: int, noise: float = 0.0) -> Array:
    """Points along a smooth curve of 0.2 m [m]."""
    t = np.linspace(0.0, 1.0, count)
    points = np.stack([0.2 * t, 0.03 * np.sin(6.0 * t), 0.02 * t * t], axis=1)
    return np.asarray(points + noise * np.random.default_rng(5).normal(size=points.shape))


def rates(path: Curve, order: int) -> Array:
    """Norms of a derivative of the position at many places."""
    return np.asarray(np.linalg.norm(path(np.linspace(0.0, path.end, 5001), order)[:, :3], axis=1))


# ---------------------------------------------------------------- which points it answers
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "reversal"])
@pytest.mark.parametrize("seed", [*range(2), *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(2, 15))])
def test_any_points_without_a_reversal_give_a_curve_within_the_tolerance(kind: str, seed: int) -> None:
    rng = np.random.default_rng([22, seed])
    points, noise = drawn(rng, kind)
    tolerance = (max(10.0 ** rng.uniform(-6.0, -3.0), 1.5 * noise), 10.0 ** rng.uniform(-4.0, -1.0))
    path = Spline(points, orientation=UP, tolerance=tolerance)
    assert (
        distances(path, points).max()
        <= path.deviation[0] * (1.0 + 1e-6) + 1e-12 * np.ptp(points)
        <= tolerance[0] * 1.001
    )
    np.testing.assert_allclose(path(np.array([0.0, path.end]))[:, :3, 3], points[[0, -1]], rtol=1e-15, atol=1e-15)
    assert excess(path, rng, 300)[0] <= 1.0
    if noise == 0.0:
        poses = turned(rng, points)
        through = Spline(poses, tolerance=0)
        assert max(through.deviation) <= 1e-12 * np.ptp(points) + 1e-9
        assert distances(through, points).max() <= 1e-9 * np.ptp(points)
        assert excess(through, rng, 300)[0] <= 1.0


def test_two_points_make_the_line_and_three_a_parabola() -> None:
    ends = np.array([[0.1, 0.2, 0.3], [0.4, 0.2, -0.1]])
    for tolerance in (0, (1e-4, 1e-3)):
        path = Spline(ends, orientation=UP, tolerance=tolerance)
        assert path.end == pytest.approx(0.5, rel=1e-15)
        s = np.linspace(0.0, path.end, 50)
        np.testing.assert_allclose(path(s)[:, :3, 3], ends[0] + np.outer(s / 0.5, ends[1] - ends[0]), atol=1e-15)
    bent = Spline([[0, 0, 0], [0.1, 0.05, 0], [0.2, 0, 0]], orientation=UP, tolerance=0)
    assert rates(bent, 3).max() <= 1e-6 * rates(bent, 2).max() / 0.1
    np.testing.assert_allclose(bent(bent.end / 2)[:3, 3], [0.1, 0.05, 0], atol=1e-15)


def test_a_repeated_point_changes_nothing_and_a_turn_there_is_refused_by_its_row() -> None:
    points = wave(20)
    twice = np.insert(points, 7, points[7], axis=0)
    assert Spline(twice, orientation=UP, tolerance=0).to_dict() == Spline(points, orientation=UP, tolerance=0).to_dict()
    poses = np.stack([optik.se3.pose(UP, p) for p in twice])
    poses[8:, :3, :3] = Rotation.from_rotvec([0.3, 0.0, 0.0]).as_matrix()
    for tolerance in (0, (1e-3, 1e-3)):
        with pytest.raises(InvalidInput, match=r"points\[8\]: .*turn of the tool at one point"):
            Spline(poses, tolerance=tolerance)


def test_points_that_wait_are_no_length() -> None:
    rng = np.random.default_rng(2)
    points = np.concatenate(
        [wave(2)[:1] + 2e-5 * rng.normal(size=(200, 3)), wave(200), np.repeat(wave(2)[1:], 100, axis=0)]
    )
    waiting, moving = (Spline(x, orientation=UP, tolerance=(2e-4, 1e-3)) for x in (points, wave(200)))
    assert waiting.end == pytest.approx(moving.end, rel=2e-3)
    assert rates(waiting, 1).min() > 0.9


def test_a_curve_of_larger_points_is_the_larger_curve() -> None:
    points = wave(60)
    for scale in (1e-3, 1.0, 1e4):
        for tolerance in (0, (1e-4, 1e-3)):
            own = (scale * tolerance[0], tolerance[1]) if isinstance(tolerance, tuple) else 0
            small = Spline(points, orientation=UP, tolerance=tolerance)
            large = Spline(scale * points, orientation=UP, tolerance=own)
            s = np.linspace(0.0, 1.0, 101)
            near = 1e-9 if tolerance == 0 else 1e-5
            np.testing.assert_allclose(
                large(s * large.end)[:, :3, 3] / scale, small(s * small.end)[:, :3, 3], rtol=0.0, atol=near
            )


# ---------------------------------------------------------------- smoothness
def test_noise_makes_no_waves() -> None:
    t = np.linspace(0.0, 1.9 * np.pi, 4000)
    circle = 0.1 * np.stack([np.cos(t), np.sin(t), 0.0 * t], axis=1)
    circle += 5e-5 * np.random.default_rng(3).normal(size=circle.shape)
    path = Spline(circle, orientation=UP, tolerance=(3e-4, 1e-3))
    assert path.breaks.size < 30
    assert rates(path, 2).max() < 1.1 / 0.1
    assert rates(path, 3).max() < 1.3 / 0.1**2
    line = Spline(np.outer(np.linspace(0, 1, 4000), [0.3, 0.0, 0.4]) + circle * [0, 0, 0], orientation=UP)
    assert rates(line, 2).max() < 1e-6


def test_a_larger_tolerance_makes_less_jerk() -> None:
    points = wave(2000, noise=5e-5)
    jerk = [rates(Spline(points, orientation=UP, tolerance=(x, 1e-3)), 3).max() for x in (2.5e-4, 5e-4, 2e-3)]
    assert jerk[0] > jerk[1] > jerk[2]


def test_s_is_nearly_the_length() -> None:
    path = Spline(wave(40), orientation=UP, tolerance=0)
    np.testing.assert_allclose(rates(path, 1), 1.0, atol=2e-4)
    near = Spline(wave(4000, 5e-5), orientation=UP, tolerance=(3e-4, 1e-3))
    np.testing.assert_allclose(rates(near, 1), 1.0, atol=0.05)


# ---------------------------------------------------------------- derivatives and bounds
def test_derivatives_are_those_of_the_power_series() -> None:
    rng = np.random.default_rng(4)
    path = Spline(turned(rng, wave(80, 2e-5)), tolerance=(2e-4, 5e-3))
    s = rng.random(500) * path.end
    p, R = derivatives(path, s)
    np.testing.assert_allclose(path(s)[:, :3, 3], p[0], atol=1e-15)
    for order in (1, 2, 3):
        np.testing.assert_allclose(path(s, order)[:, :3], p[order], atol=1e-10 * np.abs(p[order]).max())
    for mine, theirs in zip(oracles.rotation_derivatives(path, s), R, strict=False):
        np.testing.assert_allclose(mine, theirs, atol=1e-11 * max(np.abs(theirs).max(), 1.0))


def test_the_fourth_derivative_is_continuous() -> None:
    path = Spline(turned(np.random.default_rng(6), wave(30)), tolerance=0)
    inner, step = path.breaks[1:-1], 1e-9 * path.end
    for before, after in zip(derivatives(path, inner - step), derivatives(path, inner + step), strict=True):
        size = np.abs(before[4]).max()
        assert size > 0.0 and np.abs(after[4] - before[4]).max() <= 1e-5 * size


@pytest.mark.parametrize("seed", range(4))
def test_no_derivative_passes_its_bound_where_the_tool_turns_far_between_points(seed: int) -> None:
    rng = np.random.default_rng([7, seed])
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, :3, 3], far = np.cumsum(rng.normal(size=(6, 3)), axis=0) * 0.1, 0.8 * np.pi * rng.normal(size=3)
    poses[:, :3, :3] = Rotation.from_rotvec(np.outer(np.arange(6), 2.4 * far / np.linalg.norm(far))).as_matrix()
    path = Spline(poses, tolerance=0)
    largest, _ = excess(path, rng, 20_000)
    assert 0.5 < largest <= 1.0
    assert path.deviation[1] < 1e-9


def test_turns_without_the_shortest_way_or_with_a_vanishing_quaternion_are_refused() -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = [0.0, 0.1, 0.2]
    poses[2, :3, :3] = Rotation.from_rotvec([np.pi, 0.0, 0.0]).as_matrix()
    with pytest.raises(InvalidInput, match=r"points\[2\]: .*180°"):
        Spline(poses)
    good = Spline(wave(20), orientation=UP).to_dict()
    wrong = np.array(good["coefficients"])
    wrong[4:, 3:] *= -1.0
    with pytest.raises(InvalidInput, match=r"coefficients: .*turns too large"):
        make_path(**(good | {"coefficients": wrong.tolist()}))


# ---------------------------------------------------------------- plans
def test_a_scan_of_5000_points_is_planned_and_proved_at_a_constant_speed() -> None:
    robot, q, limits = arm()
    poses, true = scan(np.random.default_rng(8), robot.fk(q))
    path = Spline(poses, tolerance=(3e-4, 4e-3))
    assert distances(path, true).max() < 3e-4
    made = plan(robot, path, q, limits=limits, timing="constant_speed")
    assert made, made.failure
    assert uneven(made, robot) < 1e-3
    assert plan(robot, path, q, limits=limits)
    slow = plan(robot, path, q, limits=limits, timing=make_law("constant_speed", speed=0.01))
    assert slow and slow.speed == pytest.approx(0.01, rel=1e-9)


def test_a_path_through_points_is_planned_by_both_laws() -> None:
    robot, start = paper6r(), paper6r().fk(START)
    path = Spline(start[:3, 3] + 0.5 * wave(25) - 0.5 * wave(25)[0], orientation=start[:3, :3], tolerance=0)
    for law in ("optimal", "constant_speed"):
        made = plan(robot, path, START, limits=MotionLimits(2.0, 10.0, 100.0), timing=law)
        assert made, made.failure


# ---------------------------------------------------------------- files and arguments
def test_a_table_in_millimetres_with_tool_axes_is_read(tmp_path: Path) -> None:
    file, points = tmp_path / "scan.csv", wave(50)
    tilt = 0.2 * np.linspace(0.0, 1.0, 50)
    axes = np.stack([0.0 * tilt, np.sin(tilt), np.cos(tilt)], axis=1)
    rows = [",".join(f"{v:.9f}" for v in (*(1e3 * p), *(2.0 * n))) for p, n in zip(points, axes, strict=True)]
    file.write_text("\n".join(["x_mm,y_mm,z_mm,i,j,k", *rows, rows[-1]]))
    down = np.diag([1.0, -1.0, -1.0])
    with pytest.warns(AssumptionWarning, match="scaled to 1"):
        path = Spline.from_csv(file, orientation=down, tolerance=0)
    assert path.notes
    assert distances(path, points).max() < 1e-9
    near = path.nearest(np.stack([optik.se3.pose(UP, p) for p in points]))
    np.testing.assert_allclose(path(near)[:, :3, 2], -axes, atol=1e-6)


def test_an_error_of_a_table_names_its_line(tmp_path: Path) -> None:
    file = tmp_path / "back.csv"
    x = [*range(0, 100, 10), *range(80, 0, -10)]
    file.write_text("# a reversal\nx_mm,y_mm,z_mm\n" + "".join(f"{v},0,0\n" for v in x))
    with pytest.raises(InvalidInput, match=r"back.csv, line 12: .*nearly stops.*reverses"):
        Spline.from_csv(file, orientation=UP)
    file.write_text(
        "x_mm,y_mm,z_mm,yaw_deg,pitch_deg,roll_deg\n0,0,0,0,0,0\n10,0,0,0,0,0\n10,0,0,9,0,0\n20,0,0,9,0,0\n"
    )
    with pytest.raises(InvalidInput, match=r"back.csv, line 4: .*turn of the tool at one point"):
        Spline.from_csv(file)
    with pytest.raises(InvalidInput, match="unit"):
        Spline.from_csv(file, unit="km")
    with pytest.raises(InvalidInput, match="ignore="):
        Spline.from_csv(file, columns="x,y,z,yaw,pitch,feed", orientation=UP)


HERE = np.stack([optik.se3.pose(UP, p) for p in wave(5)])


@pytest.mark.parametrize(
    ("points", "options", "named"),
    [
        (wave(5), {}, "orientation: expected a rotation"),
        (wave(5), {"orientation": np.eye(4)}, "orientation"),
        (wave(5), {"orientation": 2.0 * UP}, "orientation"),
        (HERE, {"orientation": UP}, "orientation: expected None"),
        (wave(1), {"orientation": UP}, "points: expected at least two"),
        (np.zeros((0, 3)), {"orientation": UP}, "points"),
        (wave(5)[:, :2], {"orientation": UP}, "points"),
        (np.zeros((4, 3)), {"orientation": UP}, "points: .*a Line or a Polyline turns the tool"),
        (1e-8 * wave(5), {"orientation": UP}, "points: .*1e-06 m"),
        (np.array([[0, 0, 0], [np.nan, 0, 0], [1, 0, 0]]), {"orientation": UP}, r"points\[1\]"),
        (np.array([[0, 0, 0], [np.inf, 0, 0], [1, 0, 0]]), {"orientation": UP}, r"points\[1\]"),
        ([[0, 0, 0], [1, 0]], {"orientation": UP}, "points"),
        ("scan.csv", {"orientation": UP}, "points"),
        (None, {}, "points"),
        (HERE, {"tolerance": -1.0}, r"tolerance: expected \(metres, radians\) above 0, or 0"),
        (HERE, {"tolerance": 1e-4}, "tolerance"),
        (HERE, {"tolerance": (1e-4, 0.0)}, "tolerance.rotation"),
        (HERE, {"tolerance": (np.nan, 1e-3)}, "tolerance.position"),
        (HERE, {"tolerance": (1e-4, 1e-3, 1.0)}, "tolerance"),
        (HERE, {"tolerance": "fine"}, "tolerance"),
        (HERE, {"tolerance": None}, "tolerance"),
        (np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0]]), {"orientation": UP}, r"points\[1\]: .*nearly stops"),
    ],
)  # fmt: skip
def test_a_wrong_argument_is_named_in_one_line(points: Any, options: dict[str, Any], named: str) -> None:
    with pytest.raises(InvalidInput, match=named) as error:
        Spline(points, **options)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("knots", [0.0]), ("knots", [0.0, 0.2, 0.1]), ("knots", [0.1, 0.2]), ("coefficients", [[0.0] * 7]),
        ("coefficients", [[0.0] * 7] * 6), ("coefficients", [[1e300] * 7] * 6), ("knots", [0.0, np.inf]),
        ("deviation", [0.0]), ("deviation", [0.0, np.nan]), ("order", 3),
    ],
)  # fmt: skip
def test_plain_data_of_no_curve_are_refused(field: str, value: Any) -> None:
    data = Spline(wave(2), orientation=UP).to_dict()
    assert make_path(**data).to_dict() == data
    with pytest.raises(InvalidInput, match=field):
        make_path(**(data | {field: value}))
