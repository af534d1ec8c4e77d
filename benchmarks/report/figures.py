"""Style of figures: colours of the page's theme, axes with units, rounded numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Any

Json = dict[str, Any]

METHOD_COLOURS = 20
"""Number of colours that the page's style reserves for methods and laws."""

COLOURS = 8
"""Number of muted colours in the page's style for everything except methods: joints, limits, endings of a solve."""

DASHES = ("solid", "dash", "dot", "dashdot")
"""Dashes of lines, as Plotly calls them. Methods with the same dash have colours that colour-blind readers tell apart."""

SHADES = 6
"""Number of ordered colours that the page's style has."""

SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "star", "x", "pentagon")
"""Markers, as Plotly calls them."""

NOISE = 1e-12
"""Lengths [m] and angles [rad] below this are rounding of double precision and no results; they are shown as ≤ this."""

PER_BASE_UNIT = {"m": 1.0, "mm": 1e3, "µm": 1e6, "nm": 1e9, "rad": 1.0, "mrad": 1e3, "µrad": 1e6, "°": 180.0 / math.pi}
"""Units of lengths and angles: the number of units in one metre or radian."""

GRID_COLOUR = "var(--grid)"
"""Colour of the lines of a grid."""

INK_COLOUR = "var(--ink)"
"""Colour of text and of emphasised lines."""

MUTED_COLOUR = "var(--muted)"
"""Colour of axes and of secondary lines."""

BAND_COLOUR = "var(--band)"
"""Colour of the area beyond a limit."""

HOVER = "<extra></extra>"
"""Suffix of tooltip text, with which Plotly shows no second box beside it."""


def method_colour(index: int) -> str:
    """Return the colour of a method or law, as a variable that the page's theme defines."""
    return f"var(--m{index % METHOD_COLOURS})"


def method_dash(index: int) -> str:
    """Return the dash of the lines of a method or law."""
    return DASHES[(index + index // METHOD_COLOURS) % len(DASHES)]


def method_symbol(index: int) -> str:
    """Return the marker of a method or law."""
    return SYMBOLS[(index + index // METHOD_COLOURS) % len(SYMBOLS)]


def colour(index: int) -> str:
    """Return a muted colour of the page's theme for everything except methods (a joint, a limit)."""
    return f"var(--c{index % COLOURS})"


def noise_floor(unit: str) -> float:
    """Return the least value that is drawn and written as a result."""
    if unit not in PER_BASE_UNIT:
        return 0.0
    return float(f"1e{math.ceil(round(math.log10(NOISE * PER_BASE_UNIT[unit]), 6))}")


def shades(count: int) -> list[str]:
    """Return ordered colours, from weak to strong."""
    return [f"var(--s{round(i * (SHADES - 1) / max(count - 1, 1))})" for i in range(count)]


def axis(title: str, **options: Any) -> Json:
    """Return an axis with its unit."""
    lines = {"gridcolor": GRID_COLOUR, "zerolinecolor": GRID_COLOUR, "linecolor": MUTED_COLOUR}
    ticks = {"ticks": "outside", "tickcolor": MUTED_COLOUR}
    return lines | ticks | {"title": {"text": title, "standoff": 6}, "automargin": True, "ticklen": 4} | options


def iterations(count: int) -> str:
    """Describe a number of iterations."""
    return f"{count} iteration" + ("s" if count != 1 else "")


def log_axis(title: str, **options: Any) -> Json:
    """Return a logarithmic axis with powers of ten; for lengths and angles it ends at the least result, with a mark there."""
    found = re.search(r"\[([^\[\]]+)\]$", title)
    floor = noise_floor(found[1]) if found else 0.0
    data = axis(title, type="log", exponentformat="power", **({"dtick": 2} | options))
    if floor and "range" in data:
        low, high = data["range"]
        data["range"] = [max(low, math.log10(floor) - 0.3), high]
    return data | ({"meta": floor} if floor else {})


def line(**options: Any) -> Json:
    """Return a line trace; its numbers bypass Plotly's validation, which would check each one and be slow."""
    import plotly.graph_objects as go

    numbers = {k: options.pop(k) for k in ("x", "y", "customdata") if k in options}
    data: Json = go.Scatter(**({"mode": "lines", "showlegend": False} | options)).to_plotly_json()
    return data | numbers


def heatmap(**options: Any) -> Json:
    """Return a heat-map trace; its numbers bypass Plotly's validation, which would check each one and be slow."""
    import plotly.graph_objects as go

    numbers = {k: options.pop(k) for k in ("z", "customdata") if k in options}
    data: Json = go.Heatmap(**options).to_plotly_json()
    return data | numbers


def line_3d(**options: Any) -> Json:
    """Return a line in space."""
    import plotly.graph_objects as go

    data: Json = go.Scatter3d(**({"mode": "lines", "showlegend": False} | options)).to_plotly_json()
    return data


def bars(**options: Any) -> Json:
    """Return horizontal bars."""
    import plotly.graph_objects as go

    data: Json = go.Bar(**({"orientation": "h", "showlegend": False} | options)).to_plotly_json()
    return data


def lean(values: Iterable[float | None], digits: int = 4) -> list[float | None]:
    """Round numbers to some significant digits; None for NaN and infinity."""
    return [None if v is None or not math.isfinite(v) else float(f"{v:.{digits}g}") for v in values]
