"""Base of searches: the joint space of an arm among objects, what a search returns, and the results for users."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import ClassVar, NamedTuple, TypeAlias

import numpy as np

from optik.arm.robot import Robot
from optik.check import check_count
from optik.errors import InvalidInput
from optik.registry import ClassName
from optik.scene import Scene
from optik.scene.contact import check_scene
from optik.types import Array
from planners.search._trees import Body, Work, find_blocked, find_unproved, make_body, make_work, prove_corner, shorten

MOST_CONFIGURATIONS = 10_000_000
"""Largest number of samples of a search: more would take hours."""

MOST_TURNED = 4.0 * np.pi * (1.0 + 1e-9)
"""Widest range of a joint that is searched as a whole [rad]: two turns, and rounding."""


class SearchStatus(StrEnum):
    """Outcome of a search.

    START_IN_CONTACT, GOAL_IN_CONTACT: the configuration is in contact with the scene or itself, or within the margin.
    GOAL_UNREACHABLE: no configuration inside the limits reaches the pose. NO_PATH_FOUND: the samples are used up; a path may
    exist.
    """

    FOUND = "found"
    NO_PATH_FOUND = "no_path_found"
    START_IN_CONTACT = "start_in_contact"
    GOAL_IN_CONTACT = "goal_in_contact"
    GOAL_UNREACHABLE = "goal_unreachable"


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Collision-free paths between two configurations; true if there is one.

    Attributes
    ----------
    status : SearchStatus
        Outcome.
    paths : tuple of (k, n) arrays
        Vertices of the paths [rad, m], the shortest first. Between two vertices the joints move on a straight line, which is
        proved to be collision-free.
    samples : int
        Number of random configurations that the searches used.
    reason, advice : str
        Why there is no path, and what to try; empty if there is one.
    """

    status: SearchStatus
    paths: tuple[Array, ...]
    samples: int
    reason: str = ""
    advice: str = ""

    def __bool__(self) -> bool:
        return self.status is SearchStatus.FOUND

    @property
    def vertices(self) -> Array:
        """Vertices (k, n) of the shortest path [rad, m]; (0, 0) without one."""
        return self.paths[0] if self.paths else np.empty((0, 0))

    @property
    def length(self) -> float:
        """Length of the shortest path in joint space [rad, m]; infinite without one."""
        return measure_length(self.paths[0]) if self.paths else np.inf


def measure_length(vertices: Array) -> float:
    """Return the length of a path in joint space: vertices (k, n) [rad, m]."""
    return float(np.linalg.norm(np.diff(vertices, axis=0), axis=1).sum())


class SearchAttempt(NamedTuple):
    """What a search returns: the vertices (k, n) [rad, m] from the start to a goal, or None; and the number of samples used."""

    vertices: Array | None
    samples: int


