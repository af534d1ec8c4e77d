"""Whole paths among all configurations: the extended arm, the graph against plain enumeration, seams, and reconfigurations."""

import itertools
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import optik
from optik import Robot, Scene
from optik.errors import InvalidInput
from optik.types import Array
from planners import Line, MotionLimits, Part, Polyline, Program, ProgramPlan, follow, free, plan
from planners.following.branches import CollisionCheck
from planners.following.failure import ASKED, FollowStatus, PlanFailure
from planners.following.resolve import Resolution, resolve
from planners.following.resolve.freedoms import columns_of, extend
from planners.following.resolve.graph import Graph, Layer, Sampler, find_edges, join_layers
from planners.freedom.base import Freedom
from planners.motion.show import show_motion
from planners.paths.base import Path
from planners.paths.free_path import FreePath
from planners.paths.stretch import Stretch
from planners.planning import PlanStatus
from tests.figures import resolve_cuts, resolve_lines, resolve_seams
from tests.planners.contacts import COAL_ERROR

LIMITS = MotionLimits(velocity=2.0, acceleration=10.0, jerk=100.0)


# ---------------------------------------------------------------- the extended arm
class Slide(Freedom):
    """Shift of the tool along an oblique direction."""

    name = "slide"
    unit = "m"
    screws = ((0.6, 0.0, 0.8, 0.0, 0.0, 0.0),)


class Hinge(Freedom):
    """Turn about an axis beside the tool's point."""

    name = "hinge"
    screws = ((0.0, 0.1, 0.0, 1.0, 0.0, 0.0),)  # v = −ω × p with p = (0, 0, 0.1)


def exp(screw: Any, f: float) -> Array:
    """exp(f ξ) by the series, in plain NumPy."""
    v, w = np.array(screw[:3]), np.array(screw[3:])
    X = np.zeros((4, 4))
    X[:3, :3] = [[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]]
    X[:3, 3] = v
    out, term = np.eye(4), np.eye(4)
    for k in range(1, 40):
        term = term @ (f * X) / k
        out = out + term
    return out


KINDS = (("turn",), ("tilt",), ("turn", "tilt"), ("tilt", "turn"))


@pytest.mark.parametrize("names", [*KINDS, ("slide",), ("hinge", "slide", "turn")], ids="+".join)
@pytest.mark.parametrize("name", ["ur5e", "panda", "irb910sc"])
def test_the_tool_of_the_extended_arm_is_that_of_the_given_path(name: str, names: tuple[str, ...]) -> None:
    own = {"slide": Slide(), "hinge": Hinge()}
    kinds = tuple(
        (own.get(n) or optik.registry.build_method("planners.freedom", n, "freedom"), (-0.7, 0.9)) for n in names
    )
    robot, rng = optik.load(name), np.random.default_rng(len(names))
    arm, (columns, discs) = extend(robot, kinds), columns_of(robot, kinds)
    assert arm.n == robot.n + sum(len(kind.screws) for kind, _ in kinds)
    assert len(discs) == sum(kind.round for kind, _ in kinds)
    for q in robot.limits.sample(rng, 20):
        f = rng.uniform(-1.0, 1.0, len(columns))
        x = np.append(q, np.zeros(len(columns)))
        x[columns] = f
        moved = arm.fk(x)
        for screw, value in zip((s for kind, _ in kinds for s in kind.screws), f, strict=True):
            moved = moved @ exp(screw, value)
        np.testing.assert_allclose(moved, robot.fk(q), atol=1e-13)
    for (_kind, bounds), at in zip(kinds, columns, strict=False):
        if len(kinds) == len(columns):
            assert (arm.limits.lower[at], arm.limits.upper[at]) == bounds


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_the_extended_arm_has_the_torques_of_the_arm_with_its_payload(name: str) -> None:
    robot = optik.load(name).with_payload(1.5, (0.02, -0.03, 0.08), np.diag([0.01, 0.02, 0.015]))
    start = robot.fk(robot.limits.middle)
    path = free(Line(start, start @ optik.se3.pose(p=[0.1, 0.0, 0.1])), turn=1.0, tilt=0.3)
    arm, rng = extend(robot, tuple((kind, path.bounds[kind.name]) for kind in path.kinds)), np.random.default_rng(1)
    q, dq, ddq = (rng.uniform(-1.0, 1.0, (100, arm.n)) for _ in range(3))
    n = robot.n
    scale = np.abs(robot.torques(q[:, :n], dq[:, :n], ddq[:, :n])).max()
    off = arm.torques(q, dq, ddq)[:, :n] - robot.torques(q[:, :n], dq[:, :n], ddq[:, :n])
    assert np.abs(off).max() <= 1e-12 * scale
    heavy = robot.with_payload((0.5, 1.5))
    assert extend(heavy, tuple((kind, path.bounds[kind.name]) for kind in path.kinds)).inertia is None


