"""What every path must keep, whatever its form: runs over all files in planners/paths."""

import inspect
import json
import sys
from functools import cache
from textwrap import dedent
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from optik.arm.library import load
from optik.errors import InvalidInput, UnknownName
from optik.ik import make_solver
from optik.registry import load_method, short_name
from optik.types import Array
from planners import Arc, JointLine, Line, Path, PointToPoint, Polyline, Spline, follow, free, plan
from planners.paths import ViaPoint, make_path, path_of
from planners.paths.joint_curve import JointCurve
from planners.paths.program import ProgramPath
from planners.paths.stretch import Stretch
from tests import oracles
from tests.contract import test_plans
from tests.oracles import PAPER
from tests.outside import everything, outside
from tests.planners.cases import START, paper6r

TURN = 1e-3
"""What a turn of 1 rad counts beside a metre where a path says which place is nearest."""


def reached(move: Any, turn: Any = (0.0, 0.0, 0.0)) -> Array:
    """A pose near the start of all examples, which the paper's arm reaches."""
    return oracles.moved(paper6r().fk(START), np.asarray(move), np.asarray(turn))


def _corner() -> Array:
    return np.stack(
        [reached((0, 0, 0)), reached((-0.1, 0, 0.1), (0.2, 0, 0)), reached((-0.1, 0.1, 0.12), (0.2, 0.3, 0))]
    )


def _lines() -> dict[str, Path]:
    return {
        "moves": Line(reached((0, 0, 0)), reached((-0.12, 0.0, 0.20))),
        "moves and turns": Line(reached((0, 0, 0)), reached((-0.1, 0.05, 0.1), (0.3, -0.2, 0.4))),
        "turns": Line(reached((0, 0, 0)), reached((0, 0, 0), (0.1, 0.2, -0.15))),
    }


def _arcs() -> dict[str, Path]:
    start = reached((0, 0, 0))
    centre = start[:3, 3] + np.array([-0.06, 0.0, 0.05])
    via, goal = reached((-0.05, 0.03, 0.02)), reached((-0.08, 0.0, 0.1), (0.3, 0.1, -0.2))
    return {
        "through": Arc.through(start, via, goal),
        "fixed": Arc.about(start, centre, [0.1, 1.0, 0.2], 2.0),
        "with the arc": Arc.about(start, centre, [0.1, 1.0, 0.2], -0.7, orientation="arc"),
        "to a goal": Arc.about(start, centre, [0.0, 1.0, 0.0], 9.0, orientation=goal[:3, :3]),
        "nearly straight": Arc.through(start, reached((-0.05, 1e-6, 0.05)), reached((-0.1, 0.0, 0.1), (0.1, 0, 0))),
    }


def _polylines() -> dict[str, Path]:
    poses = _corner()
    on_the_spot = np.stack(
        [poses[0], poses[1], oracles.moved(poses[1], np.zeros(3), np.array([0.0, 0.3, 0.2])), poses[2]]
    )
    return {
        "corner": Polyline(poses, blend=0.01, blend_rotation=0.05),
        "sharp": Polyline(poses),
        "wide": Polyline(poses, blend=1.0, blend_rotation=10.0),
        "turns on the spot": Polyline(on_the_spot, blend=5e-3, blend_rotation=0.05),
        "keeps its orientation": Polyline(
            [reached((0, 0, 0)), reached((-0.1, 0, 0)), reached((-0.1, 0.1, 0))], blend=5e-3
        ),
        "turns only": Polyline([reached((0, 0, 0), w) for w in ((0, 0, 0), (0.3, 0, 0), (0.3, 0.2, 0.1))]),
        "turns far": Polyline(
            [reached((0, 0, 0), w) for w in ((0, 0, 0), (3.0, 0, 0), (3.0, 0.3, 2.0))], blend_rotation=9.0
        ),
        "nearly back": Polyline([reached((0, 0, 0)), reached((-0.1, 0, 0.05)), reached((0, 1e-3, 0))], blend=5e-3),
    }


