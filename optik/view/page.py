"""A motion as one HTML page that plays it in any browser, of at most 2 MB, without requests to a network, and its data."""

from __future__ import annotations

import base64
import json
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.model import unit_factors, unit_names
from optik.arm.robot import Robot
from optik.card import Card
from optik.dynamics import joint_torques
from optik.errors import InvalidInput
from optik.file_io import check_suffix, write_atomically
from optik.scene import Scene
from optik.scene.contact import BOX, CLOUD, CYLINDER, MESH, PLANE, ROUND, SELF, find_clearances, find_pairs
from optik.scene.distance import find_hull
from optik.types import Array
from optik.view.show import Show, Track, thin

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup


# ---------------- the data that the scripts of a page draw


MOST_OBJECTS_DRAWN = 2000
"""Largest number of drawn objects of a scene, the nearest to the path: a phone still turns them smoothly."""
MOST_NUMBERS = 60_000
"""Largest number of 64-bit values of a motion: with base64, two motions take 1.3 MB of the page. All instants of arms with up
to 9 joints fit."""
FINEST = 32_767
"""Largest integer of 16 bits: values of plots have this many steps on either side of 0, which is finer than a screen."""
PLOTS = {
    "q": ("Position", ""),
    "dq": ("Velocity", "/s"),
    "ddq": ("Acceleration", "/s²"),
    "jerk": ("Jerk", "/s³"),
    "torque": ("Torque", ""),
    "clearance": ("Clearance", ""),
}
"""Quantities of a motion that a page plots: title, and suffix of a joint's unit."""
SHAPE_KINDS = {BOX: "boxes", ROUND: "rounds", PLANE: "planes", SELF: "own", CYLINDER: "cylinders", MESH: "meshes"}
SHAPE_KINDS[CLOUD] = "clouds"
"""Kinds of the second shape of a pair, as the scripts name them."""

Facts = tuple[tuple[str, str], ...]
"""Rows of a table: names and texts."""


