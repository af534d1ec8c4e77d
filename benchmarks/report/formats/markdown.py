"""The report as Markdown, for a README or a pull request: its tables, and its plots as SVG."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from benchmarks.records import RunFolder, slug
from benchmarks.report.base import Table
from benchmarks.report.figures import Board
from benchmarks.report.formats.svg import draw
from benchmarks.report.overview import overview
from benchmarks.report.run import Run
from benchmarks.report.sections import built
from benchmarks.report.shown import ShownCell, shown_table
from benchmarks.report.takeout import all_tables
from optik.plugins.files import forbid_code

MARKDOWN = "report.md"
"""Name of the report in the run folder."""

FIGURES_FOLDER = "report-figures"
"""Folder of figures in the run folder."""

_SPECIAL = re.compile(r"([\\`*_{}\[\]#|~$])")
"""Characters that have a meaning in Markdown."""


@forbid_code()
def write_markdown(folder: RunFolder) -> list[Path]:
    """Write ``report.md`` and its figures into a run folder."""
    run = Run(folder)
    figures: list[Path] = []

    def figure(board: Board) -> str:
        file = f"{FIGURES_FOLDER}/{slug(board.id)}.svg"
        folder.write_bytes(file, draw(board.at_first()))
        figures.append(folder.path / file)
        titles = ", ".join(figure.layout.title.text for figure in board.figures)
        caption = " ".join(words for words in (board.caption, board.chosen) if words)
        return f"![{marked(titles)}]({file})\n\n*{marked(caption)}*\n" if caption else f"![{marked(titles)}]({file})\n"

    tables = {table.id: table for table in all_tables(run)}
    parts = [_head(run, tables.pop("winners", None))]
    for place in ("top", "section"):
        for first, pieces in built(run, place):
            found = [thing for _, context in pieces for thing in _shown_in(context)]
            words = [
                "\n".join(map(figure, one.each("block")))
                if isinstance(one, Board)
                else markdown_of(tables.pop(one.id, one))
                for one in found
            ]
            if words:
                parts.append(f"## {marked(first.title)}\n\n" + "\n".join(words))
    if tables:
        parts.append("## Tables\n\n" + "\n".join(markdown_of(table) for table in tables.values()))
    folder.write_text(MARKDOWN, "\n".join(parts))
    return [folder.path / MARKDOWN, *figures]


def _head(run: Run, winners: Table | None) -> str:
    head = overview(run)
    words = [f"# {marked(head['title'])}\n"]
    if not head["complete"]:
        words.append("**This run is incomplete.**\n")
    if head["failed"]:
        words.append(f"**{marked(head['failed'])}**\n")
    if winners is not None:
        words.append(markdown_of(winners))
    words += [f"- {marked(finding)}" for finding in head["findings"]]
    return "\n".join(words) + "\n"


def _shown_in(context: Any) -> Iterator[Board | Table]:
    """Return the boards and tables of a section in its order, boards first."""
    found = list(_within(context))
    yield from (one for one in found if isinstance(one, Board))
    yield from (one for one in found if isinstance(one, Table))


def _within(data: Any) -> Iterator[Board | Table]:
    if isinstance(data, Board | Table):
        yield data
    elif isinstance(data, Mapping):
        for value in data.values():
            yield from _within(value)
    elif isinstance(data, list | tuple):
        for value in data:
            yield from _within(value)


def markdown_of(table: Table) -> str:
    """Return a table as Markdown, without the columns shown on request; the best value is bold."""
    shown = shown_table(table)
    columns = [(k, column) for k, column in enumerate(table.columns) if not column.aside]
    heads = [marked(f"{c.words} [{c.unit}]" if c.unit else c.words) for _, c in columns]
    lines = [
        f"**{marked(table.title)}**\n",
        f"| {' | '.join(heads)} |",
        f"| {' | '.join('---' if c.show == 'text' else '---:' for _, c in columns)} |",
        *(f"| {' | '.join(_cell(row.cells[k]) for k, _ in columns)} |" for row in shown.rows),
    ]
    return "\n".join(lines) + "\n" + (f"\n{marked(table.note)}\n" if table.note else "")


def _cell(cell: ShownCell) -> str:
    text = marked(cell.text)
    text = f"**{text}**" if cell.best else text
    return text + (f" ({marked(cell.interval)})" if cell.interval else "")


def marked(text: str) -> str:
    """Return text with Markdown's special characters escaped."""
    safe = text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return " ".join(_SPECIAL.sub(r"\\\1", safe).split())
