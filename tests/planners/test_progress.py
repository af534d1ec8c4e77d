"""Where on its path a motion is: right for any polyline, whatever lies close together, crosses or returns."""

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st

from optik import se3
from optik.errors import InvalidInput
from optik.types import Array
from planners import Arc, Line, Polyline
from planners.certificate.bounds import Instants
from planners.certificate.projection import Nearest, positions_along
from planners.paths.base import Path

quick = settings(
    max_examples=30, deadline=None, phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck)
)


def drawn_polyline(seed: int) -> Polyline:
    """Segments of 1e-6 to 0.2 m and rad, with near reversals and near repeats among them."""
    rng = np.random.default_rng(seed)
    T, poses, step = np.eye(4), [np.eye(4)], np.zeros(6)
    for _ in range(int(rng.integers(2, 9))):
        size = 10.0 ** rng.uniform(-6.0, -0.7)
        back = -step * rng.uniform(0.2, 1.2) + size * 10.0 ** rng.uniform(-4.0, -1.0) * rng.normal(size=6)
        step = back if rng.random() < 0.3 else size * rng.normal(size=6)
        T = se3.pose(se3.exp_so3(step[3:]) @ T[:3, :3], T[:3, 3] + step[:3])
        poses.append(T)
    blend = 10.0 ** rng.uniform(-5.0, -1.3)
    try:
        return Polyline(poses, blend=blend, blend_rotation=10.0 * blend)
    except InvalidInput:  # a return the way it came, a half turn
        assume(False)
        raise


def moments(path: Path, seed: int, count: int) -> Array:
    """Places of a motion that runs through a path forwards, slower at some than at others; every piece is seen."""
    rng = np.random.default_rng(seed)
    u = np.cumsum(rng.uniform(0.05, 1.0, count))
    return np.union1d(path.grid(count, 8), path.end * (u - u[0]) / (u[-1] - u[0]))


def gaps(path: Path, s: Array, poses: Array) -> Array:
    """Distances (k,) of poses from the path at s, where a turn of 1 rad counts as 0.1 m."""
    e = se3.error(path.pose(s), poses)
    return np.hypot(np.linalg.norm(e[:, :3], axis=1), 0.1 * np.linalg.norm(e[:, 3:], axis=1))


@quick
@given(st.integers(0, 2**32 - 1))
def test_a_motion_along_a_polyline_is_put_where_it_is(seed: int) -> None:
    path = drawn_polyline(seed)
    s = moments(path, seed, 200)
    found = positions_along(path, path.pose(s))
    assert gaps(path, found, path.pose(s)).max() <= 3e-5, "the chords bend away by 1e-5 at most"
    assert (np.diff(found) >= -3e-4 * max(path.end, 1.0)).all(), "forwards, but for what a chord may bend"
    assert np.abs(found - s).max() <= 0.02 * path.end + 1e-3, "no leg is taken for another"


@quick
@given(st.integers(0, 2**32 - 1), st.floats(-7.0, -4.3))
def test_a_tool_beside_its_path_stays_in_its_order(seed: int, size: float) -> None:
    path, rng = drawn_polyline(seed), np.random.default_rng(seed)
    s = moments(path, seed, 200)
    tool = path.pose(s)
    tool[:, :3, 3] += 10.0**size * rng.normal(size=(s.size, 3))
    found = positions_along(path, tool)
    assert gaps(path, found, tool).max() <= 4.0 * 10.0**size + 3e-5


def square(back: float) -> Polyline:
    """Out along x, back beside it at a distance, and out again: three legs, each within the reach of a nearest place."""
    points = [[0, 0, 0], [0.3, 0, 0], [0.0, back, 0], [0.3, 2.0 * back, 0]]
    return Polyline([se3.pose(np.eye(3), np.array(p, float)) for p in points], blend=1e-5)