def _splines() -> dict[str, Path]:
    """Near noisy points, through few points and a closed loop, with and without turns."""
    rng, t = np.random.default_rng(20261125), np.linspace(0.0, 1.0, 60)
    wave = np.stack([-0.1 * t, 0.04 * np.sin(5.0 * t), 0.08 * t], axis=1)
    turns = np.stack([0.3 * t, 0.2 * np.sin(4.0 * t), 0.1 * t * t], axis=1)
    ring = 0.04 * np.stack([np.cos(2.0 * np.pi * t) - 1.0, np.sin(2.0 * np.pi * t), 0.0 * t], axis=1)
    noisy = wave + 1e-4 * rng.normal(size=wave.shape)
    start = reached((0, 0, 0))
    return {
        "near points": Spline(start[:3, 3] + noisy - noisy[0], orientation=start[:3, :3], tolerance=(5e-4, 1e-3)),
        "near poses": Spline(
            [reached(p, w) for p, w in zip(noisy - noisy[0], turns, strict=True)], tolerance=(5e-4, 5e-3)
        ),
        "through poses": Spline([reached(p, w) for p, w in zip(wave[::10], turns[::10], strict=True)], tolerance=0),
        "a loop": Spline([reached(p) for p in ring]),
        "turns far": Spline([reached(p, (0, 0, 7.0 * x)) for p, x in zip(wave, t, strict=True)]),
    }


def _joint_lines() -> dict[str, Path]:
    return {
        "all joints": JointLine(paper6r(), START, START + np.array([0.3, -0.2, 0.25, 0.4, -0.3, 0.5])),
        "the last joint": JointLine(paper6r(), START, START + np.array([0, 0, 0, 0, 0, 0.7])),
        "a sliding joint": JointLine(load("irb910sc"), [0.1, 0.3, 0.05, 0.2], [0.5, -0.4, 0.15, 1.0]),
        "only a sliding joint": JointLine(load("irb910sc"), [0.1, 0.3, 0.05, 0.2], [0.1, 0.3, 0.15, 0.2]),
    }


def _free_paths() -> dict[str, Path]:
    """Given paths, and those that drawn coefficients make of them."""
    rng = np.random.default_rng(20261123)

    def drawn(path: Path, size: float, **freedoms: Any) -> Path:
        one = free(path, **freedoms)
        coefficients = size * rng.normal(size=one.coefficients.shape)
        coefficients[0] = 0.0  # the arm stands there
        return one.with_coefficients(coefficients, None)

    return {
        "given": free(_lines()["moves and turns"], turn=True),
        "turned line": drawn(_lines()["moves"], 0.1, turn=True),
        "tilted arc": drawn(_arcs()["through"], 0.02, tilt=0.3, turn=(-2.0, 2.0)),
        "turned corner": drawn(_polylines()["corner"], 0.02, turn=1.0),
    }


def _moves() -> dict[str, Path]:
    """Joint paths: a straight line, through via points, and of drawn shape."""
    rng, goal = np.random.default_rng(20261124), START + np.array([0.3, -0.2, 0.25, 0.4, -0.3, 0.5])
    via = ViaPoint(reached((-0.04, 0.02, 0.03)), (5e-3, 0.09))
    through = PointToPoint(paper6r(), START, via, goal)
    line = PointToPoint(paper6r(), START, goal)
    drawn = line.coefficients + 0.01 * rng.normal(size=line.coefficients.shape)
    drawn[[0, -1]] = line.coefficients[[0, -1]]
    slide = PointToPoint(load("irb910sc"), [0.1, 0.3, 0.05, 0.2], [0.3, 0.1, 0.1, 0.5], [0.5, -0.4, 0.15, 1.0])
    return {
        "straight": line,
        "through a point": through,
        "drawn": line.with_coefficients(drawn),
        "a sliding joint": slide,
        "near a polyline": line.along(
            [np.stack([START, through.coefficients[5], line.coefficients[-1]])], np.array([0.2, 0.3, 0.4])
        ),
    }


