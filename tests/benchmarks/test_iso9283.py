"""Accuracy and repeatability in the manner of ISO 9283: against plain sums, closed forms and Gaussian clouds."""

import math

import numpy as np
import pytest

import optik
from benchmarks.blocks.cell import iso9283 as iso
from optik import se3
from optik.errors import InvalidInput

START = np.deg2rad([20, -35, 40, 25, 50, -30])


def plain_spread(points: list[list[float]]) -> tuple[list[float], float]:
    """Mean and l̄ + 3 S of some points by plain sums, as the standard writes them."""
    n = len(points)
    mean = [sum(p[i] for p in points) / n for i in range(3)]
    distances = [math.sqrt(sum((p[i] - mean[i]) ** 2 for i in range(3))) for p in points]
    middle = sum(distances) / n
    return mean, middle + 3.0 * math.sqrt(sum((d - middle) ** 2 for d in distances) / (n - 1))


def around(command: np.ndarray, shifts: np.ndarray, turns: np.ndarray) -> np.ndarray:
    poses = np.repeat(command[None], len(shifts), axis=0)
    poses[:, :3, 3] += shifts
    poses[:, :3, :3] = se3.exp_so3(turns) @ command[:3, :3]
    return poses


def test_pose_figures_are_the_plain_sums_of_the_standard() -> None:
    rng = np.random.default_rng(1)
    for cycles in (2, 5, 30):
        command = optik.load("paper6r").fk(START)
        shifts, turns = rng.normal(3e-4, 1e-4, (cycles, 3)), rng.normal(1e-3, 2e-4, (cycles, 3))
        found = iso.pose_figures(command, around(command, shifts, turns))
        mean, repeatability = plain_spread((command[:3, 3] + shifts).tolist())
        offset = [mean[i] - command[i, 3] for i in range(3)]
        np.testing.assert_allclose(found.offset, offset, atol=1e-15)
        assert found.accuracy == pytest.approx(math.sqrt(sum(x * x for x in offset)), abs=1e-15)
        assert found.repeatability == pytest.approx(repeatability, abs=1e-15)
        np.testing.assert_allclose(found.turn, turns.mean(axis=0), atol=1e-14)
        three = [
            3 * math.sqrt(sum((t - turns[:, i].mean()) ** 2 for t in turns[:, i]) / (cycles - 1)) for i in range(3)
        ]
        assert found.turn_repeatability is not None
        np.testing.assert_allclose(found.turn_repeatability, three, atol=1e-13)
        assert (found.cycles, found.reason) == (cycles, "")


def test_a_known_gaussian_cloud_has_the_repeatability_of_its_chi_distribution() -> None:
    sigma, count = 1e-4, 200_000
    shifts = np.random.default_rng(2).normal(0.0, sigma, (count, 3)) + np.array([1e-3, 0.0, 0.0])
    found = iso.pose_figures(np.eye(4), around(np.eye(4), shifts, np.zeros((count, 3))))
    mean = 2.0 * math.sqrt(
        2.0 / math.pi
    )  # of the length of a standard normal vector in space; its variance is 3 − mean²
    expected = sigma * (mean + 3.0 * math.sqrt(3.0 - mean**2))
    assert found.repeatability == pytest.approx(expected, rel=0.01)
    assert found.accuracy == pytest.approx(1e-3, rel=0.01)


def test_two_cycles_have_a_closed_form() -> None:
    poses = around(np.eye(4), np.array([[1e-3, 0, 0], [3e-3, 0, 0]]), np.zeros((2, 3)))
    found = iso.pose_figures(np.eye(4), poses)
    assert found.accuracy == pytest.approx(2e-3, abs=1e-16)
    assert found.repeatability == pytest.approx(1e-3, abs=1e-16)  # both are 1 mm from the mean: S = 0, yet they differ


def test_without_noise_repeatability_is_not_applicable_and_never_0() -> None:
    still = around(np.eye(4), np.full((30, 3), 1e-3), np.zeros((30, 3)))
    for found in (iso.pose_figures(np.eye(4), still), iso.pose_figures(np.eye(4), still, noise=False)):
        assert (found.repeatability, found.turn_repeatability, found.reason) == (None, None, iso.NO_NOISE)
        assert found.accuracy == pytest.approx(math.sqrt(3) * 1e-3)
    rounded = around(np.eye(4), np.random.default_rng(4).normal(0.0, 1e-17, (30, 3)), np.zeros((30, 3)))
    # rounding from cycle to cycle is no spread
    assert iso.pose_figures(np.eye(4), rounded, noise=False).reason == iso.NO_NOISE
    assert "one cycle" in iso.pose_figures(np.eye(4), still[:1]).reason
    path = iso.path_figures(np.zeros((2, 3)), still[:10, None, :3, 3].repeat(2, axis=1))
    assert (path.repeatability, path.repeatability_at, path.reason) == (None, None, iso.NO_NOISE)