def describe_show(show: Show) -> tuple[dict[str, Any], Facts]:
    """Return the data of a page, and a row of facts if not all of the scene is drawn."""
    data, drawn, facts = describe_surroundings(show.robot, show.path, show.scene)
    pairs = NearestPairs(show, drawn)
    data |= {"executed": None, "limits": _describe_limits(show)}
    for name, track in (("planned", show.planned), ("executed", show.executed)):
        if track is not None:
            track = thin(track, max(2, MOST_NUMBERS // (2 + 3 * show.robot.n)))
            data[name] = describe_track(track) | _describe_load(show.robot, track) | pairs.describe(track.q)
    beam = None if show.beam is None else [point.tolist() for point in show.beam]
    before = None if show.before is None else _numbers(show.before)
    zones, events = [_numbers(zone) for zone in show.zones], None if show.events is None else _numbers(show.events)
    return data | {
        "clearance": pairs.to_dict(),
        "beam": beam,
        "before": before,
        "zones": zones,
        "events": events,
    }, facts


def list_plots(robot: Robot, data: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Return the name, title and unit of every quantity of the motions in a page's data."""
    joints = sorted({unit.strip() for unit in unit_names(robot)}, reverse=True)
    units = {
        "torque": sorted({"N" if slides else "N·m" for slides in robot.prismatic}, reverse=True),
        "clearance": ["mm"],
    }
    known = {*data["planned"], *(data["executed"] or ())}
    return [
        (name, title, ", ".join(f"{unit}{suffix}" for unit in units.get(name, joints)))
        for name, (title, suffix) in PLOTS.items()
        if name in known
    ]


# ---------------------------------------------------------------- arm and scene


def describe_surroundings(
    robot: Robot, path: Array, scene: Scene | None
) -> tuple[dict[str, Any], dict[str, list[int]], Facts]:
    """Return the data of arm, path and scene; the indices of the drawn objects; and a row of facts if some are left out."""
    shapes, load = robot.shapes, robot.payload
    drawn, objects, facts = _describe_scene(path, scene or Scene())
    data = {
        "arm": _describe_arm(robot),
        "up": find_up(robot).tolist(),
        "capsules": None if shapes is None else _numbers(np.column_stack(shapes.capsules)),
        "payload": None if load is None else {"com": load.com.tolist(), "words": f"payload {load}"},
        "path": _numbers(path),
        "scene": objects,
    }
    return data, drawn, facts


def _describe_arm(robot: Robot) -> dict[str, Any]:
    (fixed, slides, tool), follow = robot.axes.chain, robot.linkage
    return {
        "joints": list(robot.joint_names),
        "fixed": _numbers(fixed),
        "prismatic": robot.prismatic.tolist(),
        "slides": slides.tolist(),
        "follow": None if follow is None else [follow.joint.tolist(), follow.factor.tolist(), follow.offset.tolist()],
        "tool": _numbers(tool),
        "per": unit_factors(robot).tolist(),
        "units": unit_names(robot),
    }


def find_up(robot: Robot) -> Array:
    """Return the direction opposite to gravity, which a viewer shows upwards."""
    return np.asarray(-robot.gravity / np.linalg.norm(robot.gravity), dtype=np.float64)


def _describe_scene(path: Array, scene: Scene) -> tuple[dict[str, list[int]], dict[str, Any], Facts]:
    """Return the indices of the drawn objects of each kind but planes, the objects, and a row of facts if some are left out."""
    points = [(p, p, r) for cloud, r in scene.clouds for p in find_near_points(path, cloud)]
    far = sum(len(cloud) for cloud, _ in scene.clouds) - len(points)
    ends = [(c, c, r) for c, r in scene.spheres] + list(scene.capsules) + points
    rows = {
        "boxes": [np.append(T, edges) for T, edges in scene.boxes],
        "rounds": [np.concatenate((a, b, [r])) for a, b, r in ends],
        "planes": [np.concatenate(plane) for plane in scene.planes],
        "cylinders": [np.concatenate((a, b, [r])) for a, b, r in scene.cylinders],
    }
    hulls = [find_hull(corners) for corners in scene.meshes]
    balls = [(T[:3, 3], np.linalg.norm(edges) / 2) for T, edges in scene.boxes]
    balls += [((a + b) / 2, r + np.linalg.norm(b - a) / 2) for a, b, r in (*ends, *scene.cylinders)]
    balls += [(row[6:9], row[9]) for row in scene.arrays[6][::-1][: len(scene.meshes)]]
    facts: Facts = ()
    chosen = np.arange(len(balls))
    if len(balls) + far > MOST_OBJECTS_DRAWN:
        distances = [_distance(path, middle) - radius for middle, radius in balls]
        chosen = np.sort(np.argsort(distances)[:MOST_OBJECTS_DRAWN])
        facts = (("Drawn scene", f"the {MOST_OBJECTS_DRAWN} objects nearest to the path, of {len(balls) + far}"),)
    drawn, first = {}, 0
    for name in ("boxes", "rounds", "cylinders", "meshes"):  # in the order of `balls`
        last = first + len(rows.get(name, hulls))
        drawn[name] = (chosen[(chosen >= first) & (chosen < last)] - first).tolist()
        first = last
    objects: dict[str, Any] = {
        name: _numbers([row for i, row in enumerate(values) if i in set(drawn.get(name, range(len(values))))])
        for name, values in rows.items()
    }
    chosen_hulls = [hulls[i] for i in drawn["meshes"]]
    objects["meshes"] = [
        {"faces": _numbers(h.triangles), "edges": _numbers(h.edges[:, [0, 1, 2, 9, 10, 11]])} for h in chosen_hulls
    ]
    return drawn, objects, facts


def find_near_points(path: Array, points: Array) -> Array:
    """Return the points of a cloud that may be drawn, the nearest to the path."""
    distance = np.full(len(points), np.inf)
    for p in path:
        distance = np.fmin(distance, np.linalg.norm(points - p, axis=1))
    return points[np.sort(np.argsort(distance, kind="stable")[:MOST_OBJECTS_DRAWN])]


def _distance(path: Array, point: Array) -> float:
    """Return the distance of a point from the nearest drawn point of the path [m]."""
    return float(np.nanmin(np.linalg.norm(path - point, axis=1), initial=np.inf))


# ---------------------------------------------------------------- motions


def describe_track(track: Track) -> dict[str, Any]:
    """Return the times, positions and velocities of a motion."""
    return {name: _numbers(values) for name, values in track._asdict().items() if name in ("t", "q", "dq")}


def _describe_load(robot: Robot, track: Track) -> dict[str, Any]:
    """Return the accelerations and torques of a motion; without those that are unknown."""
    known = {"ddq": track.ddq, "jerk": track.jerk, "torque": find_torques(robot, track)}
    return {name: _pack(values) for name, values in known.items() if values is not None}


def find_torques(robot: Robot, track: Track) -> Array | None:
    """Return the measured torques of a motion, or those of the load that needs more; None if they are unknown."""
    if track.torque is not None or track.ddq is None or robot.inertia is None:
        return track.torque
    found = np.empty((len(robot.loads), *track.q.shape))
    for load, out in zip(robot.loads, found, strict=True):
        friction = (load.viscous, load.coulomb)
        joint_torques(robot.chain, load.bodies, friction, np.stack([track.q, track.dq, track.ddq], axis=1), out)
    return np.asarray(np.take_along_axis(found, np.abs(found).argmax(axis=0)[None], axis=0)[0])


def _describe_limits(show: Show) -> dict[str, list[list[float | None]]]:
    """Return the lower and the upper limits of each quantity; None for a joint without a limit."""
    pairs = {"q": (show.robot.limits.lower, show.robot.limits.upper), **show.limits}
    return {
        name: [[x if np.isfinite(x) else None for x in side.tolist()] for side in pair] for name, pair in pairs.items()
    }


class NearestPairs:
    """The nearest pairs of shapes of arm and scene, and of the arm's own links, at the instants of motions."""

    def __init__(self, show: Show, drawn: dict[str, list[int]]) -> None:
        self._show, self._drawn = show, drawn
        self._kinds: list[tuple[str, float, int]] = []
        self._numbers: dict[int, int] = {}
        if show.scene is not None and show.robot.shapes is not None:
            own = find_pairs(show.robot, show.scene).bodies[:, 2] == SELF
            kinds = (("to the scene", show.scene.margin, ~own), ("between links", 0.0, own))
            self._kinds = [(name, least, i) for i, (name, least, of) in enumerate(kinds) if of.any()]

    def describe(self, q: Array) -> dict[str, Any]:
        """Return the least distances at configurations (k, n), and the instants from which another pair is the nearest."""
        if not self._kinds:
            return {}
        assert self._show.scene is not None
        columns = [i for *_, i in self._kinds]
        distances, pairs = find_clearances(self._show.robot, self._show.scene, q)
        nearest = [
            [[k, self._number(int(which[k]))] for k in np.flatnonzero(np.diff(which, prepend=-1)).tolist()]
            for which in pairs[:, columns].T
        ]
        return {"clearance": _pack(distances[:, columns]), "nearest": nearest}

    def _number(self, pair: int) -> int:
        """Return the number of a pair among those of the page."""
        return self._numbers.setdefault(pair, len(self._numbers))

    def to_dict(self) -> dict[str, Any] | None:
        """Return the kinds of pairs with their required distances, and the pairs; None if nothing is checked."""
        if not self._kinds:
            return None
        robot, scene = self._show.robot, self._show.scene
        assert scene is not None
        found, pairs = find_pairs(robot, scene), []
        for pair in self._numbers:
            capsule, number, kind = found.bodies[pair].tolist()
            drawn = self._drawn.get(SHAPE_KINDS[kind])
            place = number if drawn is None else drawn.index(number) if number in drawn else None
            pairs.append({"names": found.names[pair], "capsule": capsule, "kind": SHAPE_KINDS[kind], "object": place})
        kinds, least = [name for name, *_ in self._kinds], [least for _, least, _ in self._kinds]
        return {"kinds": kinds, "least": least, "pairs": pairs}


# ---------------------------------------------------------------- numbers


def _numbers(values: ArrayLike) -> str:
    """Return an array for the scripts: base64 of 64-bit floats."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode()


def _pack(values: Array) -> dict[str, Any]:
    """Return rows of values of plots: base64 of 16-bit integers, and the unit of each column."""
    most = np.abs(values).max(axis=0)
    scale = np.where(most > 0.0, most, 1.0) / FINEST
    return {
        "scale": scale.tolist(),
        "values": base64.b64encode(np.round(values / scale).astype("<i2").tobytes()).decode(),
    }


# ---------------- a motion as one HTML page that plays it in any browser


PLAYER = ("arm.js", "draw.js", "picture.js", "player.js")
"""Scripts that draw and play an arm, in order; each uses the previous ones."""
PAGE_SUFFIXES = (".html", ".htm")
"""Suffixes of page files, which a browser opens."""
MOST_PAGE = 2_000_000
"""Largest page [bytes]: it can be mailed, and a browser reads it at once."""


class EmbeddedArm(NamedTuple):
    """Parts of another page: a script, once, that defines ``optikArm``, and the data for ``optikArm(element, data)``."""

    script: str
    data: str


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
    page = make_page(show)
    if len(page.encode()) > MOST_PAGE:
        got = f"a page of {len(page.encode()) / 1e6:.1f} MB"
        raise InvalidInput("show", got, f"at most {MOST_PAGE / 1e6:.0f} MB: a shorter path or fewer facts")
    Page(page).save(file)


@dataclass(frozen=True)
class Page:
    """A page; in the cell of a notebook it shows itself.

    Attributes
    ----------
    html : str
        Its content.
    """

    html: str

    def __repr__(self) -> str:
        return f"Page({len(self.html) / 1e3:.0f} kB)"

    def _repr_html_(self) -> str:
        """Return the page as a frame of a notebook's cell."""
        from markupsafe import escape

        style = "width: 100%; height: 460px; border: 1px solid #8884"
        return f'<iframe style="{style}" srcdoc="{escape(self.html)}"></iframe>'

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the page; after an error there is no partial file.

        Parameters
        ----------
        file : str or path
            A file with the suffix .html or .htm.

        Raises
        ------
        InvalidInput
            Another suffix.
        OutputError
            The file cannot be written.
        """
        check_suffix(file, PAGE_SUFFIXES)
        write_atomically(file, lambda part: part.write_bytes(self.html.encode()))


def show_page(show: Show) -> Page:
    """Return the page of a viewer, which a notebook shows; elsewhere open it in the browser."""
    page = Page(make_page(show))
    if not in_notebook():
        import webbrowser

        file = Path(mkdtemp(prefix="optik-")) / "view.html"
        page.save(file)
        webbrowser.open(file.as_uri())
    return page


def in_notebook() -> bool:
    """Return whether a kernel of Jupyter runs this process."""
    shell = sys.modules.get("IPython")
    return shell is not None and getattr(shell.get_ipython(), "kernel", None) is not None


def show_arm(robot: Robot, q: ArrayLike, scene: Scene | None = None) -> Page:
    """Show an arm at rest: in the cell of a notebook, else in the browser. `Robot.show` calls it.

    Parameters
    ----------
    robot : Robot
        The arm.
    q : (n,) array
        Its configuration [rad, m].
    scene : Scene, optional
        Obstacles around it.

    Returns
    -------
    Page
        The page; ``save(file)`` writes it.

    Raises
    ------
    InvalidInput
        A configuration of another length, NaN or infinity.
    """
    return show_page(make_arm_show(robot, q, scene))


def make_arm_show(robot: Robot, q: ArrayLike, scene: Scene | None = None) -> Show:
    """Return the content of a viewer for an arm at rest."""
    if not isinstance(scene, Scene | None):
        raise InvalidInput("scene", repr(scene)[:60], "a Scene")
    tool = robot.fk(q)[:3, 3]
    rest = np.asarray(q, dtype=np.float64)[None]
    return Show(robot, robot.name, Track(np.zeros(1), rest, np.zeros_like(rest)), tool[None], scene=scene)


def make_page(show: Show) -> str:
    """Return the page."""
    from markupsafe import Markup

    import optik

    data, facts = describe_show(show)
    legend = {"path": "path", "executed": "executed", "planned": "planned arm", "beam": "laser beam", "scene": "scene"}
    legend |= {"payload": "centre of the payload", "near": "nearest pair", "before": "initial path"}
    legend |= {"zone": "rounded corners", "event": "events"}
    there: dict[str, Any] = {"executed": show.executed, "planned": show.executed, "beam": show.beam}
    there |= {"path": len(show.path) > 1, "scene": show.scene, "payload": data["payload"]}
    there |= {"near": data["clearance"], "before": data["before"], "zone": data["zones"], "event": data["events"]}
    return _template("page.html.j2").render(
        show=show,
        bars=Markup(Card(title="", bars=show.bars).to_html()),
        robot=show.robot,
        embedded=False,
        facts=(*show.facts, *facts),
        legend=[(name, words) for name, words in legend.items() if there[name]],
        plots=list_plots(show.robot, data),
        version=optik.__version__,
        style=_asset("player.css") + _asset("page.css"),
        script=_assets(*PLAYER, "plots.js", "page.js"),
        data=_script(data),
    )


def embed_arm(robot: Robot, motions: Mapping[str, Track], path: Array, scene: Scene | None = None) -> EmbeddedArm:
    """Return the data for playing an arm in another page: one of the motions by name, and on request a second one."""
    data, _, _ = describe_surroundings(robot, path, scene)
    data["motions"] = {name: describe_track(track) for name, track in motions.items()}
    legend = [("path", "path"), ("executed", "compared motion")] + ([("scene", "scene")] if scene else [])
    player = _template("player.html.j2").render(embedded=True, robot=robot, legend=legend)
    html = _script(f"<style>{_asset('player.css')}</style>{player}")
    script = f"const optikArm = (() => {{\n{_assets(*PLAYER)}\nconst HTML = {html};\n{_asset('embed.js')}}})();"
    return EmbeddedArm(script, str(_script(data)))


def _template(name: str) -> Template:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, loader=PackageLoader("optik", "view"),
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    return environment.get_template(name)


def _asset(name: str) -> Markup:
    """Return the text of a file beside this one."""
    from markupsafe import Markup

    return Markup(files("optik").joinpath("view", name).read_text(encoding="utf-8"))


def _assets(*names: str) -> Markup:
    """Return the texts of several files as one."""
    from markupsafe import Markup

    return Markup("").join(map(_asset, names))


def _script(data: Any) -> Markup:
    """Return JSON for a page's script; no text in it can end the script."""
    from markupsafe import Markup

    text = json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c"))
