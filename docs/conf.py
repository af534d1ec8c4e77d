"""Settings of the documentation site: ``make docs`` builds it with warnings as errors."""

import inspect
import os
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

from docutils.nodes import SkipNode
from latex2mathml.converter import convert
from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent.parent))
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # the notebooks call `optik`
os.environ["OPTIK_COMPILES"] = "quiet"  # what `optik kernels --compile` left out

from docs.generate import list_reference, write_pages

_PROJECT = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project = "optik"
author = "The optik authors"
copyright = f"2026, {author}"
release = version = _PROJECT["version"]
html_title = f"optik {release}"

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton", "sphinx_design"]
exclude_patterns = ["_build"]
source_suffix = {".md": "myst-nb"}
smartquotes = False  # q' is a derivative, and -- begins an option
html_math_renderer = "mathml"

nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_merge_streams = True
nb_render_markdown_format = "myst"  # tables

# Pages and their plots: no request leaves the reader's browser.
default_role = "py:obj"
html_theme = "furo"
html_static_path = ["generated/static", "site.css"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False

myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 4

# Types stand in the docstrings, with shapes and units, which annotations cannot say.
autodoc_typehints = "none"
python_maximum_signature_line_length = 80
autodoc_member_order = "groupwise"
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_param = False  # types are words, such as "(n,) array", and no names to link
napoleon_use_ivar = True
napoleon_preprocess_types = False


_TYPE = re.compile(r":vartype ([^:]+): (.*)")
"""The type of an attribute, as Napoleon writes it."""

_ATTRIBUTE = re.compile(r":ivar ([^:]+): ?(.*)")
"""An attribute or several, with what is said of it."""


def _escape_bars(app: object, what: str, name: str, found: object, options: object, lines: list[str]) -> None:
    """Keep |x|, an absolute value or a norm, from being read as a substitution."""
    lines[:] = [line.replace("|", "\\|") for line in lines]


def _add_defaults(app: object, what: str, name: str, thing: Any, options: object, lines: list[str]) -> None:
    """Add the defaults of the signature to the types of the parameters."""
    try:
        parameters = inspect.signature(thing).parameters
    except (TypeError, ValueError):  # no signature, such as that of a module
        return
    titles = {i - 1: lines[i - 1] for i, line in enumerate(lines) if i and re.fullmatch("-{3,}", line)}
    section = ""
    for i, line in enumerate(lines):
        section = titles.get(i, section)
        names = line.partition(" : ")[0].split(", ")
        if section == "Parameters" and " : " in line and not line.startswith(" ") and {*names} <= {*parameters}:
            defaults = {
                repr(parameters[n].default) for n in names if parameters[n].default is not inspect.Parameter.empty
            }
            if len(defaults) == 1 and defaults != {"None"}:
                default = defaults.pop().replace("'", '"')
                lines[i] = f"{line.removesuffix(', optional')}, default {default}"


def _plain_types(app: object, what: str, name: str, found: object, options: object, lines: list[str]) -> None:
    """Show types of attributes as words, not as links: "(N, n) array" names nothing; part "a, b", and write -- as a dash."""
    types = {match[1]: match[2] for line in lines if (match := _TYPE.fullmatch(line))}
    shown = []
    for line in lines:
        if _TYPE.fullmatch(line):
            continue
        if match := _ATTRIBUTE.match(line):
            *others, last = match[1].split(", ")
            shown += [f":ivar {other}:" for other in others]
            line = f":ivar {last}: *{types[match[1]]}*. {match[2]}" if match[1] in types else line
        shown.append(line.replace(" -- ", " – "))  # of Napoleon, between a parameter and its words
    lines[:] = shown


def _skip_fields(app: object, what: str, name: str, found: object, skip: bool, options: object) -> bool | None:
    """Leave out the fields of named tuples, which the class's own docstring lists."""
    return True if str(getattr(found, "__doc__", "")).startswith("Alias for field number") else None


def _write_pages(app: Sphinx, config: object) -> None:
    """Write the pages that are made of the code."""
    write_pages()


def _list_reference(app: Sphinx, name: str, source: list[str]) -> None:
    """Show the objects of a page of the reference as a table of links, and only there: all side bars show all other pages."""
    if name.startswith("api/"):
        source[0] = list_reference(source[0])
    if name.startswith(("generated/reference/", "generated/commands/")):
        app.env.metadata[name]["orphan"] = True


def _write_formula(translator: Any, node: Any) -> None:
    """Write a formula as MathML, which browsers show without a script."""
    formula = convert(node.astext(), display="block" if node.tagname == "math_block" else "inline")
    translator.body.append(formula if node.tagname == "math" else f'<div class="math">{formula}</div>')
    raise SkipNode


def setup(app: Sphinx) -> None:
    """Called by Sphinx at its start.

    Parameters
    ----------
    app : Sphinx
        The build.
    """
    app.add_html_math_renderer("mathml", (_write_formula, None), (_write_formula, None))
    app.connect("config-inited", _write_pages)
    app.connect("source-read", _list_reference)
    app.connect("autodoc-process-docstring", _escape_bars, priority=100)
    app.connect("autodoc-process-docstring", _add_defaults, priority=200)
    app.connect("autodoc-process-docstring", _plain_types, priority=900)
    app.connect("autodoc-skip-member", _skip_fields)