def _joint_curves() -> dict[str, Path]:
    """Curves through nodes of sines, whose derivatives are known, equally and unequally spaced, and of a sliding joint."""
    size, rate = np.array([0.3, -0.2, 0.25, 0.2, -0.3, 0.4]), np.array([1.0, 2.0, 1.5, 0.7, 1.2, 2.2])

    def through(robot: Any, s: Array, middle: Array, size: Array, **options: Any) -> JointCurve:
        x, k = s[:, None] * rate[: size.size], np.arange(1, 4)[:, None]
        q = middle + size * np.sin(x)
        derivatives = size * rate[: size.size] ** k * np.sin(x[:, None] + 0.5 * np.pi * k)
        return JointCurve(robot, s, q, derivatives, **options)

    apart = np.array([0.0, 0.1, 0.15, 0.3, 0.4, 0.5, 0.65, 0.75, 0.9, 1.0])
    slides = load("irb910sc"), apart, np.array([0.1, 0.3, 0.1, 0.2]), np.array([0.3, 0.2, 0.05, 0.4])
    return {
        "equal nodes": through(paper6r(), np.linspace(0.0, 1.0, 9), START, size),
        "two segments": through(paper6r(), apart, START, size, owners=[[0, 0], [0, 1], *7 * [[1, 1]]]),
        "a sliding joint": through(*slides),
    }


def _programs() -> dict[str, Path]:
    """Of one section: at a stop derivatives jump."""
    curve = _joint_curves()["two segments"]
    return {
        "a curve": ProgramPath([curve], [paper6r()]),
        "a polyline": ProgramPath([_polylines()["corner"]], [paper6r()]),
    }


def _stretches() -> dict[str, Path]:
    """Parts of other paths, which begin where the others do."""
    line = Line(reached((0.012, 0.0, -0.02)), reached((-0.12, 0.0, 0.20)))
    corner, freed = _polylines()["corner"], _free_paths()["turned corner"]
    return {
        "of a line": Stretch(line, line.end / 11.0, line.end),
        "of a corner": Stretch(corner, 0.0, 0.8 * corner.end),
        "of a free path": Stretch(freed, 0.0, 0.6 * freed.end),
    }


def _plugin(file: str) -> dict[str, Path]:
    """Paths of a plug-in, from the data in its EXAMPLES, with their start where the others have theirs."""
    module = sys.modules[load_method("planners.paths", file).__module__]
    start = {"start": reached((0, 0, 0)).tolist()}
    return {kind: make_path(file, paper6r(), **(start | data)) for kind, data in module.EXAMPLES.items()}


@cache
def examples() -> dict[str, dict[str, Path]]:
    ours = {
        "arc": _arcs(),
        "free_path": _free_paths(),
        "joint_curve": _joint_curves(),
        "joint_line": _joint_lines(),
        "line": _lines(),
        "point_to_point": _moves(),
        "polyline": _polylines(),
        "program": _programs(),
        "spline": _splines(),
        "stretch": _stretches(),
    }
    return ours | {short_name(file): _plugin(file) for file in outside("planners.paths")}


CASES = [(name, kind) for name, kinds in examples().items() for kind in kinds]
every_path = pytest.mark.parametrize(("name", "kind"), CASES, ids=[f"{n}, {k}" for n, k in CASES])


def arm(path: Path) -> Any:
    return path.robot if isinstance(path, JointLine | PointToPoint | JointCurve) else None


def inside(path: Path, count: int = 40) -> tuple[Array, Array]:
    """Places inside the pieces between breaks, and a step that stays inside four times over."""
    b = path.breaks
    u = np.linspace(0.05, 0.95, count)
    s = (b[:-1, None] + np.diff(b)[:, None] * u).ravel()
    return s, np.repeat(0.01 * np.diff(b), count)


# ---------------------------------------------------------------- the interface
def test_every_file_has_examples_here_and_is_a_path() -> None:
    assert set(examples()) == set(map(short_name, everything("planners.paths")))
    for name, kinds in examples().items():
        for path in kinds.values():
            assert isinstance(path, Path)
            assert path.name == name == path.to_dict()["path"]
            assert path.unit in ("m", "rad")
            assert path.end > 0.0
            assert type(path).__doc__


