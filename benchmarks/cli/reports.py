"""`optik bench report` and `optik bench compare`: reports of a run, and differences between two runs."""

from __future__ import annotations

import json
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from benchmarks.cli.shared import AsJson, command, err_console, out_console, print_json

if TYPE_CHECKING:
    from benchmarks.records import RunFolder
    from benchmarks.report.compare import Comparison


MOST_SETTINGS = 10
"""Largest number of different settings that `optik bench compare` prints without ``--all``."""


class Format(StrEnum):
    """Formats of a report."""

    HTML = "html"
    MD = "md"
    CSV = "csv"
    TEX = "tex"


def add_reports(app: typer.Typer) -> None:
    """Add the commands of this module to an app."""
    command(app, "report")(bench_report)
    command(app, "compare")(bench_compare)


def bench_report(
    run: Annotated[Path, typer.Argument(help="Folder of a run.")],
    format: Annotated[
        Format, typer.Option(help="html: one page; md: report.md with figures; csv or tex: one file per table.")
    ] = Format.HTML,
    as_json: AsJson = False,
) -> None:
    """Write the report of a run into its folder: one HTML page that works offline, or Markdown, CSV or LaTeX."""
    from benchmarks.records import RunFolder

    with err_console.status("writing the report"):
        written = _writer(format)(RunFolder(run))
    if as_json:
        print_json({"report": str(written[0]) if written else None, "files": [str(path) for path in written]})
    elif not written:
        out_console.print("no tables written: no part of this run is finished", highlight=False)
    elif format in (Format.HTML, Format.MD):
        out_console.print(f"report: {written[0]}", highlight=False, markup=False, soft_wrap=True)
    else:
        words = f"{len(written)} tables in {written[0].parent}"
        out_console.print(words, highlight=False, markup=False, soft_wrap=True)


def _writer(format: Format) -> Callable[[RunFolder], list[Path]]:
    """Return the function that writes a format."""
    if format is Format.MD:
        from benchmarks.report.formats.markdown import write_markdown

        return write_markdown
    if format is Format.CSV:
        from benchmarks.report.formats.tables_csv import write_csv

        return write_csv
    if format is Format.TEX:
        from benchmarks.report.formats.tex import write_tex

        return write_tex
    from benchmarks.report import write_report

    return lambda folder: [write_report(folder)]


def bench_compare(
    first: Annotated[Path, typer.Argument(metavar="A", help="Folder of the first run.")],
    second: Annotated[Path, typer.Argument(metavar="B", help="Folder of a second run of the same blocks.")],
    threshold: Annotated[
        float,
        typer.Option(
            min=0.0, help="Exit with status 1 if B is worse by more: percent of a time, percentage points of a rate."
        ),
    ] = 5.0,
    show_all: Annotated[bool, typer.Option("--all", help="Also show differences within noise.")] = False,
    as_json: AsJson = False,
) -> None:
    """Compare two runs of the same blocks: better, worse or within noise.

    Equal problems are compared in pairs by McNemar's and Wilcoxon's tests with Holm's correction. A time must also differ
    by more than the spread between rounds. The exit status is 1 if B is worse than A by more than the threshold.
    """
    from benchmarks.records import RunFolder
    from benchmarks.report.compare import as_data, compare_runs
    from benchmarks.report.run import Run

    found = compare_runs(Run(RunFolder(first)), Run(RunFolder(second)))
    worse = found.worse_than(threshold)
    if as_json:
        data = {"a": str(first), "b": str(second), "threshold": threshold, "worse_past_threshold": len(worse)}
        data |= {"differences": [as_data(d) for d in found.differences], "left_out": list(found.left_out)}
        print_json(data | {"settings": [one._asdict() for one in found.settings]})
    else:
        _print_differences(found, len(worse), threshold, show_all)
    if worse:
        raise typer.Exit(1)


def _setting(value: Any) -> str:
    """Return a setting on one line, as JSON; "not set" for None."""
    text = "not set" if value is None else json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 80 else f"{text[:79]}…"


def _print_differences(found: Comparison, worse: int, threshold: float, show_all: bool) -> None:
    """Print a comparison."""
    from benchmarks.report.numbers import number

    table = Table("block", "method", "measure", "A", "B", "change", "")
    looks = {"better": "green", "worse": "red"}
    for d in found.differences:
        if show_all or d.verdict in looks:
            change = f"{d.change:+.2f} {'points' if d.unit == '%' else '%'}"
            unit = f" [{d.unit}]" if d.unit else ""
            cells = (d.block, d.label, f"{d.measure}{unit}", number(d.a, 4), number(d.b, 4), change, d.verdict)
            table.add_row(*map(escape, cells), style=looks.get(d.verdict))
    if table.row_count:
        out_console.print(table)
    for key, a, b in found.settings[: None if show_all else MOST_SETTINGS]:
        words = f"setting {key}: {_setting(a)} in A, {_setting(b)} in B"
        out_console.print(words, style="yellow", highlight=False, markup=False, soft_wrap=True)
    if len(found.settings) > MOST_SETTINGS and not show_all:
        out_console.print(f"{len(found.settings) - MOST_SETTINGS} more settings differ; --all shows them")
    for words in found.left_out:
        out_console.print(f"not compared: {words}", highlight=False, markup=False, soft_wrap=True)
    counts = [f"{sum(d.verdict == v for d in found.differences)} {v}" for v in ("better", "worse", "within noise")]
    words = f"{', '.join(counts)}; worse by more than {threshold:g}: {worse}"
    out_console.print(words, highlight=False, markup=False, soft_wrap=True)
