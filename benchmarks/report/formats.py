"""The report's other files: Markdown with figures as SVG, figures as PDF drawn by matplotlib, tables as CSV and LaTeX."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.records import RunFolder, slug
from benchmarks.report.base import Run
from benchmarks.report.boards import DASHES, SYMBOLS, Board, Json
from benchmarks.report.page import asked_table, built, failure_table, overview, winners_table
from benchmarks.report.tables import Table, csv_of, markdown_of, marked, tex_of
from optik.errors import InvalidInput, MissingDependency
from optik.plugins.files import forbid_code

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

LINE_STYLES = dict(zip(DASHES, ("-", "--", ":", "-."), strict=True))
"""Dashes of matplotlib by those of Plotly."""

MARKERS = dict(zip(SYMBOLS, "osD^P*Xp", strict=True)) | {"x-thin": "x", "circle-open": "o"}
"""Markers of matplotlib by those of Plotly."""

COLUMN_MM, PAGE_MM = 88.0, 181.0
"""Widths of a figure in one column of a journal, and across both."""

PER_ROW = 2
"""Number of figures side by side across both columns."""

PANEL_MM = 66.0
"""Height of one figure."""

TITLE_WIDTH, POINTS = 48, 8
"""Number of characters in a line of a figure's title, and the size of all text [pt]."""


PAPER_STYLE = {
    "font.size": POINTS, "axes.titlesize": POINTS, "axes.labelsize": POINTS, "xtick.labelsize": POINTS,
    "ytick.labelsize": POINTS, "legend.fontsize": POINTS, "svg.fonttype": "none", "svg.hashsalt": "optik", "pdf.fonttype": 42,
}  # fmt: skip
"""Settings of matplotlib."""