# ---------------------------------------------------------------- the graph
class Given(Sampler):
    """A sampler whose configurations are given, and every edge between them can be followed."""

    def __init__(self, layers: list[Array], costs: list[Array]) -> None:
        robot = optik.load("ur5e")
        super().__init__(robot, robot, Line(robot.fk(layers[0][0]), optik.se3.pose(p=[0.4, 0.1, 0.5])), None, 60.0)
        self.given = iter([Layer(q, c, np.zeros(len(q))) for q, c in zip(layers, costs, strict=True)])

    def draw(self, poses: Array, count: int) -> list[Array]:
        return [np.empty((0, 6))] * len(poses)

    def judge(self, q: Array) -> Layer:
        return next(self.given)

    def project(self, q: Array, poses: Array, steps: int = 8) -> tuple[Array, Array]:
        return np.array(q), np.ones(len(q), np.bool_)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("cuts", [0, 1, 3])
def test_the_cheapest_sequence_is_that_of_enumeration(seed: int, cuts: int) -> None:
    rng = np.random.default_rng([seed, cuts])
    K, N = 5, 4
    layers = [rng.uniform(-1.0, 1.0, (N, 6)) * (0.8 if cuts and seed % 2 else 0.5) for _ in range(K)]
    costs = [rng.uniform(0.0, 1.0, N) for _ in range(K)]
    sampler = Given(layers, costs)
    path = Line(sampler.arm.fk(layers[0][0]), optik.se3.pose(p=[0.4, 0.1, 0.5]))
    graph = Graph(sampler, path, np.linspace(0.0, path.end, K), 1, held=True)
    stuck = graph._solve(cuts)

    def cost(rows: tuple[int, ...]) -> tuple[int, float]:
        total, count = costs[0][rows[0]] / K, 0
        for k in range(1, K):
            d = layers[k][rows[k]] - layers[k - 1][rows[k - 1]]
            if np.abs(d).max() > 0.7:
                return K, np.inf
            total += 0.5 * (K - 1) * float((sampler.weights * d * d).sum()) + costs[k][rows[k]] / K
        return count, total

    best = min(cost(rows)[1] for rows in itertools.product(range(N), repeat=K))
    if cuts == 0:
        assert (stuck is not None) == (not np.isfinite(best))
        if stuck is None:
            assert graph.costs[-1].min() == pytest.approx(best)
        return
    # The fewest reconfigurations to each configuration, over all places and configurations of cuts.
    fewest = np.zeros(N)
    for k in range(1, K):
        linked = np.abs(layers[k][None] - layers[k - 1][:, None]).max(axis=2) <= 0.7
        own = np.where(linked, fewest[:, None], np.inf).min(axis=0)
        fewest = np.minimum(own, own.min() + 1.0)
    least = fewest.min()
    assert (stuck is None) == (least <= cuts)
    if stuck is None:
        assert graph.costs[-1].min() // 1e6 == least
        assert len(graph._trace(int(graph.costs[-1].argmin()))) == least + 1
    reached = {(0, i): (0, costs[0][i] / K) for i in range(N)}
    for k in range(K):
        if k:
            for j in range(N):
                options = []
                for i in range(N):
                    d = layers[k][j] - layers[k - 1][i]
                    if (k - 1, i) in reached and np.abs(d).max() <= 0.7:
                        made, c = reached[k - 1, i]
                        step = 0.5 * (K - 1) * float((sampler.weights * d * d).sum())
                        options.append((made, c + step + costs[k][j] / K))
                if options:
                    reached[k, j] = min(options)
    alone = [reached[K - 1, j] for j in range(N) if (K - 1, j) in reached]
    assert bool(alone) == (least == 0)
    if alone:
        assert stuck is None and graph.costs[-1].min() == pytest.approx(min(c for _, c in alone))


