"""How figures look: colours that follow the page's theme, axes with units, lean numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

Json = dict[str, Any]

COLOURS = 8
SHADES = 6
SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "star", "x", "pentagon")
DASHES = ("solid", "dash", "dot", "dashdot")
GRID, INK, MUTED, UNKNOWN, ALARM, BAND = (
    f"var(--{name})" for name in ("grid", "ink", "muted", "unknown", "alarm", "band")
)
HOVER = "<extra></extra>"


def colour(index: int) -> str:
    """One of the colours that stand for methods, laws and joints; the theme says which it is."""
    return f"var(--c{index % COLOURS})"


def shades(count: int) -> list[str]:
    """Ordered colours, weak to strong."""
    return [f"var(--s{round(i * (SHADES - 1) / max(count - 1, 1))})" for i in range(count)]


def law_colours(laws: Iterable[str]) -> dict[str, str]:
    """Colour of each time law, apart from those of the first IK methods."""
    return {law: colour(4 + i) for i, law in enumerate(dict.fromkeys(laws))}


def axis(title: str, **options: Any) -> Json:
    """An axis with its unit."""
    quiet = {"gridcolor": GRID, "zerolinecolor": GRID, "linecolor": MUTED, "ticks": "outside", "tickcolor": MUTED}
    return quiet | {"title": {"text": title, "standoff": 6}, "automargin": True, "ticklen": 4} | options


def iterations(count: int) -> str:
    """So many iterations, in words."""
    return f"{count} iteration" + ("s" if count != 1 else "")


def log_axis(title: str, **options: Any) -> Json:
    """A logarithmic axis with powers of ten."""
    return axis(title, type="log", exponentformat="power", **({"dtick": 2} | options))


def line(**options: Any) -> Json:
    """A line trace."""
    import plotly.graph_objects as go

    data: Json = go.Scatter(**({"mode": "lines", "showlegend": False} | options)).to_plotly_json()
    return data


def heatmap(**options: Any) -> Json:
    """A heat map; its numbers are ours already, and Plotly would look at every one of them."""
    import plotly.graph_objects as go

    numbers = {k: options.pop(k) for k in ("z", "customdata") if k in options}
    data: Json = go.Heatmap(**options).to_plotly_json()
    return data | numbers


def line_3d(**options: Any) -> Json:
    """A line in space."""
    import plotly.graph_objects as go

    data: Json = go.Scatter3d(**({"mode": "lines", "showlegend": False} | options)).to_plotly_json()
    return data


def bars(**options: Any) -> Json:
    """Horizontal bars."""
    import plotly.graph_objects as go

    data: Json = go.Bar(**({"orientation": "h", "showlegend": False} | options)).to_plotly_json()
    return data


def lean(values: Iterable[float | None], digits: int = 4) -> list[float | None]:
    """Numbers rounded to so many significant digits; None for what is not finite."""
    return [None if v is None or not math.isfinite(v) else float(f"{v:.{digits}g}") for v in values]