def draw(figures: Sequence[Figure], kind: str = "svg") -> bytes:
    """Return Plotly figures as one file, ``svg`` or ``pdf``; the same figures give the same bytes."""
    try:
        import matplotlib as mpl
        from matplotlib.figure import Figure as Sheet
    except ImportError:
        raise MissingDependency("matplotlib", "the figures of a report on paper", "figures") from None
    columns = min(len(figures), PER_ROW)
    rows = -(-len(figures) // columns)
    size = (COLUMN_MM if columns == 1 else PAGE_MM) / 25.4, (PANEL_MM * rows + 14.0) / 25.4
    with mpl.rc_context(PAPER_STYLE):
        return _drawn(Sheet(figsize=size, layout="constrained"), figures, rows, columns, kind)


def _drawn(sheet: Any, figures: Sequence[Figure], rows: int, columns: int, kind: str) -> bytes:
    """Draw figures on a sheet and return its file."""
    handles: dict[str, Any] = {}
    for k, figure in enumerate(figures):
        solid = any(trace.type == "scatter3d" for trace in figure.data)
        axes = sheet.add_subplot(rows, columns, k + 1, projection="3d" if solid else None)
        panel = _Panel(axes, figure.layout.to_plotly_json())
        panel.draw(trace.to_plotly_json() for trace in figure.data)
        handles = panel.handles | handles
    if handles:
        sheet.legend(
            list(handles.values()), [_words(name) for name in handles], loc="outside lower center",
            ncols=min(len(handles), 2 * columns), frameon=False,
        )  # fmt: skip
    out = io.BytesIO()
    about = (
        {"Date": None, "Creator": None} if kind == "svg" else {"CreationDate": None, "Creator": None, "Producer": None}
    )
    sheet.savefig(out, format=kind, metadata=about)
    return out.getvalue()


def colour_of(text: Any) -> Any:
    """Return a colour in matplotlib's form."""
    if isinstance(text, str) and text.startswith("rgba("):
        *rgb, alpha = (float(v) for v in text[5:-1].split(","))
        return (*(v / 255 for v in rgb), alpha)
    return text


def _words(text: str) -> str:
    """Return text that matplotlib does not interpret as a formula."""
    return text.replace("$", r"\$")


def _title(of: Json) -> str:
    return _words((of.get("title") or {}).get("text") or "")


class _Panel:
    """One figure on one pair of axes, and the handles of its legend by their names."""

    def __init__(self, axes: Any, layout: Json) -> None:
        self.axes, self.layout = axes, layout
        self.stacked: dict[str, float] = {}
        self.handles: dict[str, Any] = {}

    def draw(self, traces: Iterable[Json]) -> None:
        self.axes.set_title("\n".join(textwrap.wrap(_title(self.layout), TITLE_WIDTH)))
        kinds = {"scatter": self._line, "scatter3d": self._line_3d, "bar": self._bars, "heatmap": self._map}
        for trace in traces:
            handle = kinds[trace["type"]](trace)
            if trace.get("showlegend") and trace.get("name"):
                self.handles.setdefault(trace["name"], handle)
        if "scene" in self.layout:
            for name in "xyz":
                getattr(self.axes, f"set_{name}label")(_title(self.layout["scene"].get(f"{name}axis", {})))
            self.axes.set_aspect("equal")
            return
        for name in "xy":
            self._axis(name, self.layout.get(f"{name}axis", {}))
        for shape in self.layout.get("shapes", ()):
            self._shape(shape)
        if self.layout.get("xaxis", {}).get("showgrid", True):
            self.axes.grid(visible=True, linewidth=0.4)

    def _line(self, trace: Json) -> Any:
        y = trace["y"]
        x = trace.get("x")
        if x is None:
            x = trace.get("x0", 0) + trace.get("dx", 1) * np.arange(len(y))
        line, marker, mode = trace.get("line", {}), trace.get("marker", {}), trace.get("mode", "lines")
        colour = colour_of(line.get("color") or marker.get("color") or marker.get("line", {}).get("color") or "black")
        x, y = (values if _are_words(values) else _numbers(values) for values in (x, y))
        if trace.get("fill"):
            (area,) = self.axes.fill(
                x, y, color=colour_of(trace["fillcolor"]), alpha=trace.get("opacity", 1.0), linewidth=0
            )
            return area
        look = {
            "color": colour, "linewidth": 0.8 * line.get("width", 2) if "lines" in mode else 0,
            "linestyle": LINE_STYLES.get(line.get("dash", "solid"), "-") if "lines" in mode else "none",
            "marker": MARKERS.get(marker.get("symbol", "circle"), "o") if "markers" in mode else None,
            "markersize": 0.6 * float(marker.get("size", 6)),
            "drawstyle": "steps-post" if line.get("shape") == "hv" else "default",
        }  # fmt: skip
        if marker.get("symbol") == "circle-open" or colour == "#fff":
            look |= {"markerfacecolor": "none", "color": "black" if colour == "#fff" else colour}
        bars: Any = trace.get("error_y")
        if bars and "array" in bars:
            ends = [_numbers(bars.get("arrayminus", bars["array"])), _numbers(bars["array"])]
            return self.axes.errorbar(x, y, yerr=ends, capsize=2, elinewidth=0.7, **look)
        (drawn,) = self.axes.plot(x, y, **look)
        return drawn

    def _line_3d(self, trace: Json) -> Any:
        look: Json = trace.get("line") or trace.get("marker") or {}
        mode = trace.get("mode", "lines")
        (drawn,) = self.axes.plot(
            *(_numbers(trace[name]) for name in "xyz"), color=colour_of(look.get("color", "black")), markersize=3,
            linestyle="-" if "lines" in mode else "none", marker="o" if "markers" in mode else None,
        )  # fmt: skip
        return drawn

    def _bars(self, trace: Json) -> Any:
        names, values = [_words(str(v)) for v in trace["y"]], _numbers(trace["x"])
        left = np.array([self.stacked.get(name, 0.0) for name in names])
        drawn = self.axes.barh(names, values, left=left, color=colour_of(trace.get("marker", {}).get("color", "grey")))
        if self.layout.get("barmode") == "stack":
            self.stacked |= dict(zip(names, left + values, strict=True))
        return drawn

    def _map(self, trace: Json) -> Any:
        from matplotlib.colors import ListedColormap
        from matplotlib.patches import Patch

        z = np.ma.masked_invalid(np.asarray(trace["z"], dtype=float))
        x, y = (trace[f"{k}0"] + trace[f"d{k}"] * np.arange(size) for k, size in (("x", z.shape[1]), ("y", z.shape[0])))
        scale = trace["colorscale"]
        colours = [colour_of(one) for _, one in scale]
        named = ListedColormap(colours) if len(set(colours)) == 1 else "viridis"
        mesh = self.axes.pcolormesh(
            x, y, z, shading="nearest", vmin=trace.get("zmin"), vmax=trace.get("zmax"), cmap=named
        )
        if trace.get("showscale", True):
            bar = trace.get("colorbar", {})
            drawn = self.axes.figure.colorbar(mesh, ax=self.axes, label=_title(bar))
            if "tickvals" in bar:
                drawn.set_ticks(list(bar["tickvals"]), labels=[_plain(text) for text in bar["ticktext"]])
        return Patch(color=colours[0])

    def _axis(self, name: str, options: Json) -> None:
        axes = self.axes
        getattr(axes, f"set_{name}label")(_title(options))
        scaled = options.get("type") == "log"
        if scaled:
            getattr(axes, f"set_{name}scale")("log")
        if "tickvals" in options:
            ticks, limits = list(options["tickvals"]), getattr(axes, f"get_{name}lim")()
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
        """Draw level and upright lines, and bands; they do not widen the axes."""
        limits = self.axes.get_xlim(), self.axes.get_ylim()
        stroke = shape.get("line", {})
        if shape["type"] == "rect":
            drawn = self.axes.axhspan(shape["y0"], shape["y1"], color=colour_of(shape["fillcolor"]), linewidth=0)
        else:
            across = shape.get("xref") == "paper"
            drawn = (self.axes.axhline if across else self.axes.axvline)(
                shape["y0" if across else "x0"], color=colour_of(stroke.get("color", "grey")), linewidth=0.8,
                linestyle=LINE_STYLES.get(stroke.get("dash", "solid"), "-"),
            )  # fmt: skip
        if shape.get("showlegend") and shape.get("name"):
            self.handles.setdefault(shape["name"], drawn)
        self.axes.set_xlim(limits[0])
        self.axes.set_ylim(limits[1])


def _plain(text: str) -> str:
    """Return text with a power of ten that matplotlib writes."""
    return text.replace("10<sup>", "$10^{").replace("</sup>", "}$").replace("−", "-")


def _are_words(values: Sequence[Any]) -> bool:
    return any(isinstance(value, str) for value in values)


def _numbers(values: Sequence[float | None]) -> Any:
    return np.array([np.nan if v is None else v for v in values], dtype=float)


MARKDOWN = "report.md"
"""Name of the report in the run folder."""

FIGURES_FOLDER, TABLES_FOLDER = "report-figures", "tables"
"""Folders in the run folder."""


@forbid_code()
def write_markdown(folder: RunFolder, columns: Sequence[str] = ()) -> list[Path]:
    """Write ``report.md`` and its figures into a run folder."""
    run = Run(folder)
    figures: list[Path] = []

    def figure(board: Board) -> str:
        figures.append(_write(folder, f"{FIGURES_FOLDER}/{slug(board.id)}.svg", draw(board.at_first())))
        titles = ", ".join(figure.layout.title.text for figure in board.figures)
        caption = " ".join(words for words in (board.caption, board.chosen) if words)
        picture = f"![{marked(titles)}]({figures[-1].relative_to(folder.path).as_posix()})\n"
        return f"{picture}\n*{marked(caption)}*\n" if caption else picture

    tables = {table.id: table for table in chosen_tables(run, columns)}
    parts = [_head(run, tables.pop("winners", None))]
    for first, shown in _parts(run):
        words = [
            "\n".join(map(figure, one.each("block")))
            if isinstance(one, Board)
            else markdown_of(tables.pop(one.id, one))
            for one in shown
            if isinstance(one, Board) or not columns or one.id in tables
        ]
        if words:
            parts.append(f"## {marked(first)}\n\n" + "\n".join(words))
    if tables:
        parts.append("## Tables\n\n" + "\n".join(markdown_of(table) for table in tables.values()))
    return [_write(folder, MARKDOWN, "\n".join(parts).encode()), *figures]


@forbid_code()
def write_figures(folder: RunFolder) -> list[Path]:
    """Write ``report-figures/ID.pdf`` for every board of a run, at its initial choices."""
    boards = [one for _, shown in _parts(Run(folder)) for one in shown if isinstance(one, Board)]
    return [
        _write(folder, f"{FIGURES_FOLDER}/{slug(one.id)}.pdf", draw(one.at_first(), "pdf"))
        for board in boards
        for one in board.each("block")
    ]


@forbid_code()
def write_csv(folder: RunFolder, columns: Sequence[str] = ()) -> list[Path]:
    """Write ``tables/ID.csv`` for every table of a run that has one of some columns."""
    return _write_tables(folder, columns, "csv", csv_of)


@forbid_code()
def write_tex(folder: RunFolder, columns: Sequence[str] = ()) -> list[Path]:
    """Write ``tables/ID.tex`` for every table of a run that has one of some columns."""
    return _write_tables(folder, columns, "tex", tex_of)


def _write_tables(
    folder: RunFolder, columns: Sequence[str], ending: str, text_of: Callable[[Table], str]
) -> list[Path]:
    run = Run(folder)
    tables = {f"{TABLES_FOLDER}/{slug(table.id)}.{ending}": table for table in chosen_tables(run, columns)}
    for table in all_tables(run):  # a table of an earlier report beside these would be of other columns
        name = f"{TABLES_FOLDER}/{slug(table.id)}.{ending}"
        if name not in tables:
            (folder.path / name).unlink(missing_ok=True)
    return [_write(folder, name, text_of(table).encode()) for name, table in tables.items()]


def _write(folder: RunFolder, name: str, content: bytes) -> Path:
    folder.write_bytes(name, content)
    return folder.path / name


# ---------------------------------------------------------------- tables and figures of a run


def chosen_tables(run: Run, columns: Sequence[str] = ()) -> list[Table]:
    """Return every table; with `columns` those that have one of them, and only these columns."""
    tables = all_tables(run)
    if not columns:
        return tables
    known = {column.key for table in tables for column in table.columns}
    for key in columns:
        if key not in known:
            raise InvalidInput("columns", repr(key), f"keys of columns: {', '.join(sorted(known))}")
    narrow = [table.only(columns) for table in tables]
    return [table for table in narrow if set(columns) & {column.key for column in table.columns}]


def all_tables(run: Run) -> list[Table]:
    """Return every table, each id once: winners, tables of the kinds with their failures, acceptance targets."""
    found = [winners_table(run)]
    for kind in run.suite.kinds:
        found += [*run.tables_of(kind.name), failure_table(kind, run)]
    found.append(asked_table(run))
    return list({table.id: table for table in found if table is not None}.values())


def _parts(run: Run) -> Iterator[tuple[str, list[Board | Table]]]:
    """Return the titles of the sections with their boards, then their tables."""
    for place in ("top", "section"):
        for first, pieces in built(run, place):
            found = [list(_within(context)) for _, context in pieces]
            yield (
                first.title,
                [one for part in found for kind in (Board, Table) for one in part if isinstance(one, kind)],
            )


def _within(data: Any) -> Iterator[Board | Table]:
    if isinstance(data, Board | Table):
        yield data
    elif isinstance(data, Mapping):
        for value in data.values():
            yield from _within(value)
    elif isinstance(data, list | tuple):
        for value in data:
            yield from _within(value)


def _head(run: Run, winners: Table | None) -> str:
    head = overview(run)
    words = [f"# {marked(head['title'])}\n"]
    if not head["complete"]:
        words.append("**This run is incomplete.**\n")
    if head["failed"]:
        words.append(f"**{marked(head['failed'])}**\n")
    if head["paper"]:
        paper = head["paper"]
        words.append(
            f"The paper: *{marked(paper['title'])}*. Its method is {paper['method']}. Verdict: {paper['verdict']}\n"
        )
    if winners is not None:
        words.append(markdown_of(winners))
    words += [f"- {marked(finding)}" for finding in head["findings"]]
    return "\n".join(words) + "\n"