def test_an_edge_stays_forbidden_where_layers_grow() -> None:
    sampler = Given([np.full((1, 6), 0.1), np.full((1, 6), 0.3)], [np.zeros(1)] * 2)
    path = Line(sampler.arm.fk(np.full(6, 0.1)), optik.se3.pose(p=[0.4, 0.1, 0.5]))
    graph = Graph(sampler, path, np.array([0.0, path.end]), 1, held=True)
    graph._forbid([(1, 0, 0)])
    assert graph._solve(0) == 1
    for k in (0, 1):  # as an inserted layer does to its neighbours
        graph.layers[k] = join_layers(graph.layers[k], Layer(np.full((2, 6), 0.5), np.ones(2), np.zeros(2)))
    assert graph._solve(0) is None
    assert graph.before[1][0] > 0


def test_edges_are_those_of_a_plain_search() -> None:
    rng, weights = np.random.default_rng(5), np.array([1.0, 0.3, 2.0])
    circle = np.array([True, False, True])
    for _ in range(20):
        a, b = rng.uniform(-np.pi, np.pi, (40, 3)), rng.uniform(-np.pi, np.pi, (30, 3))
        b[:15] = a[:15] + rng.uniform(-0.8, 0.8, (15, 3)) + 2.0 * np.pi * circle * rng.integers(-1, 2, (15, 3))
        b = np.where(circle, b - 2.0 * np.pi * np.round(b / (2.0 * np.pi)), b)
        costs, sides, forbidden = rng.uniform(0.0, 1.0, 40), rng.choice((-1.0, 1.0), 70), rng.random((40, 30)) < 0.2
        total, best = np.empty(30), np.empty(30, np.int64)
        window = np.tile([0, 40], (30, 1))
        find_edges((a, costs, sides[:40]), b, sides[40:], (weights, circle), forbidden, window, total, best)
        d = b[None] - a[:, None]
        d = np.abs(np.where(circle, d - 2.0 * np.pi * np.round(d / (2.0 * np.pi)), d))
        may = (d.max(axis=2) <= 0.7) & (sides[:40, None] == sides[None, 40:]) & ~forbidden
        each = np.where(may, costs[:, None] + (weights * d * d).sum(axis=2), np.inf)
        np.testing.assert_allclose(total, each.min(axis=0))
        assert (best == np.where(np.isfinite(each.min(axis=0)), each.argmin(axis=0), -1)).all()
        assert np.isfinite(total).sum() >= 3


def test_an_edge_that_passes_an_obstacle_is_not_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    layers = [np.zeros((1, 6)), np.full((1, 6), 0.4)]
    sampler = Given(layers, [np.zeros(1), np.zeros(1)])
    path = Line(sampler.arm.fk(layers[0][0]), optik.se3.pose(p=[0.4, 0.1, 0.5]))
    graph = Graph(sampler, path, np.array([0.0, path.end]), 1, held=True)
    assert graph._check([(0, 0), (1, 0)]) == []
    monkeypatch.setattr(sampler, "rooms", lambda q: np.where(np.abs(q[:, 0] - 0.2) < 0.01, -1.0, 1.0))
    assert graph._check([(0, 0), (1, 0)]) == [(1, 0, 0)]


