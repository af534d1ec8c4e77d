"""Boards: plots that share controls, and their data for the browser as strict JSON."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from benchmarks.report.packing import pack

Json = dict[str, Any]
When = Mapping[str, Sequence[str]]
"""Values of controls at which something is shown; controls that are not named do not matter."""

STROKES = {"solid": "", "dash": "7 4", "dot": "2 3", "dashdot": "7 3 2 3"}
"""Strokes and gaps of the dashes of a legend, in SVG's form."""

MARKER_CHARACTERS = {
    "circle": "●", "square": "■", "diamond": "◆", "triangle-up": "▲", "cross": "✚", "star": "★", "x": "✖", "pentagon": "⬟",
}  # fmt: skip
"""Markers of a legend."""


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
class Key:
    """One entry of a legend: a line, with its dash and marker if it has them, or a filled square.

    Attributes
    ----------
    label : str
        What the page calls it.
    colour : str
        A variable of the page's style.
    style : str
        ``solid``, ``dashed``, ``dot``, ``fill``, ``cross`` or ``ring``; without meaning where `dash` or `symbol` is given.
    when : mapping
        Values of controls at which it is shown.
    dash, symbol : str
        Those of Plotly that the line has.
    """

    label: str
    colour: str
    style: str = "solid"
    when: When = field(default_factory=dict)
    dash: str = ""
    symbol: str = ""

    @property
    def strokes(self) -> str:
        """Lengths of the strokes and gaps of the dash, for SVG."""
        return STROKES.get(self.dash, "")

    @property
    def marker(self) -> str:
        """The marker as a character."""
        return MARKER_CHARACTERS.get(self.symbol, "")


@dataclass
class Plot:
    """One plot: traces and layouts, each with the choices at which it is shown.

    Attributes
    ----------
    id : str
        Unique on the page.
    title : str
        Shown above the plot, and read out.
    layout : dict
        Plotly layout that is always there.
    height : int
        [px]; 0 for a square. A layout's own height wins.
    """

    id: str
    title: str
    layout: Json
    height: int = 340
    traces: list[Json] = field(default_factory=list)
    layouts: list[Json] = field(default_factory=list)

    def add(self, trace: Json, when: When | None = None, variants: Sequence[tuple[When, Json]] = ()) -> None:
        """Show a trace at some choices; variants change its look at others."""
        entry: Json = {"trace": trace}
        if when:
            entry["when"] = when
        if variants:
            entry["variants"] = [{"when": w, "patch": p} for w, p in variants]
        self.traces.append(entry)

    def vary(self, when: When, layout: Json) -> None:
        """Change the layout at some choices; later changes override earlier ones."""
        self.layouts.append({"when": when, "layout": layout})

    def to_data(self) -> Json:
        """Return the data for the browser; nothing is drawn below the least result of a logarithmic axis."""
        layout, traces = dict(self.layout), self.traces
        for key, values in (("xaxis", "x"), ("yaxis", "y")):
            floor = layout.get(key, {}).get("meta")
            if floor:
                layout[key] = {k: v for k, v in layout[key].items() if k != "meta"}
                traces = [entry | {"trace": _raised(entry["trace"], values, floor)} for entry in traces]
                if any(floor in entry["trace"].get(values, ()) for entry in traces):
                    layout["annotations"] = [*layout.get("annotations", ()), _floor_mark(values, floor)]
        data = {"id": self.id, "layout": layout, "traces": traces, "layouts": self.layouts}
        return {key: value for key, value in data.items() if value}


@dataclass(frozen=True)
class Board:
    """Plots that share controls, a legend and a caption, with a heading if a section has several boards."""

    id: str
    plots: tuple[Plot, ...]
    controls: tuple[Control, ...] = ()
    legend: tuple[Key, ...] = ()
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
        here = [c for c in self.shown if all(self.state.get(key) in values for key, values in c.when.items())]
        named = "; ".join(f"{c.label}: {dict(c.options)[c.value]}" for c in here)
        return f"Shown for {named}." if named else ""

    def each(self, key: str) -> tuple[Board, ...]:
        """Return one board for each value of a control, to be drawn one after another."""
        if all(c.key != key for c in self.shown):
            return (self,)
        values = [value for c in self.controls if c.key == key for value, _ in c.options]
        return tuple(
            replace(
                self,
                id=f"{self.id}-{value}",
                controls=tuple(replace(c, initial=value) if c.key == key else c for c in self.controls),
            )
            for value in values
        )

    def packed(self, labels: Sequence[str] = ()) -> str:
        """Return all data that the page's script needs to draw the plots, compressed."""
        marked = sorted((label for label in labels if set(label) & set("<>&")), key=len, reverse=True)
        data = [plot.to_data() for plot in self.plots]
        return pack(_escaped(data, marked) if marked else data)


def _escaped(data: Any, names: Sequence[str]) -> Any:
    """Return data whose names Plotly shows unchanged."""
    if isinstance(data, str):
        for name in names:
            data = data.replace(name, html.escape(name, quote=False))
        return data
    if isinstance(data, dict):
        return {key: _escaped(value, names) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_escaped(value, names) for value in data]
    return data


def _raised(trace: Json, values: str, floor: float) -> Json:
    """Return a trace with values below the least result replaced by it."""
    found = trace.get(values)
    if not isinstance(found, list | tuple):
        return trace
    return trace | {values: [max(v, floor) if isinstance(v, float | int) else v for v in found]}


def _floor_mark(values: str, floor: float) -> Json:
    """Return the mark at the end of an axis: values drawn there are at most this."""
    text = f"≤ 10<sup>−{-round(math.log10(floor))}</sup>"
    here = {"xref": "paper", "x": 0, "yref": "y", "y": math.log10(floor), "xanchor": "left", "yanchor": "bottom"}
    if values == "x":
        here = {"yref": "paper", "y": 0, "xref": "x", "x": math.log10(floor), "xanchor": "left", "yanchor": "bottom"}
    return here | {"text": text, "showarrow": False, "font": {"size": 10}, "bgcolor": "var(--paper)", "opacity": 0.85}


def strict(data: Any) -> str:
    """Return JSON without NaN that is safe inside a script element and an attribute."""
    text = json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text
