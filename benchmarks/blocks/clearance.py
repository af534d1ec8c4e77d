"""Contact between samples: the certificate for every instant compared with sampling by coal, on the same motions."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Annotated, Any
from zlib import crc32

import numpy as np
import polars as pl
from pydantic import BeforeValidator

from benchmarks.blocks.base import NUMBER, TEXT, TRUTH, WHOLE, Field, Kind, Session, Trials, fields_of
from benchmarks.blocks.block import Block, Column, Entry, count, median, quantile, share
from benchmarks.blocks.entries import SceneName, scene_named
from benchmarks.peers.models import pinocchio_model
from benchmarks.settings import Count, RobotName, key, numbered
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput
from optik.registry import short_name
from optik.scene import Scene
from optik.scene.contact import BOX, CYLINDER, MESH, PLANE, SELF, find_nearest_pairs, find_pairs
from optik.types import Array
from planners.certificate.clearance import clearance
from planners.trajectory import Trajectory
from planners.trajectory.curve import quintic_through


def says(word: str) -> pl.Expr:
    """Say whether a method gave this judgement."""
    return pl.col("says") == word


PER_SECOND = pl.col("ms") / pl.col("duration")
"""Time of a judgement per second of motion [ms/s]."""

MEASURES = (
    Column("missed", "missed contacts", "%", "less", "share", of=share("missed", among="contact")),
    Column("contacts", "contacts", show="count", of=count("contact")),
    Column("free", "judged free", "%", "", "share", of=share(says("free"))),
    Column("undecided", "undecided", "%", "less", "share", of=share(says("undecided"))),
    Column("median_ms", "median time of a motion", "ms", "less", of=quantile("ms", 0.5)),
    Column("p99_ms", "99th percentile of the time", "ms", "less", of=quantile("ms", 0.99)),
    Column("median_ms_per_s", "median time per second of motion", "ms/s", "less", of=median(PER_SECOND)),
    Column("samples", "median samples", show="count", aside=True, of=median("samples")),
    Column("false_contacts", "false contacts", show="count", aside=True, of=count("false_contact")),
)
"""Measures: columns of the table of a block, which its targets can name."""


PROOF = "certificate for every instant"
"""Label of the certificate among those of the sampling."""


def _above_0(values: Any) -> tuple[float, ...]:
    if not isinstance(values, list | tuple):
        raise InvalidInput("", repr(values)[:60], "different numbers above 0")
    found = tuple(check_number(value, "", "numbers above 0", above=0.0) for value in values)
    if len(set(found)) < len(found):
        raise InvalidInput("", repr(values)[:60], "different numbers above 0")
    return found


Resolutions = Annotated[tuple[float, ...], BeforeValidator(_above_0)]
"""Different numbers above 0; an empty list for no sampling of this type."""


class ClearanceBlock(Block):
    """Motions of an arm through a scene, judged by the certificate and by sampling."""

    noun = "clearance"
    measures = MEASURES

    robot: RobotName = key("The arm: a name, or the path of a file; it must have shapes.")
    scene: SceneName = key("Scene: `shelf`, `table`, `plates`, or a file.")
    count: Count = key("Number of motions, straight in joint space between two collision-free configurations at rest.")
    joint_steps: Resolutions = key("Sampling: largest joint motion between samples.", (0.2, 0.1, 0.05, 0.02), "rad, m")
    rates: Resolutions = key("Sampling: samples a second.", (100.0, 400.0), "Hz")
    margin: Annotated[float, numbered("metres, 0 or more", least=0.0)] = key(
        "Least distance between arm and scene; for pairs of links it is 0.", 0.0, "m"
    )

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The certificate, then coal at each rate, from coarse to fine."""
        sampled = [sampling_label(step, "rad") for step in self.joint_steps] + [
            sampling_label(rate, "Hz") for rate in self.rates
        ]
        return (Entry(PROOF, "clearance", {}), *(Entry(label, "coal", {}, role="peer") for label in sampled))


def sampling_label(value: float, unit: str) -> str:
    """Return the name of coal at one resolution in reports and targets."""
    return f"coal, {value:g} {unit}"


END_CLEARANCE = 0.01
"""Distance of both ends of a motion beyond the margin [m]: users start and end motions collision-free."""

MOST_END_DRAWS = 100_000
"""Number of samples after which the scene is refused because no collision-free configuration was found."""

USUAL_SPEED, USUAL_ACCELERATION = 2.0, 10.0
"""Limits of a motion [rad/s, rad/s², or metres] for an arm that states none."""

TOUCHING = 2e-6
"""Distance by coal up to which a proved contact counts as confirmed [m]: the error of coal's iterations."""


