"""A motion as one HTML page that plays it in any browser, of at most 2 MB, without requests to a network."""

from __future__ import annotations

import base64
import json
import os
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.arm.units import unit_factors, unit_names
from optik.errors import InvalidInput
from optik.file_io import check_suffix, write_atomically
from optik.scene import Scene
from optik.types import Array
from planners.cell.view.show import Show, Track

if TYPE_CHECKING:
    from markupsafe import Markup

SCRIPTS = ("arm.js", "draw.js", "picture.js", "page.js")
"""Scripts of the page in order; each uses the previous ones."""
PAGE_SUFFIXES = (".html", ".htm")
"""Suffixes of page files, which a browser opens."""
MOST_PAGE = 2_000_000
"""Largest page [bytes]: it can be mailed, and a browser reads it at once."""
MOST_OBJECTS_DRAWN = 2000
"""Largest number of drawn objects of a scene, the nearest to the path: a phone still turns them smoothly."""
MOST_NUMBERS = 60_000
"""Largest number of values of a motion: with base64 of 64-bit floats, two motions take 1.3 MB of the page. All instants of arms
with up to 14 joints fit."""


def write_page(show: Show, file: str | os.PathLike[str]) -> None:
    """Write the page of a motion; after an error there is no partial file.

    Parameters
    ----------
    show : Show
        The content, for example of `show_motion`.
    file : str or path
        A file with the suffix .html or .htm.

    Raises
    ------
    InvalidInput
        Another suffix, or more than fits in 2 MB.
    OutputError
        The file cannot be written.
    """
    check_suffix(file, PAGE_SUFFIXES)
    content = make_page(show).encode()
    if len(content) > MOST_PAGE:
        got = f"a page of {len(content) / 1e6:.1f} MB"
        raise InvalidInput("show", got, f"at most {MOST_PAGE / 1e6:.0f} MB: a shorter path or fewer facts")
    write_atomically(file, lambda part: part.write_bytes(content))


def make_page(show: Show) -> str:
    """Return the page."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    import optik

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, loader=PackageLoader("planners.cell", "view"),
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    kinds = sorted({unit.strip() for unit in unit_names(show.robot)}, reverse=True)
    scene, facts = _scene(show)
    return environment.get_template("page.html.j2").render(
        show=show,
        facts=(*show.facts, *facts),
        unit=", ".join(kinds),
        rate=", ".join(f"{kind}/s" for kind in kinds),
        version=optik.__version__,
        style=_asset("page.css"),
        scripts=[_asset(name) for name in SCRIPTS],
        data=_script(_data(show, scene)),
    )


def _asset(name: str) -> Markup:
    """Return the text of a file beside this one."""
    from markupsafe import Markup

    return Markup(files("planners.cell").joinpath("view", name).read_text(encoding="utf-8"))


def _script(data: Any) -> Markup:
    """Return JSON for a page's script; no text in it can end the script."""
    from markupsafe import Markup

    text = json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c"))


def _numbers(values: ArrayLike) -> str:
    """Return an array for the script: base64 of 64-bit floats."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode()


# ---------------------------------------------------------------- what the script reads


def _data(show: Show, scene: dict[str, str]) -> dict[str, Any]:
    """Return the data that the script draws."""
    shapes = show.robot.shapes
    return {
        "arm": _describe_arm(show.robot),
        "up": find_up(show.robot).tolist(),
        "capsules": None if shapes is None else _numbers(np.column_stack(shapes.capsules)),
        "planned": _track(show.planned),
        "executed": None if show.executed is None else _track(show.executed),
        "path": _numbers(show.path),
        "scene": scene,
        "beam": None if show.beam is None else [point.tolist() for point in show.beam],
    }


def _describe_arm(robot: Robot) -> dict[str, Any]:
    fixed, prismatic, tool = robot.chain
    return {
        "joints": list(robot.joint_names),
        "fixed": _numbers(fixed),
        "prismatic": [bool(slides) for slides in prismatic],
        "tool": _numbers(tool),
        "per": unit_factors(robot).tolist(),
        "units": unit_names(robot),
    }


def find_up(robot: Robot) -> Array:
    """Return the direction against gravity, in which a viewer stands upright."""
    return np.asarray(-robot.gravity / np.linalg.norm(robot.gravity), dtype=np.float64)


def _track(track: Track) -> dict[str, str]:
    """Return a motion for the script, thinned out if it has too many numbers."""
    most = max(2, MOST_NUMBERS // (1 + 2 * track.q.shape[1]))
    kept = np.unique(np.linspace(0, len(track.t) - 1, min(len(track.t), most)).round().astype(np.int64))
    return {name: _numbers(values[kept]) for name, values in track._asdict().items()}


def _scene(show: Show) -> tuple[dict[str, str], tuple[tuple[str, str], ...]]:
    """Return the scene for the script, and a row of facts if not all of it is drawn."""
    scene = show.scene or Scene()
    boxes = [(np.linalg.norm(edges) / 2, T[:3, 3], np.append(T, edges)) for T, edges in scene.boxes]
    ends = [(c, c, r) for c, r in scene.spheres] + list(scene.capsules)
    rounds = [(r + np.linalg.norm(b - a) / 2, (a + b) / 2, np.concatenate((a, b, [r]))) for a, b, r in ends]
    planes = [np.concatenate(plane) for plane in scene.planes]
    count = len(boxes) + len(rounds)
    facts: tuple[tuple[str, str], ...] = ()
    if count > MOST_OBJECTS_DRAWN:
        distances = [_distance(show.path, middle) - radius for radius, middle, _ in (*boxes, *rounds)]
        near = set(np.argsort(distances)[:MOST_OBJECTS_DRAWN].tolist())
        boxes, rounds = (
            [one for i, one in enumerate(boxes) if i in near],
            [one for i, one in enumerate(rounds, len(boxes)) if i in near],
        )
        facts = (("Drawn scene", f"the {MOST_OBJECTS_DRAWN} objects nearest to the path, of {count}"),)
    arrays = {
        "boxes": np.reshape([row for *_, row in boxes], (-1, 19)),
        "rounds": np.reshape([row for *_, row in rounds], (-1, 7)),
        "planes": np.reshape(planes, (-1, 6)),
    }
    return {name: _numbers(values) for name, values in arrays.items()}, facts


def _distance(path: Array, point: Array) -> float:
    """Return the distance of a point from the nearest drawn point of the path [m]."""
    return float(np.nanmin(np.linalg.norm(path - point, axis=1), initial=np.inf))
