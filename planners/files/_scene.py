"""A scene as the plain data of motion files."""

from __future__ import annotations

from typing import Any

from optik.arm.plain import numbers, record
from optik.check import check_words
from optik.errors import InvalidInput
from optik.scene import OBJECT_KINDS, Scene


def scene_to_plain(scene: Scene) -> dict[str, Any]:
    """Return a scene as plain data that JSON can hold.

    Parameters
    ----------
    scene : Scene
        The scene.

    Returns
    -------
    dict
        Its objects by kind, ``allow`` and ``names``.
    """
    objects = {kind: [[_plain(part) for part in one] for one in getattr(scene, kind)] for kind in OBJECT_KINDS}
    return objects | {"allow": [list(pair) for pair in scene.allow], "names": list(scene.names)}


def scene_from_plain(data: Any) -> Scene:
    """Return the scene that `scene_to_plain` wrote, equal to the last bit.

    Parameters
    ----------
    data : dict
        What was read from a file.

    Returns
    -------
    Scene
        The scene.

    Raises
    ------
    InvalidInput
        Missing or unknown keys, or values that `Scene` refuses.
    UnknownName
        An unknown object in ``allow``.
    """
    data = record(data, (*OBJECT_KINDS, "allow", "names"), "scene")
    objects = {
        kind: [tuple(_parsed(part, kind) for part in one) for one in _rows(data[kind], kind)] for kind in OBJECT_KINDS
    }
    allow = tuple(tuple(check_words(pair, "scene.allow")) for pair in _rows(data["allow"], "allow"))
    return Scene(**objects, allow=allow, names=tuple(check_words(data["names"], "scene.names")))  # type: ignore[arg-type]


def _plain(part: Any) -> Any:
    return part.tolist() if hasattr(part, "tolist") else float(part)


def _rows(value: Any, key: str) -> list[list[Any]]:
    if not isinstance(value, list) or not all(isinstance(row, list) for row in value):
        raise InvalidInput(f"scene.{key}", repr(value)[:60], "a list of lists")
    return value


def _parsed(part: Any, kind: str) -> Any:
    """A pose, a point or a length, of finite numbers."""
    if not isinstance(part, list):
        return float(numbers(part, (), f"scene.{kind}"))
    shape = (4, 4) if part and isinstance(part[0], list) else (3,)
    return numbers(part, shape, f"scene.{kind}")
