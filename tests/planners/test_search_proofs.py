"""Proofs of edges: an edge, or a region around one, that is in contact by construction is never proved to be free.

Arms have one to three joints with frames anywhere, and the few bodies are small, so that every term of the bounds counts for
some of them. The numbers are small enough for kernels that run as plain Python.
"""

from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from optik import JointLimits, Scene, Shapes
from optik.arm.robot import Robot
from optik.types import Array
from planners.search import JointSpace
from planners.search._trees import find_unproved
from tests.planners.contacts import pose
from tests.seeds import shift_seed

KINDS = ("sphere", "box", "capsule", "cylinder", "mesh", "plane", "cloud", "touched")


def turned(rng: np.random.Generator, far: float = 1.0) -> Array:
    """A pose anywhere."""
    return pose(rng.uniform(-far, far, 3), Rotation.random(random_state=rng).as_matrix())


def arm(frames: Any, slides: Any, *capsules: Any) -> Robot:
    n = len(slides)
    limits = JointLimits(np.full(n, -4.0), np.full(n, 4.0))
    return Robot("arm", np.array(frames), np.array(slides), np.eye(4), limits).with_shapes(Shapes(capsules))


class Bar(NamedTuple):
    """An arm with a bar of 0.02 m on its last link, and the ends (2, 3) of the bar in the link's frame."""

    robot: Robot
    ends: Array


def with_bar(rng: np.random.Generator, n: int) -> Bar:
    """A bar anywhere; or one of which an end is near the last joint's axis and hardly moves."""
    ends = rng.uniform(-1.0, 1.0, (2, 3)) * [1.0, 1.0, 0.7]
    if rng.random() < 0.7:
        ends[rng.integers(2), :2] *= 0.1
    frames, slides = [turned(rng, 0.4 if i else 3.0) for i in range(n)], rng.random(n) < 0.25
    return Bar(arm(frames, slides, (n, *ends, 0.02)), ends)


def point_on(bar: Bar, q: Array, share: float) -> Array:
    """The point of the bar's axis in the base frame."""
    T = bar.robot.frames(q)[bar.robot.n - 1]
    return T[:3, :3] @ (bar.ends[0] + share * (bar.ends[1] - bar.ends[0])) + T[:3, 3]


def place(kind: str, x: Array, rng: np.random.Generator) -> Scene:
    """One object that contains a point, which is often near an edge of it, an end or a side."""
    R = Rotation.random(random_state=rng).as_matrix()
    inner = R @ (0.98 * rng.choice([-1.0, 0.0, 1.0, rng.uniform(-1.0, 1.0)], 3) * [0.3, 0.03, 0.01])
    ends = x + inner - 0.3 * R[:, 0], x + inner + 0.3 * R[:, 0]
    match kind:
        case "sphere":
            return Scene(spheres=[(x, 0.01)])
        case "box":
            return Scene(boxes=[(pose(x + inner, R), (0.6, 0.06, 0.02))])
        case "capsule":
            return Scene(capsules=[(*ends, 0.05)])
        case "cylinder":
            return Scene(cylinders=[(*ends, 0.05)])
        case "mesh":
            corners = rng.normal(size=(8, 3)) * [0.2, 0.05, 0.02] @ R.T
            return Scene(meshes=[x + corners - rng.dirichlet(np.ones(8)) @ corners])
        case "plane":
            return Scene(planes=[(x, R[:, 0])])
        case _:
            return Scene(clouds=[(x + rng.normal(size=(5, 3)) * 0.2 * (np.arange(5) > 0)[:, None], 0.01)])


def below(bar: Bar, a: Array, b: Array, rng: np.random.Generator) -> Scene:
    """A plane that an end of the bar reaches where it is lowest on an edge."""
    T, n = bar.robot.frames(a + np.linspace(0.0, 1.0, 101)[:, None] * (b - a))[:, bar.robot.n - 1], rng.normal(size=3)
    ends = np.einsum("kij,ej->kei", T[:, :3, :3], bar.ends) + T[:, None, :3, 3]
    return Scene(planes=[(ends.reshape(-1, 3)[(ends @ n).argmin()], n)])


def draw_edge(rng: np.random.Generator, n: int) -> tuple[Array, Array, float]:
    """The ends of an edge, and the position on it of a contact as a fraction."""
    a = rng.uniform(-3.0, 3.0, n)
    return a, np.clip(a + rng.uniform(-3.0, 3.0, n), -4.0, 4.0), float(rng.uniform(0.05, 0.95))


def touched(x: Array, rng: np.random.Generator) -> Scene:
    """A sphere that overlaps a bar's surface, or the margin around it, by at most a millimetre."""
    margin, u = rng.choice([0.0, 0.1]), rng.normal(size=3)
    return Scene(spheres=[(x + (0.029 + margin) * u / np.linalg.norm(u), 0.01)], margin=margin)


def is_proved(space: JointSpace, a: Array, b: Array, deviation: Array) -> bool:
    return find_unproved(space.body, a, b, deviation, space.work) < 0


# ---------------------------------------------------------------- contacts by construction
@pytest.mark.parametrize("kind", KINDS)
def test_an_edge_that_sweeps_a_bar_over_an_object_is_not_proved(kind: str) -> None:
    rng, open_ = np.random.default_rng(shift_seed(20)), 0
    for i in range(60):
        n = (1, 1, 2, 3)[i % 4]
        bar = with_bar(rng, n)
        for _ in range(4):
            a, b, t = draw_edge(rng, n)
            x = point_on(bar, a + t * (b - a), rng.choice([0.0, 1.0, rng.random()]))
            scene = (
                below(bar, a, b, rng)
                if kind == "plane"
                else place(kind, x, rng)
                if kind != "touched"
                else touched(x, rng)
            )
            space = JointSpace(bar.robot, scene)
            open_ += space.is_free(a) and space.is_free(b)
            assert not space.is_edge_free(a, b)
    assert open_ > 35, "both ends of many edges are free"


