"""An arm with capsules, scenes around it, motions between them, and distances by coal: what the proof of contact is held to."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PPoly
from scipy.spatial.transform import Rotation

import optik
from optik import Scene, Shapes
from optik.arm.robot import Robot
from optik.scene.contact import SELF, bodies_of, find_pairs
from optik.types import Array
from planners import Trajectory
from planners.certificate import clearance
from planners.certificate.clearance import _judge_level
from planners.trajectory.curve import quintic_through

REST = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
AXIS = 0.05 * np.sqrt(0.5)
CAPSULES = (
    (0, (-0.09, 0, 0.06), (-0.06, 0, 0.06), 0.06), (1, (0, 0, -0.333), (0, 0, -0.05), 0.06),
    (2, (0, 0, -0.06), (0, 0, 0.06), 0.06), (3, (0, 0, -0.22), (0, 0, -0.07), 0.06),
    (4, (0, 0, -0.06), (0, 0, 0.06), 0.06), (5, (0, 0, -0.31), (0, 0, -0.21), 0.06),
    (5, (0, 0.08, -0.2), (0, 0.08, -0.06), 0.025), (6, (0, 0, -0.07), (0, 0, 0.01), 0.05),
    (7, (-0.06, 0, 0.01), (0.08, 0, 0.01), 0.04), (7, (-AXIS, -AXIS, 0.147), (AXIS, AXIS, 0.147), 0.04),
    (7, (0.0, 0.0, 0.207), 0.03),
)  # fmt: skip
"""Eleven capsules of the Panda, the hand included, after the coarse ones of franka_description."""
COAL_ERROR = 2e-6
"""What an iterative distance by coal may be off, in metres."""


@cache
def panda() -> Robot:
    return optik.load("panda").with_shapes(Shapes(CAPSULES, apart=((5, 7, "they nearly touch at the wrist"),)))


def scara() -> Robot:
    """An arm with a prismatic joint."""
    links = (
        (1, (0, 0, 0), (0.4, 0, 0), 0.05),
        (2, (0, 0, 0), (0.25, 0, 0), 0.05),
        (4, (0, 0, -0.1), (0, 0, 0.2), 0.02),
    )
    return optik.load("irb910sc").with_shapes(Shapes(links, apart=((2, 4, "the spline is in the second arm"),)))


def pose(position: Any, rotation: Any = None) -> Array:
    T = np.eye(4)
    T[:3, 3] = position
    if rotation is not None:
        T[:3, :3] = rotation
    return T


def table() -> Scene:
    """A table with a shelf of 6 mm boards behind it, and things on the table: 20 boxes."""
    out = [(pose((0.6, 0.0, -0.03)), (0.8, 1.6, 0.04))]
    out += [(pose((0.75, y, z)), (0.3, 0.38, 0.006)) for y in (-0.4, 0.0, 0.4) for z in (0.25, 0.5, 0.75)]
    out += [(pose((0.75, y, 0.4)), (0.3, 0.006, 0.8)) for y in (-0.6, -0.2, 0.2, 0.6)]
    out += [(pose((0.45 + 0.05 * i, -0.3 + 0.1 * i, 0.02)), (0.04, 0.04, 0.05)) for i in range(6)]
    return Scene(boxes=out)


def drawn(rng: np.random.Generator) -> Scene:
    """Boxes, spheres, capsules, cylinders, meshes and planes anywhere around the arm."""

    def place() -> Array:
        angle, far = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.35, 0.9)
        return np.array([far * np.cos(angle), far * np.sin(angle), rng.uniform(-0.1, 1.1)])

    boxes = [
        (pose(place(), Rotation.random(random_state=rng).as_matrix()), rng.uniform(0.01, 0.2, 3)) for _ in range(4)
    ]
    spheres = [(place(), rng.uniform(0.005, 0.08)) for _ in range(3)]
    capsules = [(p, p + 0.3 * rng.normal(size=3), 0.02) for p in (place(), place())]
    planes = [((0.0, 0.0, rng.uniform(-0.4, 0.05)), (0.0, 0.1 * rng.normal(), 1.0))]
    cylinders = [(p, p + 0.2 * rng.normal(size=3), rng.uniform(0.02, 0.1)) for p in (place(), place())]
    meshes = [place() + rng.normal(size=(8, 3)) * rng.uniform(0.01, 0.1, 3) for _ in range(2)]
    return Scene(boxes=boxes, spheres=spheres, capsules=capsules, planes=planes, cylinders=cylinders, meshes=meshes)


def drawn_motion(rng: np.random.Generator, kind: int) -> Trajectory:
    """From near the rest to elsewhere: one quintic, several with continuous accelerations, or with jumps of the velocity."""
    robot, pieces = panda(), (1, 4, 3)[kind % 3]
    limits = robot.limits
    q = np.array([limits.clip(REST + rng.uniform(-1.2, 1.2, 7) * rng.uniform(0.2, 1.0)) for _ in range(pieces + 1)])
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.25, 0.6, pieces))])
    v, a = np.zeros((2, *q.shape))
    if kind % 3 == 1:
        v[1:-1] = (q[2:] - q[:-2]) / (t[2:] - t[:-2])[:, None]
        a[1:-1] = rng.uniform(-3.0, 3.0, a[1:-1].shape)
    if kind % 3 == 2:  # straight from point to point
        return Trajectory(PPoly(np.stack([np.diff(q, axis=0) / np.diff(t)[:, None], q[:-1]]), t))
    return Trajectory(quintic_through(t, q, v, a))


# ---------------------------------------------------------------- the oracle
class Near(NamedTuple):
    """Least distance [m] of each instant to the scene, and between the links."""

    scene: Array
    own: Array


class Oracle:
    """Distances of an arm at configurations by coal, after bounding spheres in plain NumPy."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        import coal

        self._coal, self.robot = coal, robot
        shapes = robot.shapes
        self.link, self.a, self.b, self.radius = shapes.capsules
        self.half = 0.5 * np.linalg.norm(self.b - self.a, axis=1)
        self.parts = [coal.Capsule(float(r), float(2.0 * h)) for r, h in zip(self.radius, self.half, strict=True)]
        self.bodies: list[
            tuple[Any, Any, Array, Array, float]
        ] = []  # shape and transform; a box with a radius around it
        for T, edges in scene.boxes:
            self._add(coal.Box(*map(float, edges)), T, 0.5 * np.array(edges), 0.0)
        for centre, radius in scene.spheres:
            self._add(coal.Sphere(float(radius)), pose(centre), np.zeros(3), float(radius))
        for a, b, radius in scene.capsules:
            length = float(np.linalg.norm(b - a))
            self._add(
                coal.Capsule(float(radius), length),
                pose(0.5 * (a + b), along(b - a)),
                np.array([0.0, 0.0, 0.5 * length]),
                radius,
            )
        for a, b, radius in scene.cylinders:
            half = 0.5 * float(np.linalg.norm(b - a))
            self._add(
                coal.Cylinder(float(radius), 2.0 * half),
                pose(0.5 * (a + b), along(b - a)),
                np.array([radius, radius, half]),
                0.0,
            )
        for corners in scene.meshes:
            points, T = coal.StdVec_Vec3s(), pose(0.5 * (corners.min(axis=0) + corners.max(axis=0)))
            points.extend(list(corners - T[:3, 3]))
            self._add(coal.Convex.convexHull(points, True, "Qt"), T, 0.5 * np.ptp(corners, axis=0), 0.0)
        self.planes = scene.planes
        self.moving = np.flatnonzero(self.link > 0)
        self.pairs = [(i, j) for i, j in shapes.pairs.tolist()]
        planes = sum(map(len, (scene.boxes, scene.spheres, scene.capsules))) + np.arange(len(scene.planes))
        self.checked = np.delete(scene.pair_mask(robot), planes, axis=1)  # in the order of the bodies

    def _add(self, shape: Any, T: Array, half: Array, radius: float) -> None:
        self.bodies.append((shape, self._coal.Transform3s(T[:3, :3].copy(), T[:3, 3].copy()), T, half, radius))

    def _between(self, one: Any, at: Any, other: Any, there: Any) -> float:
        request, result = self._coal.DistanceRequest(), self._coal.DistanceResult()
        return float(self._coal.distance(one, at, other, there, request, result))

    def near(self, q: Array, scene_within: float, own_within: float) -> Near:
        """Least distances at configurations (k, n), infinite where they are above what is asked for."""
        poses = np.concatenate([np.broadcast_to(np.eye(4), (len(q), 1, 4, 4)), self.robot.frames(q)[:, :-1]], axis=1)
        T = poses[:, self.link]
        a = np.einsum("kmij,mj->kmi", T[..., :3, :3], self.a) + T[..., :3, 3]
        b = np.einsum("kmij,mj->kmi", T[..., :3, :3], self.b) + T[..., :3, 3]
        middle, around = 0.5 * (a + b), self.half / 3.0 + self.radius
        thirds = np.stack([a + share * (b - a) for share in (1 / 6, 1 / 2, 5 / 6)], axis=2)  # a sphere around each
        scene, own = np.full(len(q), np.inf), np.full(len(q), np.inf)
        for point, normal in self.planes:
            ends = np.minimum((a - point) @ normal, (b - point) @ normal) - self.radius
            scene = np.minimum(scene, ends[:, self.moving].min(axis=1))
        made: dict[tuple[int, int], Any] = {}

        def at(k: int, i: int) -> Any:
            if (k, i) not in made:
                made[k, i] = self._coal.Transform3s(along(b[k, i] - a[k, i]), middle[k, i].copy())
            return made[k, i]

        for column, (shape, there, T, half, radius) in enumerate(self.bodies):
            off = np.maximum(np.abs((thirds[:, self.moving] - T[:3, 3]) @ T[:3, :3]) - half, 0.0)
            rough = np.linalg.norm(off, axis=3).min(axis=2) - radius - around[self.moving]
            for k, m in np.argwhere((rough <= scene_within) & self.checked[self.moving, column]).tolist():
                i = int(self.moving[m])
                scene[k] = min(scene[k], self._between(self.parts[i], at(k, i), shape, there))
        for i, j in self.pairs:
            apart = np.linalg.norm(thirds[:, i, :, None] - thirds[:, j, None], axis=3)
            rough = apart.min(axis=(1, 2)) - around[i] - around[j]
            for k in np.flatnonzero(rough <= own_within).tolist():
                own[k] = min(own[k], self._between(self.parts[i], at(k, i), self.parts[j], at(k, j)))
        return Near(scene, own)


