"""Reader of the disabled pairs of links in an SRDF."""

from __future__ import annotations

import os

from optik.arm.urdf_tree import read_xml
from optik.errors import InvalidInput


def read_disabled_pairs(source: str | os.PathLike[str]) -> list[tuple[str, str, str]]:
    """Read the pairs of links in the <disable_collisions> elements of an SRDF, with the reasons."""
    try:
        root = read_xml(source)
    except InvalidInput as error:
        raise InvalidInput("srdf", error.got, error.expected.replace("URDF", "SRDF")) from None
    if root.tag != "robot":
        raise InvalidInput("srdf", f"the element <{str(root.tag)[:60]}>", "an SRDF, whose outermost element is <robot>")
    pairs = []
    for element in root.iter("disable_collisions"):
        one, other = element.get("link1"), element.get("link2")
        if not one or not other:
            raise InvalidInput("srdf", "a <disable_collisions> without link1 or link2", "two links")
        pairs.append((one, other, element.get("reason") or "disabled in the SRDF"))
    return pairs
