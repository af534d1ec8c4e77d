"""Following polylines: tiny pieces cost what they bend, bounds hold across breaks, work grows with the length only."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from optik import Robot
from optik.arm.library import load
from optik.errors import InvalidInput
from optik.ik import Tolerance, make_solver
from optik.types import Array
from planners import Line, Polyline, follow
from planners.following import joint_path
from planners.following.joint_path import LEAST_SPACING, Course, bound_fourth_derivatives, make_empty_guide
from tests import oracles
from tests.planners.polylines import keeps_on


class Pieces(Line):
    """A line that says to be of pieces, with bounds of their own."""

    def __init__(self, breaks: Array, fourth: Array) -> None:
        super().__init__(np.eye(4), oracles.moved(np.eye(4), np.array([1.0, 0.0, 0.0])))
        self._given, self._fourth = breaks, fourth

    @property
    def breaks(self) -> Array:
        return self._given

    def piece_bounds(self) -> Array:
        out = np.zeros((len(self._fourth), 2, 4))
        out[:, 0, 3] = out[:, 1, 3] = self._fourth
        return out


places = st.lists(st.floats(1e-6, 1.0 - 1e-6), min_size=1, max_size=12, unique=True)


@settings(max_examples=150)
@given(places, places, st.integers(0, 2**32 - 1))
def test_the_bound_of_an_interval_is_the_greatest_of_all_pieces_that_it_touches(inner: Any, s: Any, seed: int) -> None:
    breaks, at = np.array([0.0, *sorted(inner), 1.0]), np.array([0.0, *sorted(s), 1.0])
    fourth = np.random.default_rng(seed).uniform(0.0, 10.0, len(breaks) - 1)
    found = bound_fourth_derivatives(Pieces(breaks, fourth), at)
    for i, (a, b) in enumerate(pairwise(at)):
        touched = [f for f, left, right in zip(fourth, breaks[:-1], breaks[1:], strict=True) if left < b and right > a]
        assert (found[i] == max(touched)).all()


@settings(max_examples=150)
@example([0.015625, 1.0000000000000002e-06, 1e-06], [0.5], 1)  # breaks one rounding apart
@given(places, places, st.integers(0, 2**32 - 1))
def test_places_are_no_further_than_the_path_bends_and_no_nearer_than_rounding_allows(
    inner: Any, s: Any, seed: int
) -> None:
    breaks, at = np.array([0.0, *sorted(inner), 1.0]), np.array([0.0, *sorted(s), 1.0])
    fourth = 10.0 ** np.random.default_rng(seed).uniform(-3.0, 9.0, len(breaks) - 1)
    path, tolerance = Pieces(breaks, fourth), Tolerance(1e-5, 1e-5)
    found = Course(path, make_empty_guide(6)).spread(at, tolerance)
    assert found[0] == 0.0 and found[-1] == 1.0 and (np.diff(found) > 0.0).all()
    h, bound = np.diff(found), bound_fourth_derivatives(path, found)[:-1, 0]
    assert (h**4 / 384.0 * bound <= 1e-5).all()
    near = np.flatnonzero(h < LEAST_SPACING * (1.0 - 1e-9))
    for i in near[(near > 0) & (near < len(h) - 1)]:  # what is near is needed: without it the path bends too much
        wide = np.array([found[i - 1], found[i + 1], found[i + 2]]), np.array([found[i - 1], found[i], found[i + 2]])
        worst = max(((x[1:] - x[:-1]) ** 4 * bound_fourth_derivatives(path, x)[:-1, 0]).max() for x in wide)
        ends = found[i] in breaks and found[i + 1] in breaks
        assert worst / 384.0 > 1e-7 or ends or h[i - 1] + h[i] >= LEAST_SPACING


def test_of_two_places_that_are_too_near_the_break_stays() -> None:
    s = np.linspace(0.0, 0.1, 101)
    s = np.sort(np.append(s, 0.05001))
    kept = np.ones(len(s), np.bool_)
    joint_path.thin_positions(s, np.full(len(s) - 1, np.inf), s == 0.05001, kept)
    assert kept.sum() == 101 and kept[s == 0.05001].all()
    assert np.diff(s[kept]).min() >= LEAST_SPACING


def drawn(robot: Robot, rng: np.random.Generator) -> tuple[Polyline, Array]:
    """Waypoints from joint steps of 1e-6 to 0.2 rad, some repeated or nearly reversing, and where the arm starts."""
    lower, upper = np.maximum(robot.limits.lower, -3.0), np.minimum(robot.limits.upper, 3.0)
    while True:
        Q = [lower + (upper - lower) * rng.uniform(0.2, 0.8, robot.n)]
        for _ in range(rng.integers(2, 9)):
            step = 10.0 ** rng.uniform(-6.0, -0.7) * rng.normal(size=robot.n)
            if rng.random() < 0.15 and len(Q) > 1:
                step = 1e-3 * step - rng.uniform(0.3, 1.5) * (Q[-1] - Q[-2])
            Q.append(np.clip(Q[-1] + step, lower, upper))
            if rng.random() < 0.1:
                Q.append(Q[-1] + 1e-8 * rng.normal(size=robot.n))
        blend, turn = 10.0 ** rng.uniform(-5.0, -1.3), 10.0 ** rng.uniform(-4.0, -1.0)
        try:
            return Polyline(np.array([robot.fk(q) for q in Q]), blend=blend, blend_rotation=turn), Q[0]
        except InvalidInput:
            continue


def check_polylines(name: str, how_many: int) -> None:
    robot, rng, seen = load(name), np.random.default_rng(23), 0
    while seen < how_many:
        path, q = drawn(robot, rng)
        if keeps_on(robot, path, q):
            seen += 1
            followed = follow(make_solver(robot, "lm"), path, q)
            assert followed and followed.joint_path is not None, followed.failure
            assert max(followed.joint_path.bound) <= 1e-5


@pytest.mark.parametrize("name", ["kr6", "iiwa14"])
def test_polylines_that_dense_continuation_follows_are_followed(name: str) -> None:
    check_polylines(name, 2)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["paper6r", "irb120", "ur5e", "kr6", "puma560", "gen3lite", "iiwa14", "panda"])
def test_a_thousand_polylines_that_dense_continuation_follows_are_followed(name: str) -> None:
    check_polylines(name, 125)


@pytest.mark.parametrize("name", ["ur5e", "iiwa14"])
def test_the_work_of_a_long_polyline_grows_with_its_length_only(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load(name)
    q = np.deg2rad(
        [20.0, -80.0, 100.0, -100.0, -90.0, 30.0] if robot.n == 6 else [20.0, 30.0, 10.0, -80.0, 15.0, 60.0, 20.0]
    )
    work, solver, evaluate = [0], make_solver(robot, "lm"), Polyline._evaluate

    def counted(self: Polyline, x: Array, order: int) -> Array:
        work[0] += len(x) + 10
        return evaluate(self, x, order)

    monkeypatch.setattr(Polyline, "_evaluate", counted)
    per_waypoint = []
    for n in (200, 1600):
        u, rng = np.linspace(0.0, 1.0, n), np.random.default_rng(0)
        W = np.tile(robot.fk(q), (n, 1, 1))
        way = np.stack([0.1 * np.sin(4.0 * np.pi * u), 0.15 * u, 0.1 * (np.cos(4.0 * np.pi * u) - 1.0)], axis=1)
        W[:, :3, 3] += way + 0.15 / n * rng.normal(size=(n, 3)) * (u > 0.0)[:, None]
        work[0] = 0
        followed = follow(solver, Polyline(W, blend=1e-3), q)
        assert followed and followed.joint_path is not None
        assert len(followed.joint_path.nodes) <= 10 * n
        per_waypoint.append(work[0] / n)
    assert per_waypoint[1] <= 1.2 * per_waypoint[0]


@pytest.mark.parametrize("tolerance", [(1e-6, 1.0), (1.0, 1e-6), (1e-6, 1e-6)])
def test_places_stand_as_near_as_both_tolerances_ask(tolerance: tuple[float, float]) -> None:
    poses = [np.eye(4) for _ in range(3)]
    poses[1][:3, 3], poses[2][:3, 3] = [0.1, 0.0, 0.0], [0.1, 0.1, 0.0]
    poses[1], poses[2] = (
        oracles.moved(T, np.zeros(3), np.array([0.0, 0.3 * k, 0.0])) for k, T in enumerate(poses[1:], 1)
    )
    path = Polyline(poses, blend=5e-3, blend_rotation=5e-2)
    s = Course(path, make_empty_guide(6)).spread(np.linspace(0.0, path.end, 11), Tolerance(*tolerance))
    fourth = path.piece_bounds()[np.searchsorted(path.breaks, s[:-1] + 0.5 * np.diff(s)) - 1, :, 3]
    assert (np.diff(s)[:, None] ** 4 / 384.0 * fourth <= np.array(tolerance)).all()
