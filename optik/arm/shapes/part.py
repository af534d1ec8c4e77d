"""Capsules of a part that is described by boxes, spheres and capsules, such as a payload."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from optik import se3
from optik.arm.shapes.check import LONGEST_LINK, check_length, check_point
from optik.arm.shapes.enclosure import box_triangles, enclose_mesh
from optik.arm.shapes.excess import Capsule
from optik.check import format_value
from optik.errors import InvalidInput
from optik.types import Array


def enclose_objects(objects: Iterable[Any], name: str, place: Array) -> list[Capsule]:
    """Return the capsules that enclose boxes, spheres and capsules."""
    expected = "a list of boxes (T, edges), spheres (centre, radius) or capsules (a, b, radius)"
    if isinstance(objects, str) or not isinstance(objects, Iterable):
        raise InvalidInput(f"{name}.shapes", format_value(objects), expected)
    found: list[Capsule] = []
    for i, one in enumerate(objects):
        where = f"{name}.shapes[{i}]"
        if not isinstance(one, list | tuple) or len(one) not in (2, 3):
            raise InvalidInput(where, format_value(one), expected)
        if len(one) == 2 and np.ndim(one[1]) == 1:
            found += _box(one[0], one[1], where)
        else:
            ends = [check_point(end, where, LONGEST_LINK) for end in one[:-1]]
            found.append(Capsule(ends[0], ends[-1], check_length(one[-1], f"{where}: radius", LONGEST_LINK), 0.0))
    if not found:
        raise InvalidInput(f"{name}.shapes", "none", expected)
    return [c.transform(place) for c in found]


def _box(pose: Any, edges: Any, where: str) -> list[Capsule]:
    lengths = check_point(edges, f"{where}: edges", LONGEST_LINK)
    if (lengths <= 0.0).any():
        raise InvalidInput(f"{where}: edges", format_value(edges), "three full edge lengths above 0")
    T = se3.check_pose(pose, f"{where}: T")
    return [c.transform(T) for c in enclose_mesh(box_triangles(lengths))]