@pytest.mark.parametrize("reached", [True, False])
def test_a_place_where_configurations_are_is_not_called_unreachable(reached: bool) -> None:
    before = PlanFailure(FollowStatus.UNREACHABLE, 0.1, None, "first", "")
    failure = Resolution(25, 9, 0, 1, 0.1, (0.1, 0.2), (), "second", reached).explain(before)
    assert failure.status == (FollowStatus.NO_PATH_FOUND if reached else FollowStatus.UNREACHABLE)
    assert failure.reason == "second; first"
    asked = PlanFailure(FollowStatus.BRANCH_JUMP, 0.1, None, f"no motion continues{ASKED}", "")
    failure = Resolution(25, 9, 0, 1, 0.1, (0.1, 0.2), (), "second", reached).explain(asked)
    assert failure.status == (FollowStatus.BRANCH_JUMP if reached else FollowStatus.UNREACHABLE)
    assert failure.reason == "second; no motion continues", "the search answers the question"
    assert Resolution(25, 9, 0, 1, 0.1).explain(asked) is asked


def test_values_on_the_circle_are_wound_and_unwound() -> None:
    robot, rng = optik.load("ur5e"), np.random.default_rng(3)
    sampler = Sampler(robot, robot, Line(robot.fk(np.full(6, 0.4)), optik.se3.pose(p=[0.4, 0.1, 0.5])), None, 1.0)
    assert sampler.circle.all()
    way = np.cumsum(rng.uniform(-0.5, 0.5, (60, 6)), axis=0)
    wound = sampler.wind(way)
    assert np.abs(wound).max() <= np.pi
    back = sampler.unwind(wound)
    np.testing.assert_allclose(np.diff(back, axis=0), np.diff(way, axis=0), atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * back), np.exp(1j * way), atol=1e-12)


# ---------------------------------------------------------------- whole plans
@pytest.mark.parametrize("case", [0, pytest.param(5, marks=pytest.mark.soak)])
def test_lines_that_only_a_freedom_makes_possible_are_planned(case: int) -> None:
    row = resolve_lines.measure(case)
    for law in resolve_lines.LAWS:
        assert row[law], row
        assert row[f"{law}_off"] <= 1e-5


def test_a_line_from_a_held_start_is_planned_and_locally_refused() -> None:
    robot, q = optik.load("paper6r"), np.deg2rad([20, -35, 40, 25, 50, -30])
    goal = robot.fk(q)
    goal[:3, 3] += [0.4, 0.0, 0.3]
    path = free(Line(robot.fk(q), goal), turn=2.0, tilt=0.6)
    local = plan(robot, path, q, limits=LIMITS, resolve="local")
    assert local.status is PlanStatus.OUTSIDE_LIMITS and local.resolution is None
    found, again = (plan(robot, path, q, limits=LIMITS) for _ in range(2))
    assert found and found.resolution is not None and found.resolution.stuck is None
    assert found.trajectory.duration == again.trajectory.duration  # seeded by arm and path
    np.testing.assert_allclose(found.trajectory(0.0), q, atol=1e-9)
    assert "resolved: 25 layers" in str(found)
    assert found.to_dict()["resolution"]["layers"] == 25
    assert dict(show_motion(found).facts)["Free turn"].endswith("°")
    # the tool stays on the given line, its axis within the cone
    at = found.trajectory(np.linspace(0.0, found.trajectory.duration, 300))
    tool, line = robot.fk(at), goal[:3, 3] - robot.fk(q)[:3, 3]
    away = tool[:, :3, 3] - robot.fk(q)[:3, 3]
    along = away @ line / (line @ line)
    assert np.abs(away - along[:, None] * line).max() <= 1e-5
    axis = Rotation.from_matrix(tool[:, :3, :3]).apply([0.0, 0.0, 1.0])
    assert np.arccos(np.clip(axis @ goal[:3, 2], -1.0, 1.0)).max() <= 0.6 + 1e-5


