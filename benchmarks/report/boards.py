"""Figures of the report in the colours of the page, and boards: figures that share controls."""

from __future__ import annotations

import base64
import gzip
import html
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.types import Array

if TYPE_CHECKING:
    from plotly.graph_objects import Bar, Figure, Heatmap, Scatter, Scatter3d
    from plotly.graph_objects.layout import Template


# ---------------- plotly figures in the colours of the page


Json = dict[str, Any]
When = Mapping[str, Sequence[str]]
"""Values of controls at which something is shown; controls that are not named do not matter."""

STYLE = files("benchmarks.report").joinpath("templates", "page.css").read_text(encoding="utf-8")
"""Style of the page, which names the colours."""

THEME: dict[str, str] = {
    name: value.strip() for name, value in re.findall(r"(--[\w-]+):\s*([^;]+);", STYLE.split("@media")[0])
}
"""Colours of the light theme by their variables in the style. The page replaces those of figures in its dark theme."""

DASHES = ("solid", "dash", "dot", "dashdot")
"""Dashes of lines, as Plotly calls them. Methods with the same dash have colours that colour-blind readers tell apart."""

SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "star", "x", "pentagon")
"""Markers, as Plotly calls them."""

METHOD_COLOURS, COLOURS, SHADES = (sum(bool(re.fullmatch(f"--{k}\\d+", name)) for name in THEME) for k in "mcs")
"""Number of colours for methods and laws, of muted colours for all else (joints, limits), and of ordered colours."""

NOISE = 1e-12
"""Lengths [m] and angles [rad] below this are rounding of double precision and no results; they are shown as ≤ this."""

PER_BASE_UNIT = {"m": 1.0, "mm": 1e3, "µm": 1e6, "nm": 1e9, "rad": 1.0, "mrad": 1e3, "µrad": 1e6, "°": 180.0 / math.pi}
"""Units of lengths and angles: the number of units in one metre or radian."""

GRID_COLOUR, INK_COLOUR, MUTED_COLOUR = THEME["--grid"], THEME["--ink"], THEME["--muted"]
"""Colours of the lines of a grid, of text and emphasised lines, and of axes and secondary lines."""

BAND_COLOUR, ALARM_COLOUR, UNKNOWN_COLOUR = THEME["--band"], THEME["--alarm"], THEME["--unknown"]
"""Colours of the area beyond a limit, of a limit, and of what is not known."""

HOVER = "<extra></extra>"
"""Suffix of tooltip text, with which Plotly shows no second box beside it."""

MOST_STEPS = 300
"""Number of plotted steps of a distribution: enough for a plot of some hundred pixels."""


# ---------------------------------------------------------------- colours and numbers


def method_colour(index: int) -> str:
    """Return the colour of a method or law."""
    return THEME[f"--m{index % METHOD_COLOURS}"]