def test_path_figures_are_the_largest_of_plain_sums_at_each_point() -> None:
    rng = np.random.default_rng(3)
    command = np.linspace([0, 0, 0], [0.3, 0.1, 0.2], 21)
    size = np.linspace(1e-5, 3e-4, 21)[::-1, None]
    reached = command + rng.normal(size=(10, 21, 3)) * size + np.array([2e-4, 0, 0])
    found = iso.path_figures(command, reached)
    plain = [plain_spread(reached[:, i].tolist()) for i in range(21)]
    off = [math.dist(mean, point) for (mean, _), point in zip(plain, command, strict=True)]
    assert found.accuracy == pytest.approx(max(off), abs=1e-15)
    assert found.at == off.index(max(off))
    assert found.repeatability == pytest.approx(max(r for _, r in plain), abs=1e-15)
    assert found.repeatability_at == max(range(21), key=lambda i: plain[i][1])


def test_a_followed_path_is_measured_where_it_meets_the_normal_planes() -> None:
    command = np.linspace([0.0, 0, 0], [1.0, 0, 0], 11)
    t = np.linspace(-0.05, 1.05, 333)
    followed = np.stack([t, 0.01 * t, np.full_like(t, 2e-3)], axis=1)  # ahead and behind in time must not count
    met = iso.crossings(command, np.tile([5.0, 0, 0], (11, 1)), followed)
    np.testing.assert_allclose(met, np.stack([command[:, 0], 0.01 * command[:, 0], np.full(11, 2e-3)], 1), atol=1e-15)
    short = iso.crossings(command, np.tile([1.0, 0, 0], (11, 1)), followed[t < 0.52])
    np.testing.assert_allclose(short[-1], followed[t < 0.52][-1])  # the path ends before: the nearest sample
    there_and_back = np.concatenate([followed, followed[::-1] + np.array([0, 0.5, 0])])
    np.testing.assert_allclose(iso.crossings(command, np.tile([1.0, 0, 0], (11, 1)), there_and_back), met, atol=1e-15)


@pytest.fixture(scope="module")
def cube() -> iso.Cube:
    return iso.cube_poses(optik.load("paper6r"), START)


def test_the_five_poses_stand_in_a_diagonal_plane_of_the_largest_cube_the_arm_serves(cube: iso.Cube) -> None:
    robot = optik.load("paper6r")
    at, centre = cube.poses[:, :3, 3], robot.fk(START)[:3, 3]
    np.testing.assert_allclose(at[0], centre, atol=1e-15)
    # each outer pose is 80 % of half the plane's diagonal, √3 edges, from the centre, and opposite ones mirror each other
    np.testing.assert_allclose(np.linalg.norm(at[1:] - centre, axis=1), 0.4 * cube.edge * math.sqrt(3), rtol=1e-12)
    np.testing.assert_allclose([at[1] + at[3], at[2] + at[4]], np.tile(2 * centre, (2, 1)), atol=1e-15)
    sides = np.linalg.norm(
        at[1:] - np.roll(at[1:], -1, axis=0), axis=1
    )  # of a rectangle of one edge and a face's diagonal
    np.testing.assert_allclose(
        sorted(sides / cube.edge), 0.8 * np.array([1, 1, math.sqrt(2), math.sqrt(2)]), rtol=1e-12
    )
    normal = np.cross(at[1] - centre, at[2] - centre)
    np.testing.assert_allclose((at - centre) @ normal, 0.0, atol=1e-15)
    assert sorted(np.round(np.abs(normal) / np.abs(normal).max(), 9).tolist()) == [0.0, 1.0, 1.0]
    np.testing.assert_allclose(robot.fk(cube.q), cube.poses, atol=1e-6)
    assert (cube.q >= robot.limits.lower + 0.02).all()
    assert (cube.q <= robot.limits.upper - 0.02).all()
    assert cube.edge >= 0.1
    assert f"{1e3 * cube.edge:.0f} mm" in cube.words


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("joint", range(3))
def test_the_five_configurations_keep_the_margin_on_both_sides_of_every_range(joint: int, side: int) -> None:
    robot = optik.load("paper6r")
    lower, upper = np.array(robot.limits.lower), np.array(robot.limits.upper)
    (lower if side < 0 else upper)[joint] = START[joint] + 0.1 * side
    narrow = robot.with_limits(lower=lower, upper=upper)
    found = iso.cube_poses(narrow, START, most_edge=0.4)
    assert (found.q >= lower + iso.POSE_MARGIN).all() and (found.q <= upper - iso.POSE_MARGIN).all()
    assert abs(found.q[:, joint] - (lower if side < 0 else upper)[joint]).min() < 0.05


@pytest.mark.parametrize(
    ("call", "names"),
    [
        (lambda: iso.pose_figures(np.eye(3), np.eye(4)[None]), "command"),
        (lambda: iso.pose_figures(np.eye(4), np.eye(4)), "reached"),
        (lambda: iso.pose_figures(np.eye(4), np.full((2, 4, 4), np.nan)), "reached"),
        (lambda: iso.path_figures(np.zeros((3, 3)), np.zeros((2, 4, 3))), "reached"),
        (lambda: iso.path_figures(np.zeros((0, 3)), np.zeros((2, 0, 3))), "command"),
        (lambda: iso.crossings(np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((2, 3))), "tangents"),
        (lambda: iso.cube_poses(optik.load("paper6r"), np.full(6, 9.0)), "q"),
        (lambda: iso.cube_poses(optik.load("paper6r"), START, most_edge=0.0), "most_edge"),
    ],
)  # fmt: skip
def test_wrong_values_are_named(call: object, names: str) -> None:
    with pytest.raises(InvalidInput, match=names):
        call()
