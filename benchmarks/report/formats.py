"""The report's tables as Markdown, CSV and LaTeX."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.records import RunFolder, slug
from benchmarks.report.base import Run
from benchmarks.report.page import asked_table, built, failure_table, overview, winners_table
from benchmarks.report.tables import Table, csv_of, markdown_of, marked, tex_of
from optik.errors import InvalidInput
from optik.plugins.files import forbid_code

MARKDOWN = "report.md"
"""Name of the report in the run folder."""

TABLES_FOLDER = "tables"
"""Folder in the run folder."""


@forbid_code()
def write_markdown(folder: RunFolder, columns: Sequence[str] = ()) -> list[Path]:
    """Write ``report.md`` into a run folder."""
    run = Run(folder)
    tables = {table.id: table for table in chosen_tables(run, columns)}
    parts = [_head(run, tables.pop("winners", None))]
    for first, shown in _parts(run):
        words = [markdown_of(tables.pop(one.id, one)) for one in shown if not columns or one.id in tables]
        if words:
            parts.append(f"## {marked(first)}\n\n" + "\n".join(words))
    if tables:
        parts.append("## Tables\n\n" + "\n".join(markdown_of(table) for table in tables.values()))
    return [_write(folder, MARKDOWN, "\n".join(parts).encode())]


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


# ---------------------------------------------------------------- tables of a run


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


def _parts(run: Run) -> Iterator[tuple[str, list[Table]]]:
    """Return the titles of the sections with their tables."""
    for place in ("top", "section"):
        for first, pieces in built(run, place):
            yield first.title, [table for _, context in pieces for table in _within(context)]


def _within(data: Any) -> Iterator[Table]:
    if isinstance(data, Table):
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