def test_a_held_start_keeps_its_windings() -> None:
    """Also where the values of a joint are searched on the circle: the motion begins where the arm stands."""
    robot, solved = optik.load("ur5e"), 0
    q = np.array([-4.0, -1.9, 2.0, -1.5, 1.4, 4.5])
    for step in (
        [0.4, 0.0, 0.0],
        [0.0, 0.4, 0.1],
        [-0.3, 0.1, 0.3],
        [0.1, -0.4, 0.2],
        [0.2, 0.3, -0.3],
        [-0.4, 0.0, -0.1],
    ):
        goal = robot.fk(q)
        goal[:3, 3] += step
        turned = goal.copy()
        turned[:3, :3] = turned[:3, :3] @ Rotation.from_euler("z", 1.4).as_matrix()
        sampler = Sampler(robot, robot, Line(robot.fk(q), turned), None, 10.0)
        found, made = resolve(sampler, Line(robot.fk(q), turned), q, held=True, many=False)
        if made.stuck is None:
            solved += 1
            np.testing.assert_allclose(found[0][0].q[0], q, atol=1e-12)
            assert np.abs(np.diff(found[0][0].q, axis=0)).max() < 1.0
    assert solved >= 2


def test_a_failure_with_another_law_names_this_law() -> None:
    robot, q = optik.load("paper6r"), np.deg2rad([20, -35, 40, 25, 50, -30])
    goal = robot.fk(q)
    goal[:3, 3] += [2.0, 0.0, 0.0]
    found = plan(robot, free(Line(robot.fk(q), goal), turn=1.0), q, limits=LIMITS, timing="smooth")
    assert not found and found.law == "smooth" and found.limits is LIMITS


def test_a_program_refuses_reconfigurations() -> None:
    robot = optik.load("ur5e")
    q = np.array([0.4, -1.2, 1.6, -1.0, -1.3, 0.2])
    with pytest.raises(InvalidInput, match="reconfigurations"):
        plan(robot, Program([Part(q + 0.1)]), q, limits=LIMITS, reconfigurations=1)


@pytest.mark.parametrize("case", [0, *(pytest.param(case, marks=pytest.mark.soak) for case in (1, 2, 3))])
def test_seams_among_boxes_are_planned_without_a_start(case: int) -> None:
    row = resolve_seams.measure(case)
    assert row["certified"], row
    assert row["coal"] >= -COAL_ERROR


def test_a_refusal_says_where_no_configuration_goes_on_and_which_parts_touch() -> None:
    robot = optik.load("panda")
    q = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.8, 0.8])
    T = robot.fk(q)
    goal = T.copy()
    goal[:3, 3] += [0.0, 0.3, 0.0]
    post = Scene(boxes=[(optik.se3.pose(p=T[:3, 3] + [0.0, 0.15, 0.0]), (0.02, 0.02, 0.02))])  # on the line
    found = plan(robot, Line(T, goal), scene=post, limits=LIMITS)
    assert not found and found.failure is not None
    assert "configurations that were found at s = " in found.failure.reason and "box1" in found.failure.reason
    assert found.status in (PlanStatus.CONTACT, PlanStatus.NO_PATH_FOUND)
    assert found.resolution is not None and found.resolution.stuck is not None
    low, high = found.resolution.stuck
    assert 0.05 < low <= high < 0.2
    away = Line(goal, T)  # nothing goes on at its very start
    closed = Scene(boxes=[(optik.se3.pose(p=goal[:3, 3]), (0.02, 0.02, 0.02))])
    sampler = Sampler(robot, robot, away, CollisionCheck(robot, closed), 10.0)
    _, made = resolve(sampler, away, None, held=False, many=True)
    assert made.stuck == (0.0, 0.0) and made.reason.startswith("all ") and "between" not in made.reason


