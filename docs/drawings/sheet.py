"""Sheet: an SVG drawing of lines, boxes and text on its own background, for light and dark pages."""

from __future__ import annotations

from collections.abc import Iterable
from math import hypot
from xml.etree import ElementTree

import numpy as np

from optik.types import Array

WIDTH = 480.0
"""Width of every drawing [px]: on a narrow screen of 360 px its text is still 10 px high."""

MARGIN = 16.0
"""Margin of a drawing [px]."""

FONT = 13.0
"""Height of the text [px]."""

LETTER = 0.53
"""Mean width of a letter over its height in common sans-serif fonts [1], to break lines and to place text."""

HEAD = 8.0
"""Length of an arrow's head [px]."""

LIGHT = {
    "page": "#ffffff", "ink": "#1f2328", "soft": "#59636e", "box": "#f3f5f8", "edge": "#8c959f", "body": "#cfd6de",
    "grid": "#b3bcc6", "beam": "#cf222e", "x": "#9a4a00", "y": "#1a7f37", "z": "#0969da",
}  # fmt: skip
"""Colours on a light page: background, text, explanations, boxes, edges, the arm's body, the graph paper, the beam, axes."""

DARK = {
    "page": "#15181c", "ink": "#e6e8eb", "soft": "#a3adb8", "box": "#20262d", "edge": "#6b7682", "body": "#4a5561",
    "grid": "#505b67", "beam": "#ff6b6b", "x": "#f0a35e", "y": "#56d364", "z": "#6cb6ff",
}  # fmt: skip
"""Colours on a dark page."""

Point = tuple[float, float] | Array
"""A position on the sheet, from the upper left corner [px]."""


class Sheet:
    """A drawing that grows downwards. Colours are named, see `LIGHT`."""

    def __init__(self, title: str) -> None:
        self.title = title
        self._parts: list[ElementTree.Element] = []

    def _add(self, tag: str, **attributes: str | float) -> ElementTree.Element:
        shown = {
            name.replace("_", "-"): value if isinstance(value, str) else _px(value)
            for name, value in attributes.items()
        }
        self._parts.append(ElementTree.Element(tag, shown))
        return self._parts[-1]

    def line(
        self,
        points: Iterable[Point],
        colour: str = "ink",
        *,
        width: float = 1.5,
        dashed: bool = False,
        closed: bool = False,
    ) -> None:
        """Draw straight lines between points."""
        drawn = " ".join(f"{_px(x)},{_px(y)}" for x, y in points)
        part = self._add("polygon" if closed else "polyline", points=drawn, stroke_width=width)
        part.set("class", f"d-{colour}-line" + (" d-filled" if closed else ""))
        if dashed:
            part.set("stroke-dasharray", "5 4")

    def arrow(self, points: Iterable[Point], colour: str = "ink", *, width: float = 1.5) -> None:
        """Draw straight lines between points, and a head at the end."""
        *before, (x0, y0), (x1, y1) = [(float(x), float(y)) for x, y in points]
        length = hypot(x1 - x0, y1 - y0)
        if length == 0.0:
            return
        ux, uy, head = (x1 - x0) / length, (y1 - y0) / length, min(HEAD, length)
        back = (x1 - head * ux, y1 - head * uy)
        self.line([*before, (x0, y0), back], colour, width=width)
        half = 0.42 * head
        corners = [(x1, y1), (back[0] - half * uy, back[1] + half * ux), (back[0] + half * uy, back[1] - half * ux)]
        part = self._add("polygon", points=" ".join(f"{_px(x)},{_px(y)}" for x, y in corners))
        part.set("class", f"d-{colour}")

    def dot(self, at: Point, colour: str = "ink", radius: float = 3.0) -> None:
        """Draw a filled circle."""
        self._add("circle", cx=float(at[0]), cy=float(at[1]), r=radius).set("class", f"d-{colour}")

    def box(self, x: float, y: float, width: float, height: float) -> None:
        """Draw a box with round corners."""
        self._add("rect", x=x, y=y, width=width, height=height, rx=6.0).set("class", "d-edge-line d-filled")

    def words(
        self, at: Point, text: str, colour: str = "ink",
        *, by: tuple[float, float] = (0.0, 0.0), anchor: str = "start", bold: bool = False,
    ) -> None:  # fmt: skip
        """Write a line of text, moved so that it is inside the sheet."""
        x, width = float(at[0]) + by[0], text_width(text)
        before = width * {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor]
        x = max(min(x, WIDTH - width + before), before)
        part = self._add("text", x=x, y=float(at[1]) + by[1], text_anchor=anchor)
        part.set("class", f"d-{colour}" + (" d-bold" if bold else ""))
        part.text = text

    def svg(self, height: float) -> str:
        """Return the drawing as text of an SVG file."""
        size = {"width": _px(WIDTH), "height": _px(height), "viewBox": f"0 0 {_px(WIDTH)} {_px(height)}"}
        root = ElementTree.Element("svg", {"xmlns": "http://www.w3.org/2000/svg", **size, "role": "img"})
        ElementTree.SubElement(root, "title").text = self.title
        ElementTree.SubElement(root, "style").text = _style()
        ground = {"class": "d-page", "width": "100%", "height": "100%", "rx": "8"}
        ElementTree.SubElement(root, "rect", ground)
        root.extend(self._parts)
        ElementTree.indent(root)
        return ElementTree.tostring(root, encoding="unicode") + "\n"


def break_lines(text: str, width: float) -> list[str]:
    """Return a text as lines of at most a width [px]."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and text_width(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def text_width(text: str) -> float:
    """Return the approximate width of a text [px]."""
    return len(text) * LETTER * FONT


def _px(value: float) -> str:
    """Return a length to a tenth of a pixel, without a sign before zero."""
    return f"{np.round(float(value), 1) + 0.0:g}"


def _style() -> str:
    """Return the style sheet: fonts, and colours for light and dark pages."""
    words = f"text {{ font: {_px(FONT)}px system-ui, 'Segoe UI', Roboto, Arial, sans-serif; paint-order: stroke }}"
    rules = [
        words,
        ".d-bold { font-weight: 600 }",
        "polyline, polygon { stroke-linecap: round; stroke-linejoin: round }",
    ]
    return "\n".join([*rules, *_colours(LIGHT), "@media (prefers-color-scheme: dark) {", *_colours(DARK), "}"])


def _colours(colours: dict[str, str]) -> list[str]:
    rules = [f"text {{ stroke: {colours['page']}; stroke-width: 3px }}"]
    for name, colour in colours.items():
        rules += [f".d-{name} {{ fill: {colour} }}", f".d-{name}-line {{ stroke: {colour}; fill: none }}"]
    return [*rules, f".d-filled {{ fill: {colours['box']} }}"]
