"""A motion as one HTML page that plays it in any browser, of at most 2 MB, without requests to a network."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NamedTuple

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.file_io import check_suffix, write_atomically
from optik.scene import Scene
from optik.types import Array
from optik.view.data import describe_show, describe_surroundings, describe_track, list_plots
from optik.view.show import Show, Track

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup

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
    content = make_page(show).encode()
    if len(content) > MOST_PAGE:
        got = f"a page of {len(content) / 1e6:.1f} MB"
        raise InvalidInput("show", got, f"at most {MOST_PAGE / 1e6:.0f} MB: a shorter path or fewer facts")
    write_atomically(file, lambda part: part.write_bytes(content))


def make_page(show: Show) -> str:
    """Return the page."""
    import optik

    data, facts = describe_show(show)
    legend = {"path": "path", "executed": "executed", "planned": "planned arm", "beam": "laser beam", "scene": "scene"}
    legend |= {"payload": "centre of the payload", "near": "nearest pair", "before": "initial path"}
    there = {"path": True, "executed": show.executed, "planned": show.executed, "beam": show.beam, "scene": show.scene}
    there |= {"payload": data["payload"], "near": data["clearance"], "before": data["before"]}
    return _template("page.html.j2").render(
        show=show,
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
