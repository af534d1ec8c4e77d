"""Capsules that enclose the links of an arm, and the pairs of them that are not examined, each with its reason."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.limits import frozen
from optik.check import check_count, check_number, check_words, real_array
from optik.errors import InvalidInput
from optik.types import Array, Indices

Capsules: TypeAlias = tuple[Indices, Array, Array, Array]
"""Capsules as kernels take them: link (m,), 0 for the base and i for the frame of joint i, a and b (m, 3), the ends of the
segments in those frames [m], and radius (m,) [m]. A sphere has a = b."""

LONGEST_LINK = 10.0
"""Largest coordinate and radius of a capsule of an arm [m]: no serial arm has longer links, and millimetres are more."""

MOST_CAPSULES = 4096
"""Most capsules of an arm: four hundred times what an arm needs, and all pairs of them still fit in memory."""

NEIGHBOURS = "neighbours"
"""Reason why capsules of one link and of two consecutive links are not examined: they always touch at their joint."""

Apart: TypeAlias = tuple[str | int, str | int, str]
"""Two parts of an arm, each the name of capsules or the number of a link, and the reason why they are not examined."""


@dataclass(frozen=True, eq=False)
class Shapes:
    """Capsules that enclose the links of an arm; equal by content.

    Parameters
    ----------
    capsules : sequence of (link, a, b, radius) or of (link, centre, radius)
        Link 0 is the base, link i moves with joint i, and link n also carries tool and payload; ends of the segment or
        centre, (3,), in the link's frame [m], and radius [m]. `Capsules` are accepted, too.
    names : sequence of str, optional
        What each capsule belongs to, such as the link of a URDF; several may have one name. By default the arm's
        `link_names`: "base", and of each other link the joint that moves it.
    apart : sequence of (one, other, reason), optional
        Pairs that are not examined besides neighbours, such as parts that always touch: names or numbers of links.
    excess : scalar or (m,) array, optional
        How far each capsule stands out beyond what it encloses at most [m]; NaN where unknown, as it is by default.
    source : str
        Where the numbers come from.

    Raises
    ------
    InvalidInput
        Not capsules, NaN, a radius that is not above 0, lengths in millimetres, or a pair of unknown parts.
    """

    capsules: Capsules
    names: tuple[str, ...] = ()
    apart: tuple[Apart, ...] = ()
    excess: Array = np.nan  # type: ignore[assignment]
    source: str = ""

    def __post_init__(self) -> None:
        capsules = _checked_capsules(self.capsules)
        m = len(capsules[0])
        names = check_words(self.names, "shapes.names")
        if names and len(names) != m:
            raise InvalidInput("shapes.names", f"{len(names)} names", f"one for each of {m} capsules")
        if not isinstance(self.source, str):
            raise InvalidInput("shapes.source", repr(self.source)[:60], "a word")
        checked = {
            "capsules": capsules,
            "names": names,
            "excess": checked_excess(self.excess, m, "shapes.excess"),
        }
        for field, value in checked.items():
            object.__setattr__(self, field, value)
        object.__setattr__(self, "apart", tuple(self._checked_apart(self.apart)))

    # ------------------------------------------------------------ identity

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Shapes) and self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    def __reduce__(self) -> tuple[Any, ...]:
        return Shapes, (self.capsules, self.names, self.apart, self.excess, self.source)

    @cached_property
    def digest(self) -> bytes:
        """SHA-256 of the content, equal for equal shapes on any machine."""
        digest = hashlib.sha256(repr((self.names, self.apart)).encode())
        for array in (*self.capsules, self.excess):
            digest.update(array.tobytes())
        return digest.digest()

    def __repr__(self) -> str:
        return f"Shapes({self.m} capsules on {len(set(self.capsules[0].tolist()))} links)"

    @property
    def m(self) -> int:
        """Number of capsules."""
        return len(self.capsules[3])

    # ------------------------------------------------------------ pairs

    def of(self, part: str | int) -> Indices:
        """Return the capsules of a part.

        Parameters
        ----------
        part : str or int
            A name of capsules, or the number of a link.

        Returns
        -------
        (k,) array of int
            Their indices; empty for a name that no capsule has.
        """
        if isinstance(part, str):
            return np.array([i for i, name in enumerate(self.names) if name == part], dtype=np.int64)
        return np.flatnonzero(self.capsules[0] == part)

    @cached_property
    def pairs(self) -> Indices:
        """Pairs (k, 2) of capsules that are examined against each other, the lower index first: all but the ones left out."""
        link = self.capsules[0]
        one, other = np.triu_indices(self.m, 1)
        examined = np.zeros((self.m, self.m), dtype=bool)
        examined[one, other] = np.abs(link[one] - link[other]) > 1
        for first, second, _ in self.apart:
            for i in self.of(first):
                examined[i, self.of(second)] = examined[self.of(second), i] = False
        found = np.argwhere(examined).astype(np.int64)
        found.setflags(write=False)
        return found

    @cached_property
    def left_out(self) -> tuple[tuple[str, str, str], ...]:
        """Pairs of names that are not examined against each other though they move, each with its reason."""
        link, names = self.capsules[0], self.names or tuple(str(i) for i in self.capsules[0].tolist())
        found: dict[tuple[str, str], str] = {}
        for i, j in zip(*np.triu_indices(self.m, 1), strict=True):
            if abs(link[i] - link[j]) == 1 and names[i] != names[j]:
                found.setdefault((names[i], names[j]), NEIGHBOURS)
        for first, second, reason in self.apart:
            for i in self.of(first):
                for j in self.of(second):
                    if abs(link[i] - link[j]) > 1:
                        found.setdefault((names[min(i, j)], names[max(i, j)]), reason)
        return tuple((one, other, reason) for (one, other), reason in found.items())

    def _checked_apart(self, pairs: Any) -> Iterable[Apart]:
        expected = "pairs (one, other, reason): names of capsules or numbers of links, and a word"
        if isinstance(pairs, str) or not isinstance(pairs, Iterable):
            raise InvalidInput("shapes.apart", repr(pairs)[:60], expected)
        for i, pair in enumerate(pairs):
            if not isinstance(pair, list | tuple) or len(pair) != 3 or not isinstance(pair[2], str):
                raise InvalidInput(f"shapes.apart[{i}]", repr(pair)[:80], expected)
            for part in pair[:2]:
                if isinstance(part, str):
                    if part not in self.names:
                        known = ", ".join(dict.fromkeys(self.names))
                        raise InvalidInput(f"shapes.apart[{i}]", repr(part)[:60], f"a name of capsules: {known[:200]}")
                else:
                    check_count(part, f"shapes.apart[{i}]", 0)
            yield tuple(part if isinstance(part, str) else int(part) for part in pair)  # type: ignore[misc]

    # ------------------------------------------------------------ copies

    def with_apart(self, pairs: Iterable[Apart]) -> Shapes:
        """Return the shapes with more pairs that are not examined.

        Parameters
        ----------
        pairs : iterable of (one, other, reason)
            Names of capsules or numbers of links, and the reason.

        Returns
        -------
        Shapes
            The shapes.

        Raises
        ------
        InvalidInput
            Not such pairs, or an unknown name.
        """
        return replace(self, apart=(*self.apart, *pairs))

    def with_srdf(self, source: str | os.PathLike[str]) -> Shapes:
        """Return the shapes without the pairs of links that an SRDF disables, each with the reason that stands there.

        Parameters
        ----------
        source : str or path
            A file, or the XML itself (text that begins with <). Links that have no capsules are passed over.

        Returns
        -------
        Shapes
            The shapes.

        Raises
        ------
        InvalidInput
            No such file, no XML, or no SRDF.
        """
        from optik.arm.shapes.urdf import disabled_pairs

        known = set(self.names)
        return self.with_apart(pair for pair in disabled_pairs(source) if {pair[0], pair[1]} <= known)

    def moved_all(self, poses: Sequence[Array]) -> Shapes:
        """Return the shapes in other frames of the links.

        Parameters
        ----------
        poses : sequence of (4, 4) arrays
            Poses of the present frames in the new ones, of link 0, 1, … [1, m]; links beyond them stay as they are.

        Returns
        -------
        Shapes
            The shapes.
        """
        shapes = self
        for link, T in enumerate(poses):
            shapes = shapes.moved(link, T)
        return shapes

    def moved(self, link: int, T: Array) -> Shapes:
        """Return the shapes with the capsules of one link moved, as when the link's frame is exchanged.

        Parameters
        ----------
        link : int
            Number of the link.
        T : (4, 4) array
            Pose of the present frame in the new one [1, m].

        Returns
        -------
        Shapes
            The shapes.
        """
        links, a, b, radius = self.capsules
        here = (links == link)[:, None]
        a, b = (np.where(here, end @ T[:3, :3].T + T[:3, 3], end) for end in (a, b))
        return replace(self, capsules=(links, a, b, radius))

    def named(self, links: Sequence[str]) -> Shapes:
        """Return the shapes themselves, or, if their capsules have no names yet, with the names of the links.

        Parameters
        ----------
        links : sequence of str
            Names of the links 0 to n.

        Returns
        -------
        Shapes
            The shapes.
        """
        return self if self.names else replace(self, names=tuple(links[i] for i in self.capsules[0].tolist()))


# ---------------------------------------------------------------- checks


def _checked_capsules(value: Any) -> Capsules:
    if isinstance(value, tuple) and len(value) == 4 and all(isinstance(part, np.ndarray) for part in value):
        if len({part.shape[:1] for part in value}) != 1 or not value[0].ndim:
            raise InvalidInput(
                "shapes.capsules", f"arrays of shapes {[p.shape for p in value]}", "one row for each capsule"
            )
        value = list(zip(*(part.tolist() for part in value), strict=True))
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise InvalidInput("shapes.capsules", repr(value)[:60], "a list of (link, a, b, radius)")
    rows = [_checked_row(row, f"shapes.capsules[{i}]") for i, row in enumerate(value)]
    if not 1 <= len(rows) <= MOST_CAPSULES:
        raise InvalidInput("shapes.capsules", f"{len(rows)} of them", f"1 to {MOST_CAPSULES} capsules")
    links, a, b, radii = zip(*rows, strict=True)
    link = np.array(links, dtype=np.int64)
    link.setflags(write=False)
    return link, frozen(np.array(a), "a"), frozen(np.array(b), "b"), frozen(np.array(radii), "radius")


def _checked_row(row: Any, where: str) -> tuple[int, Array, Array, float]:
    """Link, ends and radius of one capsule; of a sphere both ends are the centre."""
    if not isinstance(row, list | tuple) or len(row) not in (3, 4):
        raise InvalidInput(where, repr(row)[:80], "(link, a, b, radius), or (link, centre, radius) of a sphere")
    check_count(row[0], f"{where}: link", 0)
    ends = [point_of(end, where, LONGEST_LINK) for end in row[1:-1]]
    return int(row[0]), ends[0], ends[-1], length_of(row[-1], f"{where}: radius", LONGEST_LINK)


def checked_excess(value: ArrayLike, count: int, where: str) -> Array:
    """Return how far shapes stand out beyond what they enclose, checked.

    Parameters
    ----------
    value : scalar or (count,) array
        Lengths, NaN where unknown [m].
    count : int
        Number of shapes.
    where : str
        What an error calls them.

    Returns
    -------
    (count,) array
        The lengths, read-only [m].

    Raises
    ------
    InvalidInput
        Another number of them, negative or infinite ones.
    """
    excess = real_array(value, where, f"a number, or {count} of them")
    if excess.shape not in ((), (count,)) or (excess < 0.0).any() or np.isinf(excess).any():
        raise InvalidInput(where, repr(value)[:60], f"{count} lengths ≥ 0 (NaN where unknown)")
    return frozen(np.broadcast_to(excess, (count,)), where)


def point_of(value: ArrayLike, where: str, farthest: float) -> Array:
    """Return a point, checked.

    Parameters
    ----------
    value : (3,) array
        Coordinates [m].
    where : str
        What an error calls it.
    farthest : float
        Largest coordinate that is accepted [m]: more looks like millimetres.

    Returns
    -------
    (3,) array
        The point, read-only [m].

    Raises
    ------
    InvalidInput
        Not three finite numbers, or coordinates that look like millimetres.
    """
    point = frozen(value, where)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InvalidInput(where, repr(value)[:80], "points of three finite numbers")
    if (far := float(np.abs(point).max())) > farthest:
        raise InvalidInput(
            where, f"a coordinate of {far:.6g} m", f"metres (within {farthest:g}): looks like millimetres"
        )
    return point


def length_of(value: Any, where: str, largest: float) -> float:
    """Return a length above 0, checked.

    Parameters
    ----------
    value : float
        The length [m].
    where : str
        What an error calls it.
    largest : float
        Largest length that is accepted [m]: more looks like millimetres.

    Returns
    -------
    float
        The length [m].

    Raises
    ------
    InvalidInput
        Not a finite number above 0, or a length that looks like millimetres.
    """
    length = check_number(value, where, "a length above 0", above=0.0)
    if length > largest:
        raise InvalidInput(where, f"{length:.6g} m", f"metres (up to {largest:g}): looks like millimetres")
    return length