def draw(block: ClearanceBlock, arm: Robot, scene: Scene, seed: int, number: int) -> Trajectory:
    """Sample a motion: one quintic from rest to rest between two collision-free configurations."""
    keys = (crc32(short_name(text).encode()) for text in (block.robot, block.scene))
    rng = np.random.default_rng((seed, *keys, number))
    ends: list[Array] = []
    for _ in range(MOST_END_DRAWS):
        q = arm.limits.sample(rng, 1)
        if find_nearest_pairs(arm, scene, q)[0][0] > END_CLEARANCE:
            ends.append(q[0])
        if len(ends) == 2:
            break
    else:
        raise InvalidInput(
            "scene", f"{block.scene}: none of {MOST_END_DRAWS:,} samples of {arm.name} is collision-free", "free space"
        )
    way = np.abs(ends[1] - ends[0])
    speed = USUAL_SPEED if arm.limits.velocity is None else arm.limits.velocity
    acceleration = USUAL_ACCELERATION if arm.limits.acceleration is None else arm.limits.acceleration
    T = max((1.875 * way / speed).max(), float(np.sqrt(10.0 / np.sqrt(3.0) * way / acceleration).max()))
    still = np.zeros((2, arm.n))
    return Trajectory(quintic_through(np.array([0.0, T]), np.array(ends), still, still))


def judged(
    block: ClearanceBlock, arm: Robot, scene: Scene, coal: CoalSampling | None, motion: Trajectory
) -> list[dict[str, Any]]:
    """Judge one motion by every method."""
    begin = time.perf_counter()
    proof = clearance(arm, motion, scene)
    near = proof.nearest
    rows: list[dict[str, Any]] = [
        {
            "method": PROOF, "says": "free" if proof.proved else "contact" if proof.touches else "undecided",
            "ms": 1e3 * (time.perf_counter() - begin), "time": near.time, "pair": " and ".join(near.pair),
            "proved": near.value if np.isfinite(near.value) else None, "found": near.found, "samples": None,
        }
    ]  # fmt: skip
    if coal is not None:
        rows += [_sampled(coal, motion, label, count) for label, count in _counts(block, motion)]
        contact = any(row["says"] == "contact" for row in rows[1:])
        if proof.touches and not contact:
            contact = coal.room(motion(near.time)) <= TOUCHING
    else:
        contact = proof.touches
    for row in rows:
        row |= {
            "contact": contact, "missed": contact and row["says"] == "free",
            "false_contact": row["says"] == "contact" and not contact, "duration": motion.duration,
        }  # fmt: skip
    return rows


def _counts(block: ClearanceBlock, motion: Trajectory) -> list[tuple[str, int]]:
    """Return label and number of intervals of every sampling."""
    way = float(np.abs(motion(motion.end) - motion(0.0)).max())
    found = [(sampling_label(step, "rad"), way / step) for step in block.joint_steps]
    found += [(sampling_label(rate, "Hz"), motion.duration * rate) for rate in block.rates]
    return [(label, max(1, int(np.ceil(intervals)))) for label, intervals in found]


def _sampled(coal: CoalSampling, motion: Trajectory, label: str, count: int) -> dict[str, Any]:
    """Return the row of one sampling: at equal distances in joint space, or at equal times."""
    begin = time.perf_counter()
    if label.endswith("rad"):
        start, goal = motion(np.array([0.0, motion.end]))
        q = start + np.linspace(0.0, 1.0, count + 1)[:, None] * (goal - start)
    else:
        q = motion(np.linspace(0.0, motion.end, count + 1))
    first = coal.touches(q)
    return {
        "method": label, "says": "free" if first < 0 else "contact", "ms": 1e3 * (time.perf_counter() - begin),
        "time": None, "pair": None, "proved": None, "found": None, "samples": count + 1,
    }  # fmt: skip