@every_path
def test_shapes_are_those_of_every_curve(name: str, kind: str) -> None:
    path = examples()[name][kind]
    s = np.linspace(0.0, path.end, 7)
    for order in range(4):
        shape = (6,) if order else (4, 4)
        stacked = path(s, order)
        assert stacked.shape == (7, *shape)
        for i in (0, 3, 6):
            np.testing.assert_allclose(
                path(float(s[i]), order), stacked[i], rtol=0.0, atol=1e-12 * np.abs(stacked).max()
            )
        assert path(np.array([]), order).shape == (0, *shape)
    for wrong in (-1e-3, 1.001 * path.end, np.nan):
        with pytest.raises(InvalidInput, match="s: "):
            path(wrong)
    with pytest.raises(InvalidInput, match="order"):
        path(0.0, 4)


@every_path
def test_all_poses_are_poses(name: str, kind: str) -> None:
    T = examples()[name][kind](np.linspace(0.0, examples()[name][kind].end, 101))
    np.testing.assert_allclose(np.swapaxes(T[:, :3, :3], 1, 2) @ T[:, :3, :3] - np.eye(3), 0.0, rtol=0.0, atol=5e-14)
    assert (np.linalg.det(T[:, :3, :3]) > 0.0).all()
    np.testing.assert_array_equal(T[:, 3], np.tile([0.0, 0.0, 0.0, 1.0], (101, 1)))


@every_path
def test_evaluating_leaves_the_path_as_it_was(name: str, kind: str) -> None:
    path = examples()[name][kind]
    s = np.linspace(0.0, path.end, 11)
    for order in range(4):
        first = path(s, order)
        kept = first.copy()
        first += 1.0
        np.testing.assert_array_equal(path(s, order), kept)


@every_path
def test_plain_data_give_the_same_path_to_the_last_bit(name: str, kind: str) -> None:
    path = examples()[name][kind]
    data = json.loads(json.dumps(path.to_dict(), allow_nan=False))
    again = path_of(data, arm(path))
    assert type(again) is type(path)
    assert again.to_dict() == path.to_dict()
    assert (again.end, again.unit) == (path.end, path.unit)
    s = np.linspace(0.0, path.end, 101)
    for order in range(4):
        np.testing.assert_array_equal(again(s, order), path(s, order))


@pytest.mark.parametrize("name", map(short_name, everything("planners.paths")))
def test_data_that_describe_no_such_path_are_refused(name: str) -> None:
    path = next(iter(examples()[name].values()))
    good = path.to_dict()
    for field in good:
        if field != "path":
            with pytest.raises(InvalidInput, match="data"):
                path_of({k: v for k, v in good.items() if k != field}, arm(path))
            if field != "robot":  # the arm's name; its fingerprint is what counts
                with pytest.raises(InvalidInput):
                    path_of(good | {field: "nothing of the kind"}, arm(path))
    for wrong in (None, [], good | {"path": "another"}):
        with pytest.raises(InvalidInput):
            type(path).from_dict(wrong, arm(path))


def test_a_name_that_no_path_has_lists_the_nearest() -> None:
    with pytest.raises(UnknownName, match="polyline"):
        path_of({"path": "polylines"})
    for wrong in ({}, None, "line", {"path": 3}):
        with pytest.raises(InvalidInput):
            path_of(wrong)


# ---------------------------------------------------------------- derivatives
@every_path
def test_each_order_is_the_derivative_of_the_one_before(name: str, kind: str) -> None:
    path = examples()[name][kind]
    s, h = inside(path)
    bounds = path.derivative_bounds()

    def check(got: Array, wanted: Array, scale: float, before: float) -> None:
        # the rounding of the order before, magnified by 1/h; a piece is at most a few radians of anything
        np.testing.assert_allclose(got, wanted, rtol=0.0, atol=1e-10 * scale + 1e-14 * (before + 1e-3) / h.min())

    check(path(s, 1)[:, :3], oracles.difference(lambda x: path(x)[:, :3, 3], s, h), bounds[0, 0], 1.0)
    turned = oracles.crossing(path(s, 1)[:, 3:]) @ path(s)[:, :3, :3]
    check(turned, oracles.difference(lambda x: path(x)[:, :3, :3], s, h), bounds[1, 0], 1.0)
    for order in (2, 3):
        for part, rows in enumerate((slice(0, 3), slice(3, 6))):
            wanted = oracles.difference(lambda x, o=order, r=rows: path(x, o - 1)[:, r], s, h)
            check(path(s, order)[:, rows], wanted, bounds[part, order - 1], bounds[part, order - 2])


