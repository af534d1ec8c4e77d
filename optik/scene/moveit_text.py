"""Reader of MoveIt's text format of scenes (``.scene``), both versions, as `moveit_msgs/PlanningScene`.

The first line is a name. An object is `* ID`, its pose (newer version), the number of its shapes, each shape with its pose and
colour, and its subframes (newer version). A shape is a line with its type and a line of numbers. The last line is a point.
"""

from __future__ import annotations

import io
from typing import Any

from optik.errors import InvalidInput

OBJECT_PARTS = (("primitives", "primitive_poses"), ("planes", "plane_poses"), ("meshes", "mesh_poses"))
"""Keys of the parts of an object, and of their poses."""


def message_from_text(text: str) -> dict[str, Any]:
    """Return the planning scene of a text as a message."""
    lines, objects = enumerate(io.StringIO(text), start=1), []
    number, line = next(lines, (0, ""))

    def take() -> list[str]:
        nonlocal number, line
        number, line = next((number, line) for number, line in lines if line.strip())
        return line.split()

    def add_shape(one: dict[str, Any]) -> None:
        (kind,), values = take(), take()
        sizes = values[::-1] if kind == "cylinder" else values  # radius and length
        shape: dict[str, Any] = {"type": kind, "dimensions": sizes, "coef": values}
        if kind == "mesh":
            corners, triangles = map(int, values)
            shape = {"vertices": [take() for _ in range(corners)]}
            shape["triangles"] = [{"vertex_indices": [int(word) for word in take()]} for _ in range(triangles)]
        shapes, poses = {"plane": OBJECT_PARTS[1], "mesh": OBJECT_PARTS[2]}.get(kind, OBJECT_PARTS[0])
        one.setdefault(shapes, []).append(shape)
        one.setdefault(poses, []).append({"position": take(), "orientation": take()})
        take()  # its colour

    try:
        while take() != ["."]:
            one: dict[str, Any] = {"id": line[line.index("*") + 1 :].strip()}
            newer = len(words := take()) > 1
            if newer:
                one["pose"], words = {"position": words, "orientation": take()}, take()
            for _ in range(int(*words)):
                add_shape(one)
            for _ in range(3 * int(*take()) if newer else 0):  # name, position and orientation of each subframe
                take()
            objects.append(one)
    except (StopIteration, ValueError, TypeError):
        got = repr(line.strip())[:60]
        raise InvalidInput(f"line {number}", got, "a complete scene in MoveIt's text format") from None
    return {"world": {"collision_objects": objects}}
