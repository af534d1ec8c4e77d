"""Options of methods: names and defaults from signatures, meaning and units from docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any, NamedTuple

NO_DEFAULT = inspect.Parameter.empty
"""Default of a required option."""
_SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)
"""Heading of a section of a NumPy docstring."""
_UNIT = re.compile(r"\[((?:rad|m|s|kg|N|deg|degrees|mm|µs|ms|Hz|1|1/s)(?:[/,^·², ³](?:\w|[/²³^,· ])*)?)\]")
"""A unit in square brackets."""


class ParameterDoc(NamedTuple):
    """The documentation of one parameter: its type as written, its description on one line, and the first unit in it or ""."""

    type: str
    meaning: str
    unit: str


def read_parameter_docs(kinds: type | Any) -> dict[str, ParameterDoc]:
    """Return the documentation of a function's or class's parameters and attributes by name."""
    found: dict[str, ParameterDoc] = {}
    for one in inspect.getmro(kinds) if inspect.isclass(kinds) else (kinds,):
        doc = vars(one).get("__doc__") if inspect.isclass(one) else one.__doc__
        for name, value in _entries(inspect.cleandoc(doc or "")):
            found.setdefault(name, value)
    return found


def _entries(doc: str) -> Iterable[tuple[str, ParameterDoc]]:
    """List the entries of the sections Parameters and Attributes of a docstring."""
    parts = _SECTION.split(doc)
    for title, body in zip(parts[1::2], parts[2::2], strict=True):
        if title not in ("Parameters", "Attributes"):
            continue
        for entry in re.split(r"\n(?=\S)", body.strip("\n")):
            head, _, text = entry.partition("\n")
            names, _, kind = head.partition(" : ")
            meaning = " ".join(text.split())
            unit = _UNIT.search(f"{meaning} {kind}")
            for name in names.split(","):
                yield name.strip(), ParameterDoc(kind.strip(), meaning, unit[1] if unit else "")


def defaults(method: Any) -> dict[str, Any]:
    """Return the options of a method with their defaults: keyword arguments of a function, or of a class's ``__init__``."""
    found: dict[str, Any] = {}
    for one in inspect.getmro(method) if inspect.isclass(method) else (method,):
        function = vars(one).get("__init__") if inspect.isclass(one) else one
        if function is None or one is object:
            continue
        parameters = inspect.signature(function).parameters.values()
        for parameter in parameters:
            if parameter.kind is parameter.KEYWORD_ONLY:
                found.setdefault(parameter.name, parameter.default)
        if not any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
            break
    return found


def find_nearest_name(name: str, known: Iterable[str]) -> str:
    """Return the known name with the most similar spelling, or an empty string."""
    return next(iter(get_close_matches(name, list(known), n=1)), "")