JOINED = [(name, kind) for name, kind in CASES if examples()[name][kind].breaks.size > 2]


@pytest.mark.parametrize(("name", "kind"), JOINED, ids=[f"{n}, {k}" for n, k in JOINED])
def test_all_orders_are_continuous_where_pieces_meet(name: str, kind: str) -> None:
    path = examples()[name][kind]
    b = path.breaks
    assert b[0] == 0.0
    assert b[-1] == path.end
    assert (np.diff(b) > 0.0).all()
    inner = b[1:-1]
    step = 1e-9 * np.diff(b).min()
    bounds = path.derivative_bounds()
    before, after = oracles.rotation_derivatives(path, inner - step), oracles.rotation_derivatives(path, inner + step)
    for order in range(4):
        part = slice(0, 3)
        jump = np.abs(after[order] - before[order]).max()
        assert jump <= 4.0 * bounds[1, order] * step + 1e-12 * (1.0 if order == 0 else bounds[1, order - 1] + 1.0)
        ends = [path(inner + sign * step, order) for sign in (-1.0, 1.0)]
        p = [e[:, :3, 3] if order == 0 else e[:, part] for e in ends]
        assert np.abs(p[1] - p[0]).max() <= 4.0 * bounds[0, order] * step + 1e-12 * (
            1.0 if order == 0 else bounds[0, order - 1] + 1.0
        )


def largest(path: Path, samples: int) -> Array:
    """Largest norms (m, 2, 4) of the derivatives found on each piece, position and rotation; the fourth by secants."""
    found = np.zeros((path.breaks.size - 1, 2, 4))
    for i, (a, b) in enumerate(zip(path.breaks[:-1], path.breaks[1:], strict=True)):
        s = np.linspace(a, b, samples)
        position = [path(s, k)[:, :3] for k in (1, 2, 3)]
        turns = oracles.rotation_derivatives(path, s)[1:]
        # what a secant rises by is never more than the greatest slope
        h = 1e-3 * (b - a)
        lower = np.linspace(a, b - h, samples)
        position.append((path(lower + h, 3)[:, :3] - path(lower, 3)[:, :3]) / h)
        turns.append(
            (oracles.rotation_derivatives(path, lower + h)[3] - oracles.rotation_derivatives(path, lower)[3]) / h
        )
        found[i, 0] = [np.linalg.norm(x, axis=1).max() for x in position]
        found[i, 1] = [np.linalg.norm(x, ord=2, axis=(1, 2)).max() for x in turns]
    return found


def rounding(path: Path) -> Array:
    """What rounding may add to what is found (m, 2, 4)."""
    bounds, out = path.piece_bounds(), np.empty((path.breaks.size - 1, 2, 4))
    for k in range(4):
        out[..., k] = 1e-13 * (1.0 + bounds[..., max(k - 1, 0)])
    out[..., 3] /= 1e-3 * np.diff(path.breaks)[:, None]
    return out


@every_path
def test_no_derivative_passes_its_bound(name: str, kind: str) -> None:
    path = examples()[name][kind]
    bounds = path.piece_bounds()
    assert bounds.shape == (path.breaks.size - 1, 2, 4)
    np.testing.assert_array_equal(path.derivative_bounds(), bounds.max(axis=0))
    assert (largest(path, 301) <= bounds * (1.0 + 1e-12) + rounding(path)).all()


