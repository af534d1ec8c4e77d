"""Capsules that enclose the links of an arm, and the pairs of them that are not checked."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from optik import se3
from optik.arm.limits import ByContent
from optik.arm.shapes.check import Capsules, check_capsules, check_excess
from optik.arm.shapes.enclosure import Hull
from optik.arm.shapes.hulls import check_hulls, list_hulls
from optik.check import check_count, check_kind, check_words, format_value
from optik.errors import InvalidInput
from optik.types import Array, Flags, Indices

NEIGHBOURS = "neighbours"
"""Reason why capsules of one link and of two consecutive links are not checked: they touch at their joint."""
PAYLOAD = "payload"
"""Name of the capsules of a payload, which move with the tool's frame."""
Apart: TypeAlias = tuple[str | int, str | int, str]
"""Two parts of an arm, each a name of capsules or a number of a link, and the reason why they are not checked."""


@dataclass(frozen=True, eq=False)
class Shapes(ByContent):
    """Capsules that enclose the links of an arm; equal by content.

    Parameters
    ----------
    capsules : sequence of (link, a, b, radius) or of (link, centre, radius)
        Link 0 is the base, link i moves with joint i, and link n also carries tool and payload; ends of the segment or
        centre, (3,), in the link's frame [m], and radius [m]; or `Capsules`.
    names : sequence of str, optional
        Part of each capsule, such as the link of a URDF; names may repeat. By default the arm's `link_names`.
    apart : sequence of (one, other, reason), optional
        Pairs that are not checked besides neighbours: names of capsules or numbers of links.
    excess : scalar or (m,) array, optional
        Largest distance of each capsule's surface from the enclosed body [m]; NaN, the default, where unknown.
    source : str
        Source of the numbers.
    unread : sequence of (str, str), optional
        Links of a URDF whose shape could not be read, and why; plans with a scene are then refused.
    hulls : sequence of sequences of (corners, radius, excess), optional
        For each capsule convex hulls of the same part of the body, which decide where capsules touch: corners (v, 3) inside
        the capsule, radius of their rounding and excess [m]. By default, and where there are none, the capsule decides.
    mechanism : sequence of int, optional
        For each capsule the number of its mechanism, in a chain through several: only links of one mechanism are neighbours.

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
    unread: tuple[tuple[str, str], ...] = ()
    hulls: tuple[tuple[Hull, ...], ...] = ()
    mechanism: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        unread = tuple(
            (link, reason) for link, reason in map(partial(check_words, argument="shapes.unread"), self.unread)
        )
        capsules = check_capsules(self.capsules, least=0 if unread else 1)
        m = len(capsules[0])
        names = check_words(self.names, "shapes.names")
        if names and len(names) != m:
            raise InvalidInput("shapes.names", f"{len(names)} names", f"one for each of {m} capsules")
        check_kind(self.source, "shapes.source", str, "a word")
        checked = {"capsules": capsules, "names": names, "excess": check_excess(self.excess, m, "shapes.excess")}
        checked["unread"] = unread
        checked["hulls"] = check_hulls(self.hulls, capsules)
        for k in self.mechanism:
            check_count(k, "shapes.mechanism", 0)
        if len(self.mechanism) not in (0, m):
            raise InvalidInput("shapes.mechanism", f"{len(self.mechanism)} numbers", f"one for each of {m} capsules")
        checked["mechanism"] = tuple(map(int, self.mechanism))
        for field, value in checked.items():
            object.__setattr__(self, field, value)
        object.__setattr__(self, "apart", tuple(self._checked_apart(self.apart)))

    # ------------------------------------------------------------ identity

    @cached_property
    def content(self) -> bytes:
        """SHA-256 of the content, equal on all machines."""
        digest = hashlib.sha256(repr((self.names, self.apart, *self.unread, *self.mechanism)).encode())
        for array in (*self.capsules, self.excess):
            digest.update(array.tobytes())
        for k, hull in ((k, hull) for k, of in enumerate(self.hulls) for hull in of):
            digest.update(repr((k, len(hull.corners), hull.radius, hull.excess)).encode() + hull.corners.tobytes())
        return digest.digest()

    def __repr__(self) -> str:
        return f"Shapes({self.m} capsules on {len(set(self.capsules[0].tolist()))} links)"

    @property
    def m(self) -> int:
        """Number of capsules."""
        return len(self.capsules[3])

    def describe_unread(self) -> str:
        """Describe the links whose shapes could not be read, with advice."""
        (link, reason), *others = dict(self.unread).items()
        more = f" and {len(others)} more" if others else ""
        advice = f"; or without_shape={tuple(dict(self.unread))}" if len(others) < 2 else ""
        advice = advice if advice or "=" in reason else "; or without_shape="
        return f"no scene: the shapes of link {link!r}{more} are not read: {reason}{advice}"

    def describe_excess(self) -> str:
        """Describe by how much the shapes exceed the body of each part, where known: capsules, and hulls in brackets."""
        words = []
        for name in dict.fromkeys(self.names):
            at = self.find_capsules(name)
            finer = [hull.excess for k in at for hull in (self.hulls[k] if self.hulls else ())]
            if np.isfinite(most := float(self.excess[at].max())):
                words.append(f"{name} {1e3 * most:.2g}" + (f" (hulls {1e3 * max(finer):.2g})" if finer else ""))
        return f"{', '.join(words)} mm" if words else ""

    # ------------------------------------------------------------ pairs

    def find_capsules(self, part: str | int) -> Indices:
        """Return the indices of the capsules of a part.

        Parameters
        ----------
        part : str or int
            A name of capsules, or the number of a link.

        Returns
        -------
        (k,) array of int
            Indices; empty for an unknown name.
        """
        if isinstance(part, str):
            return np.array([i for i, name in enumerate(self.names) if name == part], dtype=np.int64)
        return np.flatnonzero(self.capsules[0] == part)

    def _are_near(self, one: Indices, other: Indices) -> Flags:
        """Return which pairs of capsules are on consecutive links of one mechanism."""
        link, of = self.capsules[0], np.array(self.mechanism or [0] * self.m)
        return np.asarray((np.abs(link[one] - link[other]) == 1) & (of[one] == of[other]))

    @cached_property
    def pairs(self) -> Indices:
        """Pairs (k, 2) of capsules that are checked, the lower index first."""
        link = self.capsules[0]
        one, other = np.triu_indices(self.m, 1)
        examined = np.zeros((self.m, self.m), dtype=bool)
        examined[one, other] = ~self._are_near(one, other) & (link[one] != link[other])
        for first, second, _ in self.apart:
            for i in self.find_capsules(first):
                examined[i, self.find_capsules(second)] = examined[self.find_capsules(second), i] = False
        found = np.argwhere(examined).astype(np.int64)
        found.setflags(write=False)
        return found

    @cached_property
    def left_out(self) -> tuple[tuple[str, str, str], ...]:
        """Pairs of names that are not checked although they move, each with its reason."""
        link, names = self.capsules[0], self.names or tuple(str(i) for i in self.capsules[0].tolist())
        found: dict[tuple[str, str], str] = {}
        one, other = np.triu_indices(self.m, 1)
        near = self._are_near(one, other)
        for i, j in zip(one[near], other[near], strict=True):
            if names[i] != names[j]:
                found.setdefault((names[i], names[j]), NEIGHBOURS)
        for first, second, reason in self.apart:
            for i in self.find_capsules(first):
                for j in self.find_capsules(second):
                    if link[i] != link[j] and not self._are_near(i, j):
                        found.setdefault((names[min(i, j)], names[max(i, j)]), reason)
        return tuple((one, other, reason) for (one, other), reason in found.items())

    def _checked_apart(self, pairs: Any) -> Iterable[Apart]:
        expected = "pairs (one, other, reason): names of capsules or numbers of links, and a word"
        if isinstance(pairs, str) or not isinstance(pairs, Iterable):
            raise InvalidInput("shapes.apart", format_value(pairs), expected)
        for i, pair in enumerate(pairs):
            if not isinstance(pair, list | tuple) or len(pair) != 3 or not isinstance(pair[2], str):
                raise InvalidInput(f"shapes.apart[{i}]", format_value(pair), expected)
            for part in pair[:2]:
                if isinstance(part, str):
                    if part not in self.names:
                        known = ", ".join(dict.fromkeys(self.names))
                        raise InvalidInput(
                            f"shapes.apart[{i}]", format_value(part), f"a name of capsules: {known[:200]}"
                        )
                else:
                    check_count(part, f"shapes.apart[{i}]", 0)
            yield tuple(part if isinstance(part, str) else int(part) for part in pair)  # type: ignore[misc]

    def list_bodies(self) -> list[tuple[int, tuple[Array, Array]]]:
        """Return link and hulls of each capsule for `pack_hulls`; the capsule itself where there are none."""
        rows = zip(*self.capsules, self.hulls or [()] * self.m, strict=True)
        return [(link, list_hulls(of or [Hull(np.array([a, b]), radius)])) for link, a, b, radius, of in rows]

    # ------------------------------------------------------------ copies

    def with_apart(self, pairs: Iterable[Apart]) -> Shapes:
        """Return the shapes with more pairs that are not checked.

        Parameters
        ----------
        pairs : iterable of (one, other, reason)
            Names of capsules or numbers of links, and the reason.

        Returns
        -------
        Shapes

        Raises
        ------
        InvalidInput
            Not such pairs, or an unknown name.
        """
        return replace(self, apart=(*self.apart, *pairs))

    def with_srdf(self, source: str | os.PathLike[str]) -> Shapes:
        """Return the shapes with the link pairs of an SRDF excluded from collision checks.

        Parameters
        ----------
        source : str or path
            A file, or XML text (which begins with <). Links without capsules are ignored.

        Returns
        -------
        Shapes

        Raises
        ------
        InvalidInput
            No such file, no XML, or no SRDF.
        """
        from optik.arm.urdf_tree import read_disabled_pairs

        return self.with_apart(read_disabled_pairs(source, tuple(dict.fromkeys(self.names))))

    def with_part(self, name: str, link: int, objects: Iterable[Any], place: ArrayLike | None = None) -> Shapes:
        """Return the shapes with a part added; it replaces a part of the same name.

        Parameters
        ----------
        name : str
            Name of its capsules.
        link : int
            Number of the link that carries it.
        objects : iterable of (T, edges), (centre, radius) or (a, b, radius)
            Boxes, by the pose (4, 4) of the centre and full edge lengths (3,); spheres; capsules [m].
        place : (4, 4) array, optional
            Pose of the objects' frame in the link's frame [1, m].

        Returns
        -------
        Shapes

        Raises
        ------
        InvalidInput
            Other objects.
        """
        from optik.arm.shapes.enclosure import enclose_objects

        added = enclose_objects(objects, name, np.eye(4) if place is None else se3.check_pose(place, "place"))
        kept = self.without_part(name) if name in self.names else self
        rows = [*zip(*kept.capsules, strict=True), *((link, c.a, c.b, c.radius) for c in added)]
        names = (*kept.names, *(name for _ in added))
        excess = np.concatenate((kept.excess, [c.excess for c in added]))
        unread = tuple(pair for pair in self.unread if pair[0] != name)
        hulls = (*kept.hulls, *(() for _ in added)) if kept.hulls else ()
        if kept.mechanism:
            raise InvalidInput("name", repr(name), "a part of a member of the group, by its with_shapes")
        return replace(kept, capsules=rows, names=names, excess=excess, unread=unread, hulls=hulls)  # type: ignore[arg-type]

    def without_part(self, name: str) -> Shapes:
        """Return the shapes without a part.

        Parameters
        ----------
        name : str
            Name of its capsules; its pairs in `apart` are removed, too.

        Returns
        -------
        Shapes

        Raises
        ------
        InvalidInput
            No capsule is left.
        """
        kept = [i for i, other in enumerate(self.names) if other != name]
        rows = list(zip(*(column[kept] for column in self.capsules), strict=True))
        apart = tuple(pair for pair in self.apart if name not in pair[:2])
        names, hulls = tuple(self.names[i] for i in kept), tuple(self.hulls[i] for i in kept if self.hulls)
        mechanism = tuple(self.mechanism[i] for i in kept if self.mechanism)
        return Shapes(rows, names, apart, self.excess[kept], self.source, self.unread, hulls, mechanism)  # type: ignore[arg-type]

    def transform_part(self, part: str | int, T: Array) -> Shapes:
        """Return the shapes with a part transformed in its links' frames.

        Parameters
        ----------
        part : str or int
            A name of capsules, or the number of a link.
        T : (4, 4) array
            A point p of the part becomes T p [1, m].

        Returns
        -------
        Shapes
        """
        links, a, b, radius = self.capsules
        here = np.isin(np.arange(self.m), self.find_capsules(part))[:, None]
        a, b = (np.where(here, end @ T[:3, :3].T + T[:3, 3], end) for end in (a, b))
        of = zip(here[:, 0], self.hulls, strict=False)
        hulls = tuple(tuple(hull.transform(T) for hull in own) if moved else own for moved, own in of)
        return replace(self, capsules=(links, a, b, radius), hulls=hulls)
