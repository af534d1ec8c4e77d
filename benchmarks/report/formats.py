"""The report's other files: Markdown with figures as SVG, figures as PDF, and tables as CSV and LaTeX, in the run folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.records import RunFolder, slug
from benchmarks.report.boards import Board
from benchmarks.report.drawing import draw
from benchmarks.report.run import Run
from benchmarks.report.sections import asked_table, built, failure_table
from benchmarks.report.tables import Table, csv_of, markdown_of, marked, tex_of
from benchmarks.report.winners import overview, winners_table
from optik.errors import InvalidInput
from optik.plugins.files import forbid_code

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
    tables = chosen_tables(Run(folder), columns)
    return [_write(folder, f"{TABLES_FOLDER}/{slug(t.id)}.{ending}", text_of(t).encode()) for t in tables]


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
    if winners is not None:
        words.append(markdown_of(winners))
    words += [f"- {marked(finding)}" for finding in head["findings"]]
    return "\n".join(words) + "\n"