@pytest.mark.parametrize("seed", [*range(12), *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(12, 50))])
def test_no_derivative_of_a_drawn_path_passes_its_bound(seed: int) -> None:
    rng = np.random.default_rng([8, seed])
    robot = test_plans.arm(test_plans.ROBOTS[seed % len(test_plans.ROBOTS)])
    middle, half = 0.5 * (robot.limits.lower + robot.limits.upper), 0.5 * (robot.limits.upper - robot.limits.lower)
    q = middle + rng.uniform(-0.9, 0.9, robot.n) * half
    path = test_plans.path_from(robot, q, test_plans.PATHS[seed % 4], rng)
    samples = (2000 if seed < 12 else 100_000) // (path.breaks.size - 1)
    assert (largest(path, samples) <= path.piece_bounds() * (1.0 + 1e-12) + rounding(path)).all()


TIGHT = {
    "line": (1.0 + 1e-9, 1.0 + 1e-9, 1.0 + 1e-9, 1.0 + 1e-4),
    "arc": (1.0 + 1e-9, 1.0 + 1e-9, 1.0 + 1e-9, 1.0 + 1e-4),
    "polyline": (1.0 + 1e-9, 1.6, 3.0, 3.5),
    "program": (1.3, 1.6, 3.0, np.inf),
    "joint_curve": (1.3, 1.3, 2.5, np.inf),
    "joint_line": (1.3, 1.3, 2.0, np.inf),
    "point_to_point": (1.3, 1.3, 2.0, np.inf),
    "spline": (1.1, 1.2, 1.3, 3.0),
    "free_path": (2.5, 2.5, 3.0, 4.0),  # the sums of the bounds of all turns
    "stretch": (2.5, 2.5, 3.0, 4.0),  # one example is of a free path
}
"""How much above the truth the bounds on the derivatives may be, order by order."""


@every_path
def test_the_bounds_that_a_certificate_rests_on_are_not_far_above_the_truth(name: str, kind: str) -> None:
    path = examples()[name][kind]
    found, slack = largest(path, 301).max(axis=0), 1e-9 + rounding(path).max(axis=0)
    with np.errstate(invalid="ignore"):
        assert (path.derivative_bounds() <= np.array(TIGHT.get(name, TIGHT["polyline"])) * (found + slack)).all()


# ---------------------------------------------------------------- nearest
def cost(at: Array, poses: Array, turn: float) -> Array:
    """Distance, where a turn of 1 rad counts so much."""
    r = at[..., :3, 3] - poses[..., :3, 3]
    R = at[..., :3, :3] - poses[..., :3, :3]
    return np.sqrt((r * r).sum(axis=-1) + 0.5 * turn**2 * (R * R).sum(axis=(-2, -1)))


@every_path
def test_the_nearest_place_to_a_pose_of_the_path_is_where_it_is(name: str, kind: str) -> None:
    path = examples()[name][kind]
    s = np.concatenate([np.linspace(0.0, path.end, 101), path.breaks])
    found = path.nearest(path(s))
    assert found.shape == s.shape
    np.testing.assert_allclose(path(found), path(s), rtol=0.0, atol=1e-8)
    if kind not in ("to a goal", "a loop"):  # other paths pass each place once
        np.testing.assert_allclose(found, s, rtol=0.0, atol=1e-8 * path.end)


@every_path
@pytest.mark.parametrize("far", [1e-5, 1e-2, 1.0])
def test_no_place_is_nearer_than_the_nearest(name: str, kind: str, far: float) -> None:
    path, rng = examples()[name][kind], np.random.default_rng(3)
    poses = np.stack([
        oracles.moved(T, far * rng.normal(size=3), min(far, 0.3) * rng.normal(size=3))
        for T in path(rng.uniform(0.0, path.end, 30))
    ])  # fmt: skip
    found = path.nearest(poses)
    assert ((found >= 0.0) & (found <= path.end)).all()
    everywhere = path(np.linspace(0.0, path.end, 4001))
    by_rotation = isinstance(path, Line) and path.unit == "rad"
    closed = isinstance(path, Line | Arc)
    turn = 1.0 if by_rotation else 0.0 if closed else TURN
    least = np.array([cost(everywhere, T, turn).min() for T in poses])
    assert (cost(path(found), poses, turn) <= least + 1e-9).all()


