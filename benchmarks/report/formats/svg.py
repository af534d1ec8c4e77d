"""Boards of the page as SVG by matplotlib: their plots side by side, at the initial choices."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Callable, Sequence
from importlib.resources import files
from typing import Any

import numpy as np

from benchmarks.report.board import Board, Json, Key, Plot, When
from benchmarks.report.figures import DASHES, SYMBOLS
from optik.errors import MissingDependency

LINE_STYLES = dict(zip(DASHES, ("-", "--", ":", "-."), strict=True)) | {"longdash": (0, (8, 3)), "longdashdot": "-."}
"""Dashes of matplotlib by those of Plotly."""

MARKERS = dict(zip(SYMBOLS, "osD^P*Xp", strict=True)) | {"x-thin": "x", "circle-open": "o"}
"""Markers of matplotlib by those of Plotly."""

PER_ROW = 3
"""Number of plots side by side."""

TITLE_WIDTH = 52
"""Number of characters in a line of a plot's title."""

PANEL_INCHES = (4.6, 3.6)
"""Width and height of one plot."""


def draw(board: Board) -> str:
    """Return a board as SVG; the same board gives the same text."""
    try:
        import matplotlib as mpl
        from matplotlib.backends.backend_svg import FigureCanvasSVG
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingDependency("matplotlib", "the figures of a report in Markdown", "figures") from None
    columns = min(len(board.plots), PER_ROW)
    rows = -(-len(board.plots) // columns)
    wide = PANEL_INCHES[0] * (columns if columns > 1 else 1.4)
    figure = Figure(figsize=(wide, PANEL_INCHES[1] * rows + 0.7), layout="constrained")
    FigureCanvasSVG(figure)
    for k, plot in enumerate(board.plots):
        solid = "scene" in plot.layout
        _Panel(figure.add_subplot(rows, columns, k + 1, projection="3d" if solid else None), plot, board.state).draw()
    _legend(figure, board)
    out = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": board.id}):
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return out.getvalue()


def fits(when: When, state: Json) -> bool:
    """Return whether something is shown at these choices."""
    return all(state.get(key) in values for key, values in when.items())


def colour_of(text: Any) -> Any:
    """Return a colour in matplotlib's form."""
    if isinstance(text, str) and (found := re.fullmatch(r"var\((--[\w-]+)\)", text)):
        text = _theme()[found[1]]
    if isinstance(text, str) and text.startswith("rgba("):
        *rgb, alpha = (float(v) for v in text[5:-1].split(","))
        return (*(v / 255 for v in rgb), alpha)
    return text


def _theme() -> dict[str, str]:
    """Return variables of the page's light theme."""
    style = files("benchmarks.report").joinpath("templates", "page.css").read_text(encoding="utf-8")
    return {name: value.strip() for name, value in re.findall(r"(--[\w-]+):\s*([^;]+);", style.split("@media")[0])}


def _words(text: str) -> str:
    """Return text that matplotlib does not interpret as a formula."""
    return text.replace("$", r"\$")


def _merged(into: Json, other: Json) -> Json:
    out = dict(into)
    for key, value in other.items():
        out[key] = _merged(out[key], value) if isinstance(value, dict) and isinstance(out.get(key), dict) else value
    return out


class _Panel:
    """One plot on one pair of axes."""

    def __init__(self, axes: Any, plot: Plot, state: Json) -> None:
        self.axes, self.state, self.title = axes, state, plot.title
        data = plot.to_data()
        self.layout: Json = data["layout"]
        for entry in data.get("layouts", ()):
            if fits(entry["when"], state):
                self.layout = _merged(self.layout, entry["layout"])
        self.traces = [self._at(entry) for entry in data.get("traces", ()) if fits(entry.get("when", {}), state)]
        self.stacked: Any = {}

    def _at(self, entry: Json) -> Json:
        trace: Json = entry["trace"]
        for variant in entry.get("variants", ()):
            if fits(variant["when"], self.state):
                trace = _merged(trace, variant["patch"])
        return trace

    def draw(self) -> None:
        self.axes.set_title("\n".join(textwrap.wrap(_words(self.title), TITLE_WIDTH)), fontsize=10)
        kinds: dict[str, Callable[[Json], None]] = {
            "scatter": self._line, "scatter3d": self._line_3d, "bar": self._bars, "heatmap": self._map,
        }  # fmt: skip
        for trace in self.traces:
            kinds[trace.get("type", "scatter")](trace)
        if "scene" in self.layout:
            for name in "xyz":
                title = self.layout["scene"].get(f"{name}axis", {}).get("title", {}).get("text", "")
                getattr(self.axes, f"set_{name}label")(_words(title))
            self.axes.set_aspect("equal")
            return
        for name in "xy":
            self._axis(name, self.layout.get(f"{name}axis", {}))
        for shape in self.layout.get("shapes", ()):
            self._shape(shape)
        if self.layout.get("xaxis", {}).get("showgrid", True):
            self.axes.grid(visible=True, linewidth=0.4)

    def _line(self, trace: Json) -> None:
        y = trace.get("y", ())
        x = trace.get("x")
        if x is None:
            x = trace.get("x0", 0) + trace.get("dx", 1) * np.arange(len(y))
        line, marker, mode = trace.get("line", {}), trace.get("marker", {}), trace.get("mode", "lines")
        colour = colour_of(line.get("color") or marker.get("color") or marker.get("line", {}).get("color") or "black")
        look = {
            "color": colour, "linewidth": 0.8 * line.get("width", 2) if "lines" in mode else 0,
            "linestyle": LINE_STYLES.get(line.get("dash", "solid"), "-") if "lines" in mode else "none",
            "marker": MARKERS.get(marker.get("symbol", "circle"), "o") if "markers" in mode else None,
            "markersize": 0.6 * float(marker.get("size", 6)),
            "drawstyle": "steps-post" if line.get("shape") == "hv" else "default",
        }  # fmt: skip
        x, y = (values if _are_words(values) else _numbers(values) for values in (x, y))
        bars: Any = trace.get("error_y")
        if bars and "array" in bars:
            ends = [_numbers(bars.get("arrayminus", bars["array"])), _numbers(bars["array"])]
            self.axes.errorbar(x, y, yerr=ends, capsize=2, elinewidth=0.7, **look)
        else:
            self.axes.plot(x, y, **look)

    def _line_3d(self, trace: Json) -> None:
        look: Json = trace.get("line") or trace.get("marker") or {}
        colour = colour_of(look.get("color", "black"))
        points = [_numbers(trace[name]) for name in "xyz"]
        mode = trace.get("mode", "lines")
        style = "-" if "lines" in mode else "none"
        self.axes.plot(*points, color=colour, linestyle=style, marker="o" if "markers" in mode else None, markersize=3)

    def _bars(self, trace: Json) -> None:
        names, values = [_words(str(v)) for v in trace["y"]], _numbers(trace["x"])
        left = np.array([self.stacked.get(name, 0.0) for name in names])
        self.axes.barh(names, values, left=left, color=colour_of(trace.get("marker", {}).get("color", "grey")))
        if self.layout.get("barmode") == "stack":
            self.stacked |= dict(zip(names, left + values, strict=True))

    def _map(self, trace: Json) -> None:
        logarithmic = trace.get("meta") == "log10"
        z = np.array([_numbers(row) for row in trace["customdata" if logarithmic else "z"]])
        z = np.log10(np.maximum(z, 1e-12)) if logarithmic else z
        x, y = (
            _numbers(trace[name])
            if name in trace
            else trace.get(f"{name}0", 0) + trace.get(f"d{name}", 1) * np.arange(size)
            for name, size in (("x", z.shape[1]), ("y", z.shape[0]))
        )
        scale = trace.get("colorscale", "Viridis")
        if isinstance(scale, str):
            look: Json = {"cmap": scale.lower()}
        else:
            from matplotlib.colors import ListedColormap

            look = {"cmap": ListedColormap([colour_of(colour) for _, colour in scale])}
        mesh = self.axes.pcolormesh(
            x, y, np.ma.masked_invalid(z), shading="nearest", vmin=trace.get("zmin"), vmax=trace.get("zmax"), **look
        )
        if trace.get("showscale", True):
            bar = trace.get("colorbar", {})
            drawn = self.axes.figure.colorbar(mesh, ax=self.axes, label=_words(bar.get("title", {}).get("text", "")))
            if "tickvals" in bar:
                drawn.set_ticks(bar["tickvals"], labels=bar.get("ticktext", [str(v) for v in bar["tickvals"]]))

    def _axis(self, name: str, options: Json) -> None:
        axes = self.axes
        getattr(axes, f"set_{name}label")(_words(options.get("title", {}).get("text", "")))
        scaled = options.get("type") == "log"
        if scaled:
            getattr(axes, f"set_{name}scale")("log")
        if "tickvals" in options:
            ticks, limits = options["tickvals"], getattr(axes, f"get_{name}lim")()
            getattr(axes, f"set_{name}ticks")(ticks, labels=options.get("ticktext", [f"{v:g}" for v in ticks]))
            getattr(axes, f"{name}axis").minorticks_off()
            getattr(axes, f"set_{name}lim")(limits)  # ticks beyond the values do not widen it
        if "range" in options and options.get("type") != "category":
            low, high = options["range"]
            getattr(axes, f"set_{name}lim")(*((10.0**low, 10.0**high) if scaled else (low, high)))
        if options.get("autorange") == "reversed":
            getattr(axes, f"invert_{name}axis")()
        if options.get("scaleanchor"):
            axes.set_aspect("equal")

    def _shape(self, shape: Json) -> None:
        """Draw level lines and bands; they do not widen the axes."""
        if shape.get("xref") != "paper":
            return
        limits = self.axes.get_ylim()
        stroke = shape.get("line", {})
        if shape["type"] == "line" and shape["y0"] == shape["y1"]:
            style = LINE_STYLES.get(stroke.get("dash", "solid"), "-")
            self.axes.axhline(shape["y0"], color=colour_of(stroke.get("color", "grey")), linewidth=0.8, linestyle=style)
        elif shape["type"] == "rect":
            self.axes.axhspan(shape["y0"], shape["y1"], color=colour_of(shape.get("fillcolor", "#eee")), zorder=0)
        self.axes.set_ylim(limits)


def _legend(figure: Any, board: Board) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    def handle(key: Key) -> Any:
        colour = colour_of(key.colour)
        if key.style == "fill" and not key.dash:
            return Patch(color=colour)
        dash = key.dash or {"dashed": "dot"}.get(key.style, "solid")
        alone = key.style in ("dot", "cross", "ring") and not key.dash
        marker = MARKERS.get(key.symbol) or {"dot": "o", "cross": "x", "ring": "o"}.get(key.style)
        return Line2D(
            [], [], color=colour, linestyle="none" if alone else LINE_STYLES[dash], marker=marker, markersize=5
        )

    keys = [key for key in board.legend if fits(key.when, board.state)]
    if keys:
        figure.legend(
            [handle(key) for key in keys], [_words(key.label) for key in keys], loc="outside lower center", fontsize=8,
            ncols=min(len(keys), 3 * len(board.plots[:PER_ROW])), frameon=False,
        )  # fmt: skip


def _are_words(values: Sequence[Any]) -> bool:
    return any(isinstance(value, str) for value in values)


def _numbers(values: Sequence[float | None]) -> Any:
    return np.array([np.nan if v is None else v for v in values], dtype=float)
