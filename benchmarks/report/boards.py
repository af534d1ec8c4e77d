"""Boards: figures that share controls, at the choices of a reader, and their data for the browser as compressed JSON."""

from __future__ import annotations

import base64
import copy
import gzip
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.report.figures import Json, When

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

WHOLE_DIGITS = 2**53
"""Whole numbers up to this are exact as floats."""


@dataclass(frozen=True)
class Control:
    """A control with which the reader selects the content of a board."""

    key: str
    label: str
    options: tuple[tuple[str, str], ...]
    initial: str = ""
    when: When = field(default_factory=dict)

    @property
    def value(self) -> str:
        """Value that is selected initially."""
        return self.initial or self.options[0][0]

    @staticmethod
    def of(key: str, label: str, values: Sequence[str], initial: str = "") -> Control:
        """Return a choice among values that are their own names."""
        return Control(key, label, tuple((v, v) for v in values), initial)

    @staticmethod
    def of_blocks(blocks: Sequence[Any]) -> Control:
        """Return a choice among blocks with their rows."""
        return Control("block", "Problems", tuple((b.block.id, b.block.title) for b in blocks))


@dataclass(frozen=True)
class Board:
    """Figures that share controls and a caption, with a heading if a section has several boards."""

    id: str
    figures: tuple[Figure, ...]
    controls: tuple[Control, ...] = ()
    caption: str = ""
    heading: str = ""

    @property
    def shown(self) -> tuple[Control, ...]:
        """Controls that the page shows: those with more than one option."""
        return tuple(c for c in self.controls if len(c.options) > 1)

    @property
    def state(self) -> dict[str, str]:
        """Initial value of every control."""
        return {c.key: c.value for c in self.controls}

    @property
    def chosen(self) -> str:
        """Initial choices in words, for a figure on paper; empty without a choice."""
        here = [c for c in self.shown if fits(c.when, self.state)]
        named = "; ".join(f"{c.label}: {dict(c.options)[c.value]}" for c in here)
        return f"Shown for {named}." if named else ""

    def each(self, key: str) -> tuple[Board, ...]:
        """Return one board for each value of a control, to be drawn one after another."""
        if all(c.key != key for c in self.shown):
            return (self,)

        def fixed(value: str) -> tuple[Control, ...]:
            return tuple(replace(c, initial=value) if c.key == key else c for c in self.controls)

        values = [value for c in self.controls if c.key == key for value, _ in c.options]
        return tuple(replace(self, id=f"{self.id}-{value}", controls=fixed(value)) for value in values)

    def at_first(self) -> list[Figure]:
        """Return the figures at the initial choices."""
        return [figure_at(figure, self.state) for figure in self.figures]


def fits(when: When, state: Mapping[str, str]) -> bool:
    """Return whether something is shown at these choices."""
    return all(state.get(key) in values for key, values in when.items())


def figure_at(figure: Figure, state: Mapping[str, str]) -> Figure:
    """Return a figure as it is at some choices."""
    import plotly.graph_objects as go

    found = go.Figure(layout=copy.copy(figure.layout))
    for variant in figure.layout.meta.get("variants", ()):
        if fits(variant["when"], state):
            found.update_layout(variant["layout"])
    for trace in figure.data:
        meta = trace.meta or {}
        if fits(meta.get("when", {}), state):
            found.add_trace(trace)
            if "look" in meta and fits(meta["at"], state):
                found.data[-1].update(meta["look"])
    return found


# ---------------------------------------------------------------- data for the browser


def packed(board: Board, names: Sequence[str] = ()) -> str:
    """Return the figures of a board as the page's script reads them; Plotly shows the names unchanged."""
    marked = sorted((name for name in names if set(name) & set("<>&")), key=len, reverse=True)
    return squeeze(strict_json([_plain(figure, marked) for figure in board.figures]).encode())


def squeeze(content: bytes) -> str:
    """Compress bytes to text; the result is reproducible."""
    return base64.b64encode(gzip.compress(content, compresslevel=9, mtime=0)).decode()


def strict_json(data: Any) -> str:
    """Return JSON without NaN."""
    return json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":"))


def strict(data: Any) -> str:
    """Return JSON without NaN that is safe inside a script element and an attribute."""
    text = strict_json(data)
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _plain(figure: Figure, names: Sequence[str]) -> Json:
    """Return a figure as plain data, without the template and the title, which the page has once."""
    layout = {k: v for k, v in figure.layout.to_plotly_json().items() if k not in ("template", "title")}
    traces = [trace.to_plotly_json() for trace in figure.data]
    for trace in traces:
        if "log10" in (trace.get("meta") or {}):
            del trace["z"]  # the page computes it from the values
    return {"data": _listed(traces, names), "layout": _listed(layout, names)}


def _listed(data: Any, names: Sequence[str]) -> Any:
    """Return data with lists in place of arrays, None in place of NaN, and escaped names."""
    if isinstance(data, str):
        for name in names:
            data = data.replace(name, html.escape(name, quote=False))
        return data
    if isinstance(data, dict):
        return {key: _listed(value, names) for key, value in data.items()}
    if isinstance(data, np.ndarray) and data.ndim == 1 and data.dtype.kind == "f":
        return [None if v != v else int(v) if abs(v) < WHOLE_DIGITS and v == int(v) else v for v in data.tolist()]
    if isinstance(data, list | tuple | np.ndarray):
        return [_listed(value, names) for value in data]
    return _listed(np.array([data], dtype=float), names)[0] if isinstance(data, float | np.number) else data