@every_path
def test_what_are_no_poses_is_refused(name: str, kind: str) -> None:
    path = examples()[name][kind]
    bad = np.full((2, 4, 4), np.nan)
    for wrong in (np.eye(4), np.zeros((2, 3, 3)), bad, "poses", None):
        with pytest.raises(InvalidInput, match="poses"):
            path.nearest(wrong)
    assert path.nearest(np.zeros((0, 4, 4))).shape == (0,)


# ---------------------------------------------------------------- joints
@every_path
def test_only_a_path_in_the_joints_gives_configurations(name: str, kind: str) -> None:
    path = examples()[name][kind]
    robot = arm(path) or paper6r()
    s = np.linspace(0.0, path.end, 5)
    q = path.configurations(robot, s)
    if name not in ("joint_curve", "joint_line", "point_to_point"):
        assert q is None
    else:
        assert q.shape == (5, robot.n)
        np.testing.assert_allclose(robot.fk(q), path(s), rtol=0.0, atol=1e-14)


WITHIN_REACH = [  # not those of four joints, nor those that ask for more than the paper's arm can
    (name, kind)
    for name, kind in CASES
    if arm(examples()[name][kind]) in (None, paper6r()) and kind not in ("to a goal", "turns far")
]


@pytest.mark.parametrize(("name", "kind"), WITHIN_REACH, ids=[f"{n}, {k}" for n, k in WITHIN_REACH])
def test_the_arm_follows_it(name: str, kind: str) -> None:
    path = examples()[name][kind]
    followed = follow(make_solver(paper6r(), "lm"), path, START, samples=401)
    assert followed, followed.failure
    joints = followed.joint_path
    assert joints is not None
    s = np.linspace(0.0, path.end, 50)
    for x, q in zip(s, joints(s), strict=True):
        T = path(x)
        assert np.abs(oracles.fk(PAPER, q)[:3, 3] - T[:3, 3]).max() <= 1e-5
        assert Rotation.from_matrix(oracles.fk(PAPER, q)[:3, :3].T @ T[:3, :3]).magnitude() <= 1e-5
    if isinstance(path, JointLine):
        np.testing.assert_allclose(joints(s), path.configurations(paper6r(), s), rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(joints(s, 2), 0.0, rtol=0.0, atol=1e-6)


# ---------------------------------------------------------------- a path from outside
def test_the_path_in_the_documentation_keeps_the_contract() -> None:
    code = inspect.getdoc(Path).split("::\n", 1)[1].split("\nAttributes\n")[0]
    module: dict[str, Any] = {}
    exec(dedent(code), module)
    path = module["METHOD"](paper6r().fk(START), 0.15, 0.02)
    s = np.linspace(0.1, 0.9, 40) * path.end
    for order in (1, 2, 3):
        slope = (path(s + 1e-5, order - 1) - path(s - 1e-5, order - 1)) / 2e-5
        np.testing.assert_allclose(path(s, order)[:, :3], slope[:, :3, 3] if order == 1 else slope[:, :3], atol=1e-4)
    assert (
        np.linalg.norm(np.stack([path(s, k)[:, :3] for k in (1, 2, 3)]), axis=2).max(axis=1)
        <= path.derivative_bounds()[0, :3]
    ).all()
    again = module["METHOD"].from_dict(json.loads(json.dumps(path.to_dict())))
    assert again.pose(s).tobytes() == path.pose(s).tobytes()
    motion = plan(paper6r(), path, START)
    assert motion.certificate.is_valid
    np.testing.assert_allclose(path.nearest(path.pose(s)), s, atol=1e-7)


@pytest.mark.parametrize(("name", "kind"), CASES, ids=[f"{n}, {k}" for n, k in CASES])
def test_a_path_says_whether_the_tool_only_turns(name: str, kind: str) -> None:
    path = examples()[name][kind]
    assert path.turns_only == (name != "spline" and kind in ("turns", "turns only", "turns far"))
    assert not path.turns_only or path.unit == "rad"
