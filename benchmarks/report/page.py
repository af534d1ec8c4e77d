"""The report as one self-contained HTML page."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from benchmarks.records import RunFolder
from benchmarks.report.base import Run, Section
from benchmarks.report.boards import packed, squeeze, strict
from benchmarks.report.figures import THEME, template, variable
from benchmarks.report.numbers import number, percent
from benchmarks.report.sections import built
from benchmarks.report.tables import shown_rows
from benchmarks.report.winners import overview
from optik.plugins.files import forbid_code

PAGE = "report.html"
"""Name of the page in the run folder."""


@forbid_code()
def write_report(folder: RunFolder) -> Path:
    """Write ``report.html`` into a run folder: one file that opens offline."""
    folder.write_text(PAGE, render(Run(folder)))
    return folder.path / PAGE


def render(run: Run) -> str:
    """Return the page as text."""
    environment = Environment(
        loader=PackageLoader("benchmarks.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"number": number, "percent": percent, "strict": strict, "variable": variable}
    environment.filters["shown"] = shown_rows
    environment.filters["dot"] = lambda label: variable(run.colour(label)) if label in run.labels else ""
    environment.filters["packed"] = lambda board: packed(board, run.labels)
    placed = {place: built(run, place) for place in ("top", "terms", "summary", "section")}
    return environment.get_template("page.html.j2").render(
        head=overview(run),
        **placed,
        template_of=lambda piece: _template(environment, piece),
        style=_asset("page.css"),
        script=_asset("page.js"),
        plotly=_plotly(),
        look={"template": template().to_plotly_json(), "variables": {value: name for name, value in THEME.items()}},
    )


def _template(environment: Environment, section: Section) -> Template:
    """Return the template of a section: its file, or its text."""
    text = section.template.read_text(encoding="utf-8") if isinstance(section.template, Path) else section.template
    return environment.from_string(text)


def _asset(name: str) -> Markup:
    return Markup(files("benchmarks.report").joinpath("templates", name).read_text(encoding="utf-8"))


@cache
def _plotly() -> Markup:
    """Return Plotly's library, compressed: the same for every page of this process."""
    from plotly.offline import get_plotlyjs

    return Markup(squeeze(get_plotlyjs().encode()))