def method_dash(index: int) -> str:
    """Return the dash of the lines of a method or law."""
    return DASHES[(index + index // METHOD_COLOURS) % len(DASHES)]


def method_symbol(index: int) -> str:
    """Return the marker of a method or law."""
    return SYMBOLS[(index + index // METHOD_COLOURS) % len(SYMBOLS)]


def colour(index: int) -> str:
    """Return a muted colour for everything except methods (a joint, a limit)."""
    return THEME[f"--c{index % COLOURS}"]


def shades(count: int) -> list[str]:
    """Return ordered colours, from weak to strong."""
    return [THEME[f"--s{round(i * (SHADES - 1) / max(count - 1, 1))}"] for i in range(count)]


def variable(value: str) -> str:
    """Return a colour of the light theme as the page names it in every theme; other colours stay."""
    return next((f"var({name})" for name, known in THEME.items() if known == value), value)


def noise_floor(unit: str) -> float:
    """Return the least value that is drawn and written as a result."""
    if unit not in PER_BASE_UNIT:
        return 0.0
    return float(f"1e{math.ceil(round(math.log10(NOISE * PER_BASE_UNIT[unit]), 6))}")


def lean(values: Any, digits: int = 4) -> Array:
    """Round numbers to some significant digits; NaN for None and infinity."""
    x = np.array([np.nan if v is None else v for v in values], dtype=float)
    x[~np.isfinite(x)] = np.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        power = np.nan_to_num(digits - 1 - np.floor(np.log10(np.abs(x))), nan=0.0, posinf=0.0, neginf=0.0).clip(
            -300, 300
        )
    up, down = 10.0 ** power.clip(0), 10.0 ** (-power).clip(0)  # whole powers of ten: no digits beyond those asked for
    return np.asarray(np.round(x * up / down) / up * down)


def fractions(values: ArrayLike, most: int = MOST_STEPS) -> tuple[Array, Array]:
    """Return the finite values, and the percentage of all values at or below each, to be drawn with level steps.

    Of more steps than `most`, half are evenly spaced in their percentage, half become ever denser towards either end; the
    first and the last are always there, and each that is drawn is exact.
    """
    every = np.asarray(values, dtype=float)
    x, counts = np.unique(every[np.isfinite(every)], return_counts=True)
    percent = 100.0 * np.cumsum(counts) / max(len(every), 1)
    if len(x) > most:
        even = np.searchsorted(percent, np.linspace(percent[0], percent[-1], most // 2))
        dense = np.geomspace(1.0, len(x), most // 4).astype(int) - 1
        chosen = np.unique(np.concatenate([[0, len(x) - 1], even, dense, len(x) - 1 - dense]).clip(0, len(x) - 1))
        x, percent = x[chosen], percent[chosen]
    return np.concatenate([x[:1], x]), np.concatenate([[0.0], percent])


def iterations(count: int) -> str:
    """Describe a number of iterations."""
    return f"{count} iteration" + ("s" if count != 1 else "")


# ---------------------------------------------------------------- figures


@cache
def template() -> Template:
    """Return the look of all figures: axes, margins and text in the page's colours."""
    import plotly.graph_objects as go

    lines = {"gridcolor": GRID_COLOUR, "zerolinecolor": GRID_COLOUR, "linecolor": MUTED_COLOUR}
    ticks = {"showline": True, "ticks": "outside", "tickcolor": MUTED_COLOUR, "ticklen": 4}
    axes = lines | ticks | {"automargin": True, "title": {"standoff": 6}}
    clear = "rgba(0,0,0,0)"
    layout = {
        "paper_bgcolor": clear, "plot_bgcolor": clear, "font": {"size": 12, "color": INK_COLOUR}, "hovermode": "closest",
        "margin": {"l": 8, "r": 12, "t": 12, "b": 8}, "hoverlabel": {"font": {"size": 12}},
        "modebar": {"bgcolor": clear, "color": MUTED_COLOUR, "activecolor": INK_COLOUR},
        "xaxis": axes, "yaxis": axes,
        "scene": {f"{a}axis": lines | {"showbackground": False, "showline": True} for a in "xyz"},
    }  # fmt: skip
    return go.layout.Template(layout=layout)


def figure(
    id: str, title: str, x: str | Json | None = None, y: str | Json | None = None, height: int = 340, **layout: Any
) -> Figure:
    """Return an empty figure with axes (their titles, or more); `id` is unique on the page, a height of 0 means a square."""
    import plotly.graph_objects as go

    axes = {f"{k}axis": axis(v) if isinstance(v, str) else v for k, v in (("x", x), ("y", y)) if v is not None}
    size = {"height": height} if height else {}
    frame = {"template": template(), "title": {"text": title}, "meta": {"id": id}}
    return go.Figure(layout=frame | size | axes | layout)


def axis(title: str, **options: Any) -> Json:
    """Return an axis with its unit."""
    return {"title": {"text": title}} | options


def log_axis(title: str, **options: Any) -> Json:
    """Return a logarithmic axis with powers of ten; for lengths and angles it ends at the least result."""
    data = axis(title, type="log", exponentformat="power", **({"dtick": 2} | options))
    floor = _floor(data)
    if floor and "range" in data:
        low, high = data["range"]
        data["range"] = [max(low, math.log10(floor) - 0.3), high]
    return data


def ticked_axis(title: str, ticks: Sequence[float], **options: Any) -> Json:
    """Return a logarithmic axis with these numbers on it."""
    return axis(title, type="log", tickvals=list(ticks), ticktext=[f"{x:g}" for x in ticks], **options)


def percent_axis(what: str) -> Json:
    """Return an axis of percentages of something, with some margin at both ends."""
    return axis(f"{what} [%]", range=[-2, 102])


def _floor(axis: Mapping[str, Any]) -> float:
    """Return the least result of a logarithmic axis, by the unit in its title; 0 if it has none."""
    found = re.search(r"\[([^\[\]]+)\]$", (axis.get("title") or {}).get("text") or "")
    return noise_floor(found[1]) if found and axis.get("exponentformat") == "power" else 0.0


def line(x: Any, y: Any, *, digits: int = 4, hover: str = "", **options: Any) -> Scatter:
    """Return a line or markers in a plane, by rounded numbers; those with a name are in the legend."""
    import plotly.graph_objects as go

    points = {"x": _round_values(x, digits), "y": _round_values(y, digits)}
    return go.Scatter(points | _in_legend(hover, {"mode": "lines"} | options))


def line_over(start: float, step: float, y: Any, **options: Any) -> Scatter:
    """Return a line through values at equal steps."""
    found = line(None, y, **options)
    return found.update(x0=start, dx=step)


def line_3d(x: Any, y: Any, z: Any, *, digits: int = 4, hover: str = "", **options: Any) -> Scatter3d:
    """Return a line or markers in space, by rounded numbers."""
    import plotly.graph_objects as go

    points = {name: _round_values(values, digits) for name, values in (("x", x), ("y", y), ("z", z))}
    return go.Scatter3d(points | _in_legend(hover, {"mode": "lines"} | options))


def bars(*, hover: str = "", **options: Any) -> Bar:
    """Return horizontal bars."""
    import plotly.graph_objects as go

    return go.Bar(_in_legend(hover, {"orientation": "h"} | options))


def heatmap(*, hover: str = "", **options: Any) -> Heatmap:
    """Return a heat map; one with a name is in the legend."""
    import plotly.graph_objects as go

    return go.Heatmap(_in_legend(hover, options))


def _in_legend(hover: str, options: Json) -> Json:
    """Return the options of a trace with its tooltip; those with a name are in the legend."""
    return ({"hovertemplate": hover + HOVER} if hover else {}) | {"showlegend": "name" in options} | options


def _round_values(values: Any, digits: int) -> Any:
    """Return rounded numbers; words, and None for what is not there, stay."""
    return values if values is None or any(isinstance(v, str) for v in values) else lean(values, digits)


def interval(values: Sequence[tuple[float, float, float]], **look: Any) -> Json:
    """Return the error bars of values with the ends of their intervals."""
    value, low, high = np.array(values, dtype=float).T
    ends = {"array": lean(np.maximum(high - value, 0.0)), "arrayminus": lean(np.maximum(value - low, 0.0))}
    return {"type": "data", "symmetric": False, "thickness": 1} | ends | look


def entry(name: str, colour: str, dash: str) -> Scatter:
    """Return a line without points: an entry of the legend for what several lines have in common."""
    return line([None], [None], name=name, line={"color": colour, "dash": dash})


def level(at: float, name: str = "", **look: Any) -> Json:
    """Return a level line across a figure, as a shape; one with a name is in the legend."""
    stroke = {"color": ALARM_COLOUR, "width": 1} | look
    shown = {"name": name, "showlegend": True} if name else {}
    return shown | {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": at, "y1": at, "line": stroke}


def band(low: float, high: float, name: str = "") -> Json:
    """Return the area between two levels, as a shape; one with a name is in the legend."""
    shown = {"name": name, "showlegend": True} if name else {}
    return shown | {
        "type": "rect", "xref": "paper", "x0": 0, "x1": 1, "y0": low, "y1": high, "layer": "below",
        "fillcolor": BAND_COLOUR, "line": {"width": 0},
    }  # fmt: skip


def add(figure: Figure, trace: Any, when: When | None = None, **patch: Any) -> None:
    """Add a trace, shown at some choices; what is below the least result of an axis is drawn there, with a mark.

    `patch` names the choices ``at`` which the trace has another ``look``.
    """
    for letter in "xy" if trace.type == "scatter" else "":
        floor, values = _floor(figure.layout[f"{letter}axis"].to_plotly_json()), trace[letter]
        if floor and values is not None:
            raised = np.maximum(np.asarray(values, dtype=float), floor)
            trace[letter] = raised
            marked = any(mark[f"{letter}ref"] == letter for mark in figure.layout.annotations)
            if (raised == floor).any() and not marked:
                figure.add_annotation(_floor_mark(letter, floor))
    if when or patch:
        trace.meta = {**(trace.meta or {}), **({"when": dict(when)} if when else {}), **patch}
    figure.add_trace(trace)


class Sample(NamedTuple):
    """Values of a method, the look of their line, and the choices at which it is shown.

    A value that is not finite stands for a failure.
    """

    label: str
    values: ArrayLike
    look: Json
    when: When


def fraction_plot(
    id: str, title: str, x: str | Json, what: str, hover: str, samples: Iterable[Sample], height: int = 380, **layout: Any
) -> Figure:  # fmt: skip
    """Return a plot of the percentage of each sample at or below a value, with a line for each sample that has values."""
    plot = figure(id, title, x, percent_axis(what), height, **layout)
    for label, values, look, when in samples:
        at, percent = fractions(values)
        if len(at):
            stepped = look | {"shape": "hv"}
            add(plot, line(at, percent, digits=6, name=label, line=stepped, hover=f"{label}<br>{hover}"), when)
    return plot


def _floor_mark(letter: str, floor: float) -> Json:
    """Return the mark at the end of an axis: values drawn there are at most this."""
    other = "y" if letter == "x" else "x"
    here = {f"{letter}ref": letter, letter: math.log10(floor), f"{other}ref": "paper", other: 0}
    return here | {
        "text": f"≤ 10<sup>−{-round(math.log10(floor))}</sup>", "showarrow": False, "font": {"size": 10}, "opacity": 0.85,
        "xanchor": "left", "yanchor": "bottom", "bgcolor": THEME["--paper"],
    }  # fmt: skip


def vary(figure: Figure, when: When, layout: Json) -> None:
    """Change the layout of a figure at some choices; later changes override earlier ones."""
    meta = figure.layout.meta
    figure.layout.meta = meta | {"variants": [*meta.get("variants", ()), {"when": dict(when), "layout": layout}]}


# ---------------- boards


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
