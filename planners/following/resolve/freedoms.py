"""Resolution of a path with freedoms: sequences of the extended arm, and paths with coefficients that follow them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import scipy

from optik.arm.robot import Robot
from optik.types import Array
from planners.following.collision import CollisionCheck
from planners.following.resolve import Resolution, resolve
from planners.following.resolve.extend import columns_of, extend, is_joint
from planners.following.resolve.graph import Sequence
from planners.following.resolve.nodes import Sampler
from planners.following.resolve.relax import relax
from planners.paths.base import Path
from planners.paths.free_path import FreePath

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
            found, made = resolver.find(None, held=False, many=False, count=min(most, count))
            if made.limited:  # a search that the clock ended is not repeatable
                break
            for s, q, f in resolver.relax([parts[0] for parts in found]):
                values = np.tile(path.coefficients[:1], (len(s), 1))
                for name, columns in wide.columns.items():
                    values[:, path.columns[name]] = f[:, columns]
                q, ok = self.sampler.project(
                    np.append(q, values[:, np.argsort(self._columns)], axis=1), self.given.pose(s)
                )
                way = FreeWay(s, q[:, : self.n], q[:, self._columns])
                if ok.all() and all(np.abs(way.q[ENDS] - one.q[ENDS]).max() > SAME_WAY for one in ways):
                    ways.append(way)
        return ways, made

    def relax(self, sequences: list[Sequence], caution: int = 0) -> list[FreeWay]:
        """Return the sequences with shorter motions."""
        found = relax(self.sampler, self.given, sequences, held=self._held, caution=caution)
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