class CoalSampling:
    """The shapes of an arm and a scene in Pinocchio's geometry model: the same pairs as in the certificate."""

    def __init__(self, robot: Robot, scene: Scene) -> None:
        import coal
        import pinocchio as pin

        self._pin, self._coal = pin, coal
        self._model = pinocchio_model(pin, robot)
        self._geometry: Any = pin.GeometryModel()
        assert robot.shapes is not None
        link, a, b, radius = robot.shapes.capsules
        arm = [self._capsule(int(link[k]), a[k], b[k], float(radius[k]), f"arm {k}") for k in range(len(radius))]
        around = self._scene(scene)
        bodies = find_pairs(robot, scene).bodies
        for k, number, kind in bodies.tolist():
            other = arm[number] if kind == SELF else around[kind][number]
            self._geometry.addCollisionPair(pin.CollisionPair(arm[k], other))
        self._data, self._placed = self._model.createData(), self._geometry.createData()
        self._margins = np.where(bodies[:, 2] == SELF, 0.0, scene.margin)
        for request, least in zip(self._placed.collisionRequests, self._margins, strict=True):
            request.security_margin = float(least)

    def touches(self, q: Array) -> int:
        """Return the index of the first configuration with a contact."""
        pin, model, data, geometry, placed = self._pin, self._model, self._data, self._geometry, self._placed
        for k, configuration in enumerate(q):
            if pin.computeCollisions(model, data, geometry, placed, configuration, True):
                return k
        return -1

    def room(self, q: Array) -> float:
        """Return the least clearance of all pairs at a configuration: the distance minus the required margin."""
        self._pin.computeDistances(self._model, self._data, self._geometry, self._placed, q)
        found = [result.min_distance for result in self._placed.distanceResults]
        return float(np.min(found - self._margins, initial=np.inf))

    def _add(self, joint: int, T: Array, shape: Any, name: str) -> int:
        pin = self._pin
        return int(self._geometry.addGeometryObject(pin.GeometryObject(name, joint, pin.SE3(T), shape)))

    def _capsule(self, joint: int, a: Array, b: Array, radius: float, name: str) -> int:
        T, length = np.eye(4), float(np.linalg.norm(b - a))
        T[:3, :3], T[:3, 3] = _along(b - a), 0.5 * (a + b)
        shape = self._coal.Capsule(radius, length) if length > 0.0 else self._coal.Sphere(radius)
        return self._add(joint, T, shape, name)

    def _scene(self, scene: Scene) -> dict[int, list[int]]:
        """Add the objects; their numbers by the kinds of `find_pairs`."""
        box_pose, box_half, a, b, radius, flat, solids = scene.arrays
        boxes = [
            self._add(0, T, self._coal.Box(*(2.0 * half)), f"box {i}")
            for i, (T, half) in enumerate(zip(box_pose, box_half, strict=True))
        ]
        rounds = [self._capsule(0, a[i], b[i], float(radius[i]), f"round {i}") for i in range(len(radius))]
        planes = [
            self._add(0, np.eye(4), self._coal.Halfspace(n, float(n @ p)), f"plane {i}")
            for i, (p, n) in enumerate(zip(flat[:, :3], flat[:, 3:], strict=True))
        ]
        cylinders = [
            self._add(0, row[:16].reshape(4, 4), self._coal.Cylinder(row[16], 2.0 * row[17]), f"cylinder {i}")
            for i, row in enumerate(solids[: len(scene.cylinders)])
        ]
        meshes = [self._add(0, np.eye(4), self._hull(corners), f"mesh {i}") for i, corners in enumerate(scene.meshes)]
        return {BOX: boxes, BOX + 1: rounds, PLANE: planes, CYLINDER: cylinders, MESH: meshes}

    def _hull(self, corners: Array) -> Any:
        points = self._coal.StdVec_Vec3s()
        points.extend(list(corners))
        return self._coal.Convex.convexHull(points, True, "Qt")


def _along(d: Array) -> Array:
    """Return a rotation whose z points along d; the identity where d is 0."""
    length = float(np.linalg.norm(d))
    if length == 0.0:
        return np.eye(3)
    z = d / length
    x = np.cross(z, (1.0, 0.0, 0.0) if abs(z[0]) < 0.9 else (0.0, 1.0, 0.0))
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z]).T


FIELDS = {
    "method": TEXT, "problem": WHOLE, "says": TEXT, "time": NUMBER, "pair": TEXT,
    **fields_of(NUMBER, "proved found duration"), "samples": WHOLE,
    "ms": Field(pl.Float64, None, "time of a judgement", "ms", "less", clock="wall"), "contact": TRUTH,
    "missed": Field(pl.Boolean, None, "missed contacts", "%", "less", only="contact"), "false_contact": TRUTH,
}  # fmt: skip
"""Fields of the rows."""


class _Clearance(Kind):
    """Blocks of motions through a scene."""

    name = "clearance"
    title = "Contact between samples"
    block = ClearanceBlock
    fields = FIELDS
    size = 20
    order = 65

    def prepare(self, block: ClearanceBlock, seed: int) -> None:
        scene = scene_named(block.scene)
        if scene.clouds:
            raise InvalidInput(
                "scene", f"{block.scene}: {len(scene.clouds)} clouds", "no clouds, which coal does not sample"
            )
        scene.pair_mask(load(block.robot))

    def share(self, session: Session) -> tuple[Robot, Scene, CoalSampling | None]:
        """Return arm, scene, and the sampling where coal is installed, after a first motion, which compiles."""
        block: ClearanceBlock = session.block
        arm, scene = load(block.robot), scene_named(block.scene, block.margin)
        try:
            coal = CoalSampling(arm, scene)
        except ModuleNotFoundError:
            coal = None
        judged(block, arm, scene, coal, draw(block, arm, scene, session.seed, 0))
        return arm, scene, coal

    def count(self, block: ClearanceBlock, session: Session) -> int:
        return block.count

    def solve(self, trials: Trials) -> Iterator[dict[str, Any]]:
        """Judge every motion by every method."""
        assert trials.session is not None
        arm, scene, coal = trials.session.shared
        for number in trials.numbers:
            found = judged(trials.block, arm, scene, coal, draw(trials.block, arm, scene, trials.seed, number))
            yield from (row | {"problem": number} for row in found)


METHOD = _Clearance
