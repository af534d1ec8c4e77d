"""A motion as one HTML page that plays it in any browser, of at most 2 MB, without requests to a network."""

from __future__ import annotations

import json
import os
import sys
import webbrowser
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.card import Card
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
    if not isinstance(scene, Scene | None):
        raise InvalidInput("scene", repr(scene)[:60], "a Scene")
    tool = robot.fk(q)[:3, 3]
    rest = np.asarray(q, dtype=np.float64)[None]
    return show_page(Show(robot, robot.name, Track(np.zeros(1), rest, np.zeros_like(rest)), tool[None], scene=scene))


def make_page(show: Show) -> str:
    """Return the page."""
    from markupsafe import Markup

    import optik

    data, facts = describe_show(show)
    legend = {"path": "path", "executed": "executed", "planned": "planned arm", "beam": "laser beam", "scene": "scene"}
    legend |= {"payload": "centre of the payload", "near": "nearest pair", "before": "initial path"}
    legend |= {"zone": "rounded corners", "event": "events"}
    there = {"path": True, "executed": show.executed, "planned": show.executed, "beam": show.beam, "scene": show.scene}
    there |= {"payload": data["payload"], "near": data["clearance"], "before": data["before"]}
    there |= {"zone": data["zones"], "event": data["events"]}
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