def along(d: Array) -> Array:
    """A rotation whose z points along d; the identity where d is 0."""
    length = float(np.linalg.norm(d))
    if length == 0.0:
        return np.eye(3)
    z = d / length
    x = np.cross(z, (1.0, 0.0, 0.0) if abs(z[0]) < 0.9 else (0.0, 1.0, 0.0))
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z]).T


def instants(motion: Trajectory, rate: float) -> Array:
    return np.append(np.arange(0.0, motion.end, 1.0 / rate), motion.end)


def bounds_of_one_interval(robot: Robot, motion: Trajectory, scene: Scene) -> Array:
    """Bounds (2,) to the scene and of the arm itself, of a whole motion as one interval whose ends are not looked at."""
    pairs, least = find_pairs(robot, scene).bodies, np.full((2, 4), np.inf)
    count, pieces = len(pairs), motion.knots.size - 1
    polynomials = (motion.padded, motion.knots, motion.piece_ranges, clearance._is_continuous(motion))
    nodes = np.array([[0.0, motion.end]]), np.array([[0, pieces - 1, 0, count]])
    rest, bodies = (np.empty(count, np.int64), np.empty(count)), bodies_of(robot, scene)
    first = (np.arange(count), np.full(count, -np.inf))
    left = _judge_level(robot.chain, bodies, polynomials, (0.0, 0.0, 0.0, 1.0, 1), nodes, first, rest, least)
    for k in range(left[0, 1]):
        kind = int(pairs[rest[0][k], 2] == SELF)
        least[kind, 2] = min(least[kind, 2], rest[1][k])
    return least[:, 2]
