"""Cards: results in a notebook cell as HTML with a verdict, a table, bars, and plots as SVG, without scripts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from optik.check import format_ratio
from optik.types import Array

if TYPE_CHECKING:
    from jinja2 import Template

WIDTH, HEIGHT = 230.0, 96.0
"""Size of a plot [px]."""
MOST_POINTS = 160
"""Largest number of drawn points of a curve: a point is at least 1.4 pixels wide."""
COLOURS = ("#4477aa", "#ee6677", "#228833", "#ccaa22", "#2299bb", "#aa3377", "#888888", "#dd7722", "#7755cc")
"""Colours of joints, which are legible on white and on black."""


class Bar(NamedTuple):
    """A peak value as a fraction of its limit, with its joint and time in words."""

    name: str
    ratio: float
    words: str

    @property
    def text(self) -> str:
        """The ratio as text."""
        return format_ratio(self.ratio)

    @property
    def percent(self) -> float:
        """Length of the bar [%]."""
        return round(100.0 * min(self.ratio, 1.0), 1)

    @property
    def is_exceeded(self) -> bool:
        """Whether the limit is exceeded by more than rounding."""
        return self.ratio > 1.0 + 1e-9


class Plot(NamedTuple):
    """Curves over time with a limit on either side: title, abscissae (k,), curves (k, n), and the limits or None."""

    title: str
    x: Array
    curves: Array
    limits: tuple[float, float] | None = None
    unit: str = "s"

    @property
    def lines(self) -> list[tuple[str, str]]:
        """Colour and points of each curve."""
        x, y = self._scaled
        return [
            (COLOURS[k % len(COLOURS)], " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, column, strict=True)))
            for k, column in enumerate(y.T)
        ]

    @property
    def levels(self) -> list[float]:
        """Heights of the limits."""
        return [] if self.limits is None else [round(self._height(at), 1) for at in self.limits]

    @property
    def span(self) -> tuple[float, float]:
        """Lowest and highest value of the picture."""
        values = [float(self.curves.min()), float(self.curves.max()), *(self.limits or ())]
        low, high = min(values), max(values)
        room = 0.06 * (high - low) or 1.0
        return low - room, high + room

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Heights and texts at the axis: the limits if the curves are near them, else the ends of the picture."""
        low, high = self.span
        ends = self.limits or self.span
        at = ends if ends[1] - ends[0] > 0.5 * (high - low) else self.span
        return [(round(self._height(value), 1), f"{value:.3g}".replace("-", "−")) for value in at]

    def _height(self, value: float | Array) -> float:
        low, high = self.span
        return HEIGHT * (high - value) / (high - low)  # type: ignore[return-value]

    @property
    def _scaled(self) -> tuple[Array, Array]:
        chosen = np.unique(np.linspace(0, len(self.x) - 1, min(len(self.x), MOST_POINTS)).round().astype(np.int64))
        width = self.x[-1] - self.x[0] or 1.0
        return WIDTH * (self.x[chosen] - self.x[0]) / width, np.asarray(self._height(self.curves[chosen]))


@dataclass(frozen=True, kw_only=True)
class Card:
    """The content of a notebook cell.

    Attributes
    ----------
    title : str
        Heading.
    verdict : str
        One line on success or failure, and its sign: ``good`` is None for neither.
    facts : sequence of (name, text)
        Rows of a table of two columns.
    head, rows : sequences
        A wider table: names of its columns, and texts of its rows.
    bars : sequence of Bar
        Peaks as fractions of their limits.
    plots : sequence of Plot
        Small plots side by side, and the names of their curves.
    """

    title: str
    verdict: str = ""
    good: bool | None = None
    facts: Sequence[tuple[str, str]] = ()
    head: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()
    bars: Sequence[Bar] = ()
    plots: Sequence[Plot] = ()
    names: Sequence[str] = ()

    def to_html(self) -> str:
        """Return the card as HTML in which all texts are escaped."""
        legend = list(zip(self.names, COLOURS * (1 + len(self.names) // len(COLOURS)), strict=False))
        return _template().render(card=self, legend=legend, width=WIDTH, height=HEIGHT)


@cache
def _template() -> Template:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        loader=PackageLoader("optik", "card"),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("card.html.j2")
