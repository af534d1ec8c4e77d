"""Reader of the table ``shapes`` in a robot's TOML file: capsules in the file's frames, in millimetres."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from optik.arm.plain import read_record, read_word
from optik.arm.shapes.check import LONGEST_LINK
from optik.arm.shapes.model import Shapes
from optik.check import check_count, check_number
from optik.errors import InvalidInput
from optik.types import Array

CAPSULE_KEYS = ("a_mm", "b_mm", "centre_mm", "excess_mm", "name")
"""Keys of a capsule's row besides its link and radius."""


def shapes_from_toml(table: Any, source: str, joint_names: Sequence[str]) -> Shapes:
    """Read the table ``shapes`` of a robot's TOML file."""
    read_record(table, ("capsules",), "shapes", optional=("apart", "source"))
    links = {"base": 0} | {name: i + 1 for i, name in enumerate(joint_names)}
    rows = _rows(table["capsules"], "shapes.capsules")
    for i, row in enumerate(rows):
        read_record(row, ("link", "radius_mm"), f"shapes.capsules[{i}]", optional=CAPSULE_KEYS)
    capsules = [_capsule(row, f"shapes.capsules[{i}]", links) for i, row in enumerate(rows)]
    named = [read_word(row.get("name", ""), f"shapes.capsules[{i}].name") for i, row in enumerate(rows)]
    of_link = {number: name for name, number in links.items()}
    names = tuple(name or of_link.get(row[0], str(row[0])) for name, row in zip(named, capsules, strict=True))
    apart = tuple(
        _apart(row, f"shapes.apart[{i}]", links, names)
        for i, row in enumerate(_rows(table.get("apart", []), "shapes.apart"))
    )
    excess = [_length(row["excess_mm"], "shapes.capsules: excess_mm") if "excess_mm" in row else np.nan for row in rows]
    return Shapes(capsules, names, apart, np.array(excess), read_word(table.get("source", source), "shapes.source"))  # type: ignore[arg-type]


def _capsule(row: Mapping[str, Any], where: str, links: Mapping[str, int]) -> tuple[int, Array, Array, float]:
    """Read the link, ends and radius of a row."""
    ends = ("centre_mm", "centre_mm") if "centre_mm" in row else ("a_mm", "b_mm")
    if not set(ends) <= set(row) or ("centre_mm" in row and {"a_mm", "b_mm"} & set(row)):
        raise InvalidInput(where, ", ".join(row), "a_mm and b_mm of a capsule, or centre_mm of a sphere")
    a, b = (_point(row[key], f"{where}.{key}") for key in ends)
    link = row["link"]
    number = links.get(link, link) if isinstance(link, str) else link
    if isinstance(number, str):
        raise InvalidInput(f"{where}.link", repr(link)[:60], f"the number of a link, or {', '.join(links)}")
    check_count(number, f"{where}.link", 0, len(links) - 1)
    return number, a, b, _length(row["radius_mm"], f"{where}.radius_mm")


def _apart(row: Any, where: str, links: Mapping[str, int], names: Sequence[str]) -> tuple[str | int, str | int, str]:
    """Read two parts that are not checked, and the reason."""
    read_record(row, ("links", "reason"), where)
    pair = row["links"]
    if not isinstance(pair, list) or len(pair) != 2:
        raise InvalidInput(f"{where}.links", repr(pair)[:60], "two links")
    # A name of capsules means these capsules; else the name of a link means all capsules of the link.
    one, other = (part if part in names else links.get(part, part) if isinstance(part, str) else part for part in pair)
    return one, other, read_word(row["reason"], f"{where}.reason")


def _rows(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise InvalidInput(where, repr(value)[:60], "a list of rows")
    return value


def _point(value: Any, where: str) -> Array:
    """Read a point (3,) [m] from a list in millimetres."""
    expected = f"three numbers within {LONGEST_LINK * 1000:g} mm"
    if not isinstance(value, list) or len(value) != 3:
        raise InvalidInput(where, repr(value)[:60], expected)
    return np.array([check_number(x, where, expected) for x in value]) / 1000.0


def _length(value: Any, where: str) -> float:
    return check_number(value, where, "a length ≥ 0 in millimetres", least=0.0) / 1000.0