@pytest.mark.parametrize("back", [1e-4, 1e-3, 0.01])
def test_three_legs_side_by_side_are_run_through_one_after_the_other(back: float) -> None:
    path = square(back)
    s = path.grid(400, 4)
    np.testing.assert_allclose(positions_along(path, path.pose(s)), s, rtol=0.0, atol=2e-3)


def test_a_crossing_is_passed_straight_on() -> None:
    points = [[-0.1, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0], [0, -0.1, 0]]
    path = Polyline([se3.pose(np.eye(3), np.array(p, float)) for p in points], blend=1e-3)
    s = path.grid(300, 4)
    np.testing.assert_allclose(positions_along(path, path.pose(s)), s, rtol=0.0, atol=1e-4)


def circle() -> Arc:
    return Arc.about(np.eye(4), np.array([0.05, 0.0, 0.0]), [0.0, 1.0, 0.0], 2.0 * np.pi)


def test_a_closed_path_begins_at_its_beginning_and_ends_at_its_end() -> None:
    path = circle()
    s = np.linspace(0.0, path.end, 181)
    np.testing.assert_allclose(positions_along(path, path.pose(s)), s, rtol=0.0, atol=1e-4)
    still = positions_along(path, np.tile(path.pose(0.0), (20, 1, 1)))
    assert np.ptp(still) == 0.0, "who stands still runs through nothing"


@pytest.mark.parametrize("path", [circle(), square(0.01)])
def test_a_motion_backwards_goes_back(path: Path) -> None:
    s = path.grid(300, 4)[::-1]
    np.testing.assert_allclose(positions_along(path, path.pose(s)), s, rtol=0.0, atol=1e-3)


@pytest.mark.parametrize("axis", range(3))
def test_the_nearest_place_around_is_found_to_rounding_and_without_a_search(
    axis: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a tool 1 µm beside a path that is nowhere slow."""
    monkeypatch.setattr(Nearest, "_likeliest", None)
    turn = np.zeros(3)
    turn[axis] = 0.8
    for path in (Line(np.eye(4), se3.pose(se3.exp_so3(turn), np.zeros(3))), Line(np.eye(4), se3.pose(np.eye(3), turn))):
        s = np.linspace(0.1, 0.7, 7) * path.end / 0.8
        instants = Instants(s, np.zeros((7, 6, 6)), path.pose(s), np.zeros((7, 3, 6)))
        instants.twists[:, 0] = 0.5 * path.twist(s)
        instants.poses[:, (axis + 1) % 3, 3] += 1e-6
        found = Nearest(path).places(instants, s + 0.02 * path.end)
        np.testing.assert_allclose(found.s, s, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(found.speed, 0.5, rtol=1e-6)


def test_a_motion_nowhere_near_its_path_gets_the_nearest_places() -> None:
    rng = np.random.default_rng(1)
    path = Line(np.eye(4), se3.pose(np.eye(3), np.array([0.2, 0.0, 0.0])))
    far = np.array([se3.pose(np.eye(3), rng.uniform(-2.0, 2.0, 3)) for _ in range(50)])
    found = positions_along(path, far)
    assert ((found >= 0.0) & (found <= path.end)).all()


@pytest.mark.parametrize("count", [300, 3000])
def test_long_polylines_cost_what_their_length_costs(count: int, monkeypatch: Any) -> None:
    """No more pairs of an instant and a chord are looked at than some for each instant."""
    from planners.certificate import projection

    rng = np.random.default_rng(0)
    u = np.linspace(0.0, 1.0, count)
    points = np.stack([0.15 * np.sin(4 * np.pi * u), 0.2 * u, 0.1 * np.cos(4 * np.pi * u)], axis=1)
    points += 0.15 / count * rng.normal(size=(count, 3))
    path = Polyline([se3.pose(np.eye(3), p) for p in points], blend=1e-3)
    s = path.grid(4 * count, 3)
    monkeypatch.setattr(projection, "MOST_PAIRS", 60 * s.size)
    np.testing.assert_allclose(positions_along(path, path.pose(s)), s, rtol=0.0, atol=1e-3)
