"""How figures look: colours that follow the page's theme, axes with units, lean numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

Json = dict[str, Any]

COLOURS = 8
"""Number of colours that the page's style has for methods, laws and joints."""

SHADES = 6
"""Number of ordered colours that the page's style has."""

SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "star", "x", "pentagon")
"""Markers, as many as there are colours."""

GRID_COLOUR = "var(--grid)"
"""Colour of the lines of a grid."""

INK_COLOUR = "var(--ink)"
"""Colour of text and of what stands out."""

MUTED_COLOUR = "var(--muted)"
"""Colour of axes and of what stands back."""

BAND_COLOUR = "var(--band)"
"""Colour of what lies beyond a limit."""

HOVER = "<extra></extra>"
"""Ends the words of a tooltip: Plotly shows no second box beside it."""


def colour(index: int) -> str:
    """One of the colours of methods, laws and joints, as a variable that the page's theme defines.

    Parameters
    ----------
    index : int
        Which one; they repeat.

    Returns
    -------
    str
        A variable of the page's style.
    """
    return f"var(--c{index % COLOURS})"


def shades(count: int) -> list[str]:
    """Ordered colours, weak to strong.

    Parameters
    ----------
    count : int
        How many.

    Returns
    -------
    list of str
        Variables of the page's style.
    """
    return [f"var(--s{round(i * (SHADES - 1) / max(count - 1, 1))})" for i in range(count)]


def axis(title: str, **options: Any) -> Json:
    """An axis with its unit.

    Parameters
    ----------
    title : str
        With its unit.
    **options
        Further options of Plotly.

    Returns
    -------
    dict
        An axis of Plotly.
    """
    lines = {"gridcolor": GRID_COLOUR, "zerolinecolor": GRID_COLOUR, "linecolor": MUTED_COLOUR}
    ticks = {"ticks": "outside", "tickcolor": MUTED_COLOUR}
    return lines | ticks | {"title": {"text": title, "standoff": 6}, "automargin": True, "ticklen": 4} | options


def iterations(count: int) -> str:
    """A number of iterations, in words.

    Parameters
    ----------
    count : int
        How many.

    Returns
    -------
    str
        Such as 3 iterations.
    """
    return f"{count} iteration" + ("s" if count != 1 else "")


def log_axis(title: str, **options: Any) -> Json:
    """A logarithmic axis with powers of ten.

    Parameters
    ----------
    title : str
        With its unit.
    **options
        Further options of Plotly.

    Returns
    -------
    dict
        An axis of Plotly.
    """
    return axis(title, type="log", exponentformat="power", **({"dtick": 2} | options))


def line(**options: Any) -> Json:
    """A line trace.

    Parameters
    ----------
    **options
        Options of a scatter trace of Plotly.

    Returns
    -------
    dict
        A trace of Plotly.
    """
    import plotly.graph_objects as go

    data: Json = go.Scatter(**({"mode": "lines", "showlegend": False} | options)).to_plotly_json()
    return data


def heatmap(**options: Any) -> Json:
    """A heat map; its numbers are ours already, and Plotly would look at every one of them.

    Parameters
    ----------
    **options
        Options of a heat map of Plotly.

    Returns
    -------
    dict
        A trace of Plotly.
    """
    import plotly.graph_objects as go

    numbers = {k: options.pop(k) for k in ("z", "customdata") if k in options}
    data: Json = go.Heatmap(**options).to_plotly_json()
    return data | numbers


def line_3d(**options: Any) -> Json:
    """A line in space.

    Parameters
    ----------
    **options
        Options of a scatter trace in space of Plotly.

    Returns
    -------
    dict
        A trace of Plotly.
    """
    import plotly.graph_objects as go

    data: Json = go.Scatter3d(**({"mode": "lines", "showlegend": False} | options)).to_plotly_json()
    return data


def bars(**options: Any) -> Json:
    """Horizontal bars.

    Parameters
    ----------
    **options
        Options of a bar trace of Plotly.

    Returns
    -------
    dict
        A trace of Plotly.
    """
    import plotly.graph_objects as go

    data: Json = go.Bar(**({"orientation": "h", "showlegend": False} | options)).to_plotly_json()
    return data


def lean(values: Iterable[float | None], digits: int = 4) -> list[float | None]:
    """Numbers rounded to some significant digits; None for what is not finite.

    Parameters
    ----------
    values : iterable of float
        The numbers.
    digits : int
        Significant digits.

    Returns
    -------
    list
        The rounded numbers.
    """
    return [None if v is None or not math.isfinite(v) else float(f"{v:.{digits}g}") for v in values]
