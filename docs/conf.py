"""Settings of the documentation site: ``make docs`` builds it with warnings as errors."""

import re
import tomllib
from pathlib import Path

from sphinx.application import Sphinx

_PROJECT = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project = "optik"
author = "The optik authors"
release = version = _PROJECT["version"]
html_title = f"optik {release}"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
source_suffix = {".md": "markdown"}

# Pages and their plots: no request leaves the reader's browser.
default_role = "py:obj"
html_theme = "furo"
html_copy_source = False
html_show_sourcelink = False

myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 4

# Types stand in the docstrings, with shapes and units, which annotations cannot say.
autodoc_typehints = "none"
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


def _plain_types(app: object, what: str, name: str, found: object, options: object, lines: list[str]) -> None:
    """Show types of attributes as words, not as links: "(N, n) array" names nothing; and part "a, b" into two."""
    types = {match[1]: match[2] for line in lines if (match := _TYPE.fullmatch(line))}
    shown = []
    for line in lines:
        if _TYPE.fullmatch(line):
            continue
        if match := _ATTRIBUTE.match(line):
            *others, last = match[1].split(", ")
            shown += [f":ivar {other}:" for other in others]
            line = f":ivar {last}: *{types[match[1]]}*. {match[2]}" if match[1] in types else line
        shown.append(line)
    lines[:] = shown


def _skip_fields(app: object, what: str, name: str, found: object, skip: bool, options: object) -> bool | None:
    """Leave out the fields of named tuples, which the class's own docstring lists."""
    return True if str(getattr(found, "__doc__", "")).startswith("Alias for field number") else None


def setup(app: Sphinx) -> None:
    """Called by Sphinx at its start.

    Parameters
    ----------
    app : Sphinx
        The build.
    """
    app.connect("autodoc-process-docstring", _escape_bars, priority=100)
    app.connect("autodoc-process-docstring", _plain_types, priority=900)
    app.connect("autodoc-skip-member", _skip_fields)