@dataclass(frozen=True)
class JointSpace:
    """The configurations of an arm inside its limits, among the objects of a scene.

    Parameters
    ----------
    robot : Robot
        An arm with shapes.
    scene : Scene
        Objects, and the margin to them.
    """

    robot: Robot
    scene: Scene

    def __post_init__(self) -> None:
        for name, kind in (("robot", Robot), ("scene", Scene)):
            if not isinstance(value := getattr(self, name), kind):
                allowed = "; an empty one for the arm's own links only" if kind is Scene else ""
                raise InvalidInput(name, repr(value)[:60], f"a {kind.__name__}{allowed}")
        check_scene(self.robot, self.scene)

    @cached_property
    def body(self) -> Body:
        """Arguments of the kernels."""
        return make_body(self.robot, self.scene)

    @cached_property
    def work(self) -> Work:
        """Memory of the kernels, for one thread."""
        return make_work(self.body)

    def find_range(self, ends: Array) -> tuple[Array, Array]:
        """Return the range of joint values in which a search samples.

        Parameters
        ----------
        ends : (k, n) array
            Start, then goals, the nearest first [rad, m].

        Returns
        -------
        tuple of (n,) arrays
            The limits [rad, m]. Where there is none, half a turn or 3 m beyond the start and the nearest goal, and all goals.
            Of a joint that turns more than twice, at most a turn beyond them, because further turns are the same places.
        """
        limits, least, most = self.robot.limits, ends.min(axis=0), ends.max(axis=0)
        near = ends[:2]
        lower = np.where(np.isfinite(limits.lower), limits.lower, np.minimum(near.min(axis=0) - np.pi, least))
        upper = np.where(np.isfinite(limits.upper), limits.upper, np.maximum(near.max(axis=0) + np.pi, most))
        several = self.robot.turning & (upper - lower > MOST_TURNED)
        lower = np.where(several, np.maximum(lower, least - 0.5 * MOST_TURNED), lower)
        return lower, np.where(several, np.minimum(upper, most + 0.5 * MOST_TURNED), upper)

    def is_free(self, q: Array) -> bool:
        """Return whether no links are in contact, and all keep more than the margin from the scene.

        Parameters
        ----------
        q : (n,) array
            Configuration [rad, m].

        Returns
        -------
        bool
        """
        inside = self.robot.motors is None or bool(self.robot.limits.contains(q))
        return inside and find_blocked(self.body, q, self.work) < 0

    def is_edge_free(self, a: Array, b: Array) -> bool:
        """Return whether the straight joint motion from a to b is proved to be collision-free.

        Parameters
        ----------
        a, b : (n,) array
            Configurations [rad, m], the first one free.

        Returns
        -------
        bool
        """
        return find_unproved(self.body, a, b, np.zeros(self.robot.n), self.work) < 0

    def find_corner_lengths(self, vertices: Array) -> Array:
        """Return how far each corner of a path may be cut, proved to be collision-free.

        Parameters
        ----------
        vertices : (k, n) array
            A path of straight joint motions [rad, m].

        Returns
        -------
        (k,) array
            Length along both edges [rad, m], at most half of the shorter one: every configuration of the triangle between the
            vertex and the points at this length before and behind it is collision-free. 0 at the ends, and without a proof.
        """
        path = np.ascontiguousarray(vertices, dtype=np.float64)
        edges = np.diff(path, axis=0)
        lengths = np.linalg.norm(edges, axis=1)
        proved = np.zeros(len(path))
        for k in range(1, len(path) - 1):
            half = 0.5 * min(lengths[k - 1], lengths[k])
            if half > 0.0:
                a, b = path[k] - half / lengths[k - 1] * edges[k - 1], path[k] + half / lengths[k] * edges[k]
                proved[k] = half * prove_corner(self.body, a, path[k], b, self.work)
        return proved

    def shorten(self, vertices: Array, draws: Array) -> Array:
        """Return a shortened path, proved to be collision-free.

        Parameters
        ----------
        vertices : (k, n) array
            A path of straight joint motions that are collision-free [rad, m].
        draws : (rounds, 2) array
            For each shortcut that is tried, two positions along the path as fractions [1] of its length.

        Returns
        -------
        (m, n) array
            Vertices [rad, m].
        """
        path = np.concatenate([vertices, np.empty((2 * len(draws), self.robot.n))])
        return path[: shorten(self.body, path, len(vertices), draws, self.work)].copy()


class Search(ABC):
    """Base of searches for paths. A search is a subclass in a file of its own in this folder, named by ``METHOD``.

    Parameters
    ----------
    max_samples : int
        Largest number of random configurations of one search.
    """

    name: ClassVar[str] = ClassName()  # type: ignore[assignment] # read as a str
    """Name of the search, the stem of its file."""

    def __init__(self, max_samples: int = 100_000) -> None:
        check_count(max_samples, "max_samples", 1, MOST_CONFIGURATIONS)
        self.max_samples = max_samples

    @abstractmethod
    def search(self, space: JointSpace, start: Array, goals: Array, seed: tuple[int, ...]) -> SearchAttempt:
        """Search a path from the start to one of the goals. Every motion between vertices must be proved by `JointSpace`.

        Parameters
        ----------
        space : JointSpace
            The arm and the scene.
        start : (n,) array
            Start, inside the limits and free [rad, m].
        goals : (k, n) array
            Goals, inside the limits and free [rad, m].
        seed : tuple of int
            Key of the random numbers, to which a last number above 0 is added for `numpy.random.default_rng`. Equal keys give
            equal paths.

        Returns
        -------
        Attempt
            The path, if one was found.
        """


SearchLike: TypeAlias = str | os.PathLike[str] | type[Search] | Search
"""A search: its name, file or class, or a search that is built."""
METHOD_BASE = Search
"""Base class of the METHOD of every module here and of every plug-in."""
