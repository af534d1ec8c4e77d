"""Resolution of a path with freedoms: the extended arm, its sequences, and paths with coefficients that follow them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from optik import se3
from optik.arm.inertia import Inertia, join_bodies, transform_body
from optik.arm.limits import DYNAMIC_LIMITS
from optik.arm.robot import Robot
from optik.types import Array, Indices
from planners.following.branches import CollisionCheck
from planners.following.resolve import Resolution, resolve
from planners.following.resolve.graph import Sampler, Sequence, relax_sequences
from planners.freedom.base import Bounds, Freedom
from planners.paths.base import Path
from planners.paths.free_path import FreePath

# ---------------- the extended arm


NO_PITCH = 1e-9
"""Largest pitch of a screw that is a joint: a helical motion is none."""


def is_joint(kind: Freedom) -> bool:
    """Return whether each coordinate of a freedom is a turn about an axis or a shift."""
    screws = np.array(kind.screws).reshape(-1, 2, 3)
    return bool((np.abs(np.einsum("ki,ki->k", *np.swapaxes(screws, 0, 1))) <= NO_PITCH).all())


def extend(robot: Robot, freedoms: tuple[tuple[Freedom, Bounds], ...]) -> Robot:
    """Return the arm with a joint for each coordinate of freedoms; its tool is that of the given path.

    From tool = given · exp(f₁ξ₁) … exp(f_dξ_d) follows given = FK(q) · exp(−f_dξ_d) … exp(−f₁ξ₁), the last freedom first. The
    joints have the ranges of the freedoms, no limits on their rates, and links without mass and shape. An interval of payload
    masses leaves the masses unknown.
    """
    return add_joints(robot, [
        (f"{kind.name}{i + 1 if len(kind.screws) > 1 else ''}", screw, (-high if kind.round else low, high))
        for kind, (low, high) in reversed(freedoms) for i, screw in reversed(list(enumerate(np.array(kind.screws))))
    ])  # fmt: skip


def add_joints(robot: Robot, joints: list[tuple[str, Array, Bounds]]) -> Robot:
    """Return the arm with joints behind the tool: the name, the screw (6,) that each undoes, and the range [rad, m]."""
    if not joints:
        return robot
    tool, fixed, prismatic = robot.tool, list[Array](), list[bool]()
    for _, screw, _ in joints:
        frame, slides = _joint_frame(screw)
        fixed.append(tool @ frame)
        tool = se3.inverse(frame)
        prismatic.append(slides)
    labels, (lower, upper) = [name for name, _, _ in joints], np.transpose([bounds for _, _, bounds in joints])
    limits, d = robot.limits, len(fixed)
    names = [label if label not in robot.joint_names else f"{label}_freedom" for label in labels]
    rates = {
        name: np.append(x, np.full(d, np.inf)) for name in DYNAMIC_LIMITS if (x := getattr(limits, name)) is not None
    }
    wide = limits.replace(lower=np.append(limits.lower, lower), upper=np.append(limits.upper, upper),
                          velocity_by_position=None, **rates)  # fmt: skip
    return replace(
        robot, motors=None, name="+".join([robot.name, *labels]), fixed=np.concatenate([robot.fixed, fixed]),
        prismatic=np.append(robot.prismatic, prismatic), tool=tool, limits=wide, payload=None,
        joint_names=(*robot.joint_names, *names), inertia=_carry(robot, d),
        linkage=robot.linkage and robot.linkage.append(prismatic, names),
    )  # fmt: skip


def columns_of(
    robot: Robot, freedoms: tuple[tuple[Freedom, Bounds], ...]
) -> tuple[Indices, tuple[tuple[int, float], ...]]:
    """Return the joints of the extended arm in the order of the coordinates, and the discs: first joint of two, and radius."""
    ends = np.cumsum([0, *(len(kind.screws) for kind, _ in freedoms)]).tolist()
    n = robot.n + ends[-1]
    discs = [(n - end, high) for (kind, (_, high)), end in zip(freedoms, ends[1:], strict=True) if kind.round]
    return n - 1 - np.arange(ends[-1]), tuple(discs)


def _joint_frame(screw: Array) -> tuple[Array, bool]:
    """Return the frame of a joint that undoes a screw: its axis z is opposite; and whether it slides."""
    v, w = screw[:3], screw[3:]
    slides = not w.any()
    z = -(v if slides else w)
    x = np.eye(3)[np.abs(z).argmin()]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    point = np.zeros(3) if slides else np.cross(w, v)
    return se3.pose(np.column_stack([x, np.cross(z, x), z]), point), slides


def _carry(robot: Robot, d: int) -> Inertia | None:
    """Return the masses of the links, the last one with the payload, and d links without mass."""
    inertia = robot.inertia
    if inertia is None or (robot.payload is not None and len(robot.payload.bodies) > 1):
        return None
    *links, last = inertia.bodies
    if robot.payload is not None:
        last = join_bodies([last, transform_body(robot.payload.bodies[0], robot.tool)])
    none = (0.0, np.zeros(3), np.zeros((3, 3)))
    mass, com, tensor = (np.array(part) for part in zip(*links, last, *[none] * d, strict=True))
    motor, viscous, coulomb = (np.append(x, np.zeros(d)) for x in (inertia.motor, inertia.viscous, inertia.coulomb))
    return Inertia(mass, com, tensor, motor, viscous, coulomb)


# ---------------- resolution of a path with freedoms


SAMPLES_PER_COEFFICIENT = 4
"""Values of a coordinate for each coefficient that is fitted to it."""
MORE_COEFFICIENTS = (1.0, 1.5, 2.5, 5.0)
"""Numbers of coefficients, over that of the path, that are fitted until one can be followed."""
GUESSES: tuple[tuple[dict[str, float], int], ...] = (
    ({"turn": np.inf}, 5), ({"tilt": 0.3}, 3), ({"turn": np.inf, "tilt": 0.3}, 3)
)  # fmt: skip
"""Freedoms [rad] in which guesses are searched for if a path has all of them, and the number of guesses."""
ENDS, SAME_WAY = [0, -1], 0.1
"""Sequences whose end configurations differ by less than this [rad, m] count as one guess."""
MOST_CAUTION = 3
"""Degrees of caution of the relaxation that are tried."""


class FreeWay(NamedTuple):
    """Joints q (k, n) [rad, m] and coordinates f (k, d) of the freedoms at positions s (k,) along a path."""

    s: Array
    q: Array
    f: Array

    @property
    def joints(self) -> Sequence:
        """The joints alone."""
        return Sequence(self.s, self.q)

    def fit(self, path: FreePath) -> Array:
        """Return the coefficients (C, d) of the coordinates, inside their ranges."""
        at = np.linspace(0.0, path.end, SAMPLES_PER_COEFFICIENT * path.spline.count)
        f = scipy.interpolate.make_interp_spline(self.s, self.f, k=min(3, len(self.s) - 1))(at)
        return path.control_bounds.clip(path.spline.fit(at, f))


def can_resolve(path: FreePath) -> bool:
    """Return whether a path has freedoms that move the tool, and all of them are joints."""
    return len(path.screws) > 0 and all(is_joint(kind) for kind in path.kinds)


class Resolver:
    """Finds sequences of an arm and the freedoms of a path.

    Parameters
    ----------
    robot : Robot
        The arm.
    path : Path
        The path; freedoms that move the tool are joints (`can_resolve`).
    collision : CollisionCheck or None
        The arm in its scene.
    time_limit : float
        Computing time [s]; may be infinite.
    """

    def __init__(self, robot: Robot, path: Path, collision: CollisionCheck | None, time_limit: float) -> None:
        kinds = path.kinds if isinstance(path, FreePath) else ()
        freedoms = tuple((kind, path.bounds[kind.name]) for kind in kinds if kind.screws)  # type: ignore[attr-defined]
        self.path, self.given = path, path.given if isinstance(path, FreePath) else path
        self.n, self.arm = robot.n, extend(robot, freedoms)
        self._columns, discs = columns_of(robot, freedoms)
        self._time_limit = time_limit
        self.sampler = Sampler(self.arm, robot, self.given, collision, time_limit, discs)
        self._held = False

    def find(
        self, q: Array | None, *, held: bool, many: bool, count: int = 1, cuts: int = 0
    ) -> tuple[list[list[Sequence]], Resolution]:
        """Return sequences of the extended arm from a start, or preferred near it; none if none reaches the end."""
        start = None
        if q is not None:
            start = np.append(q, np.zeros(self.arm.n - self.n))
            start[self._columns] = self.path.coefficients[0] if isinstance(self.path, FreePath) else 0.0
        found, made = resolve(self.sampler, self.given, start, held=held, many=many, count=count, cuts=cuts)
        self._held = held
        return found if made.stuck is None else [], made

    def guess(self, count: int) -> tuple[list[FreeWay], Resolution]:
        """Return sequences as initial guesses, clipped to the ranges of the freedoms.

        The searches use each of the freedoms turn and tilt that the path has, and both, whatever their ranges are. So more
        freedom starts from the same guesses, or from more.
        """
        path, ways = self.path, list[FreeWay]()
        assert isinstance(path, FreePath)
        sets = [({kind: (-top, top) for kind, top in kinds.items()}, most) for kinds, most in GUESSES]
        known = [one for one in sets if one[0].keys() <= path.bounds.keys()]
        for bounds, most in known or [(path.bounds, count)]:
            wide = FreePath(self.given, bounds)
            resolver = Resolver(self.sampler.own, wide, self.sampler.collision, self._time_limit)
            sequences, resolution = resolver.find(None, held=False, many=False, count=min(most, count))
            if resolution.limited:  # a search that the clock ended is not repeatable
                break
            for s, q, f in resolver.relax([parts[0] for parts in sequences]):
                values = np.tile(path.coefficients[:1], (len(s), 1))
                for name, columns in wide.columns.items():
                    values[:, path.columns[name]] = f[:, columns]
                q, ok = self.sampler.project(
                    np.append(q, values[:, np.argsort(self._columns)], axis=1), self.given.pose(s)
                )
                way = FreeWay(s, q[:, : self.n], q[:, self._columns])
                if ok.all() and all(np.abs(way.q[ENDS] - one.q[ENDS]).max() > SAME_WAY for one in ways):
                    ways.append(way)
        return ways, resolution

    def relax(self, sequences: list[Sequence], caution: int = 0) -> list[FreeWay]:
        """Return the sequences with shorter motions."""
        found = relax_sequences(self.sampler, self.given, sequences, held=self._held, caution=caution)
        return [FreeWay(s, q[:, : self.n], q[:, self._columns]) for s, q in found]

    def candidates(self, found: list[Sequence], ways: list[FreeWay]) -> Iterator[tuple[FreePath, FreeWay]]:
        """Yield paths with coefficients of sequences that were relaxed: few coefficients first, then farther from limits."""
        assert isinstance(self.path, FreePath)
        for caution in range(MOST_CAUTION):
            for sequence, way in zip(found, ways, strict=True):
                if caution and self.sampler.is_over:
                    return
                chosen = self.relax([sequence], caution)[0] if caution else way
                for factor in MORE_COEFFICIENTS if self.path.counts_itself else (1.0,):
                    count = int(factor * self.path.spline.count)
                    path = self.path if factor == 1.0 else self.path.with_count(count)
                    yield path.with_coefficients(chosen.fit(path), None), chosen