@pytest.mark.parametrize("kind", ["sphere", "box", "cloud"])
def test_a_region_around_an_edge_with_a_contact_is_not_proved(kind: str) -> None:
    """The contact is off the edge by up to the deviation of each joint."""
    rng, aside = np.random.default_rng(shift_seed(21)), 0
    for i in range(60):
        n = (1, 1, 2, 3)[i % 4]
        bar = with_bar(rng, n)
        for _ in range(4):
            a, b, t = draw_edge(rng, n)
            a = b + (a - b) * rng.choice([0.0, 0.1, 1.0])
            deviation = 10.0 ** rng.uniform(-2.0, 0.0) * rng.random(n)
            u = rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)], n)
            x = point_on(bar, a + t * (b - a) + u * deviation, rng.choice([0.0, 1.0, rng.random()]))
            space = JointSpace(bar.robot, place(kind, x, rng))
            assert not is_proved(space, a, b, deviation)
            aside += is_proved(space, a, b, np.zeros(n))
    assert aside > 30, "the edge itself is often free"


@pytest.mark.parametrize("first", [0, 1])
def test_an_edge_on_which_two_links_meet_is_not_proved(first: int) -> None:
    """A bar on link `first` holds the point at which the bar of the third link is in between."""
    rng, open_, zero = np.random.default_rng(shift_seed(22)), 0, np.zeros(3)
    for _ in range(100):
        bar = with_bar(rng, 3)
        a, b, t = draw_edge(rng, 3)
        q = a + t * (b - a)
        x = point_on(bar, q, rng.choice([0.0, 1.0, rng.random()]))
        if first:
            x = np.linalg.solve(bar.robot.frames(q)[0], [*x, 1.0])[:3]
        way = rng.normal(size=3) * rng.choice([0.0, 0.3])
        two = (first, x - rng.random() * way, x + rng.random() * way, 0.01), (3, *bar.ends, 0.02)
        for capsules in (two, two[::-1]):
            robot = arm(bar.robot.fixed, bar.robot.prismatic, *capsules)
            space = JointSpace(robot, Scene())
            open_ += space.is_free(a) and space.is_free(b)
            assert not is_proved(space, a, b, zero)
    assert open_ > 80


def test_an_edge_on_which_a_link_that_rests_is_passed_by_another_is_not_proved() -> None:
    """The third joint undoes what the first does, so that the last link keeps its orientation while the first turns."""
    rng = np.random.default_rng(shift_seed(23))
    for _ in range(40):
        beside = [np.eye(4), pose([*rng.uniform(-0.05, 0.05, 2), 0.0]), pose([*rng.uniform(-0.05, 0.05, 2), 0.0])]
        robot = arm([turned(rng) @ beside[0], *beside[1:]], np.zeros(3, bool), (3, (1.0, 0.0, 0.0), 0.02))
        first, last, still = rng.uniform(-3.0, 0.0), rng.uniform(0.5, 3.0), rng.uniform(-0.5, 0.5)
        a, b = np.array([first, still, -first]), np.array([last, still, -last])
        q = a + rng.uniform(0.1, 0.9) * (b - a)
        frames = robot.frames(q)
        x = np.linalg.solve(frames[0], frames[2] @ [1.0, 0.0, 0.0, 1.0])[:3]
        space = JointSpace(robot.with_shapes(Shapes(((1, x, 0.02), (3, (1.0, 0.0, 0.0), 0.02)))), Scene())
        assert space.is_free(a)
        assert space.is_free(b)
        assert not space.is_edge_free(a, b)


@pytest.mark.parametrize("kind", ["box", "cylinder", "mesh"])
def test_an_edge_on_which_a_ball_dips_to_the_rim_of_a_plate_is_not_proved(kind: str) -> None:
    """The ball circles outside a plate that its path meets at the rim: only the curvature of the path leads to it."""
    rng = np.random.default_rng(shift_seed(24))
    for _ in range(40):
        far, gap, T = rng.uniform(0.5, 2.0), 10.0 ** rng.uniform(-3.0, -1.0), turned(rng)
        size = 0.02 * far
        level = far * (1.0 - gap) - size  # height of the plate over the axis of the joint, by which the gap is left
        reach = np.sqrt(far**2 - (level + 0.9 * size) ** 2)  # where the ball is below 0.9 of its radius over the plate
        half, thick = reach * rng.uniform(1.0, 1.05), 0.1 * far
        robot = arm([T], [False], (1, (0.0, far, 0.0), size))
        lower = level - thick
        if kind == "cylinder":
            plate = Scene(
                cylinders=[(T[:3, :3] @ [0, lower, 0] + T[:3, 3], T[:3, :3] @ [0, level, 0] + T[:3, 3], half)]
            )
        else:
            centre, edges = T @ pose((0.0, level - 0.5 * thick, 0.0)), (2.0 * half, thick, 0.2 * far)
            corners = np.array(np.meshgrid(*([-0.5, 0.5],) * 3)).reshape(3, -1).T * edges @ centre[:3, :3].T
            plate = Scene(boxes=[(centre, edges)]) if kind == "box" else Scene(meshes=[corners + centre[:3, 3]])
        space = JointSpace(robot, plate)
        beyond = 1.5 * np.arcsin(min(1.0, half / far)) + 0.1
        for a in ([-beyond], [beyond]):
            assert not space.is_edge_free(np.array(a), -np.array(a))
        assert space.is_free(np.zeros(1))