@pytest.mark.parametrize(("resolve", "limit"), [("global", 10.0), (True, 10.0), ("auto", 0.0), ("auto", float("nan"))])
def test_a_wrong_resolution_is_refused(resolve: Any, limit: float) -> None:
    robot = optik.load("ur5e")
    path = Line(robot.fk(np.full(6, 0.4)), optik.se3.pose(p=[0.4, 0.1, 0.5]))
    for call in (
        lambda: plan(robot, path, resolve=resolve, time_limit=limit),
        lambda: follow(optik.ik.get_solver(robot, "lm"), path, resolve=resolve, time_limit=limit),
    ):
        with pytest.raises(InvalidInput, match=r"resolve|time_limit"):
            call()
    with pytest.raises(InvalidInput, match="reconfigurations"):
        plan(robot, path, reconfigurations=-1)


# ---------------------------------------------------------------- reconfigurations
@pytest.mark.soak
@pytest.mark.parametrize("case", [0])
def test_seams_that_need_reconfigurations_are_cut_where_few_suffice(case: int) -> None:
    row = resolve_cuts.measure(case)
    assert row["certified"] and row["program"] and row["advised"], row
    assert row["found"] == row["asked"]
    assert row.get("coal", 1.0) >= -COAL_ERROR


SEAM = 511
"""Its first draw needs one reconfiguration."""


@cache
def seam(case: int) -> tuple[Robot, Polyline]:
    robot, rng = optik.load(resolve_cuts.ARMS[case % 4]), np.random.default_rng([resolve_cuts.SEED, case])
    while True:
        path = resolve_cuts.draw(robot, rng, 2)
        if path is not None and resolve_cuts.count_cuts(robot, path) == 1:
            return robot, path


def test_a_program_of_stretches_covers_the_seam_and_leaves_it_along_the_tool_axis() -> None:
    robot, path = seam(SEAM)
    found = plan(robot, path, limits=LIMITS, reconfigurations=2)
    assert isinstance(found, ProgramPlan) and found
    assert found.resolution is not None and len(found.resolution.cuts) == 1
    seams = [part for part in found.parts if part.name is not None]
    assert [part.name for part in seams] == ["stretch 1", "stretch 2"]
    ends = [(part.path.begin, part.path.until) for part in seams if isinstance(part.path, Stretch)]
    assert ends[0][0] == 0.0 and ends[0][1] == ends[1][0] == found.resolution.cuts[0] and ends[1][1] == path.end
    away, back = found.parts[1].path, found.parts[3].path
    cut = path.pose(found.resolution.cuts[0])
    for move, end in ((away, away.end), (back, 0.0)):
        step = cut[:3, 3] - move.pose(end)[:3, 3]
        np.testing.assert_allclose(step, np.linalg.norm(step) * cut[:3, 2], atol=1e-6)
    assert np.abs(found.trajectory(0.0) - found.trajectory(found.trajectory.duration)).max() > 0.0


def test_with_a_free_turn_fewer_reconfigurations_are_needed() -> None:
    robot, path = seam(SEAM)
    found = plan(robot, free(path, turn=True), limits=LIMITS, reconfigurations=2)
    assert found and found.resolution is not None and len(found.resolution.cuts) <= 1


def test_a_stretch_is_its_part_of_the_path() -> None:
    robot = optik.load("ur5e")
    poses = robot.fk(np.full(6, 0.4) + np.linspace(0.0, 0.5, 5)[:, None] * np.arange(1.0, 7.0) / 6.0)
    path = Polyline(poses, blend=1e-3)
    part = Stretch(path, 0.2 * path.end, 0.7 * path.end)
    s = np.linspace(0.0, part.end, 50)
    np.testing.assert_array_equal(part.pose(s), path.pose(np.clip(s + part.begin, part.begin, part.until)))
    assert isinstance(part, Path) and not isinstance(part, FreePath)
    for wrong in ((0.3, 0.2), (-0.1, 0.2), (0.0, 2.0 * path.end)):
        with pytest.raises(InvalidInput, match="begin, until"):
            Stretch(path, *wrong)
