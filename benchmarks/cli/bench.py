"""`optik bench` and `optik demo`: list, check and run suites, and write their reports."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from benchmarks.cli.reports import add_reports, bench_report
from benchmarks.cli.running import AllowPlugins, Dask, PartTimeout, Workers, run_with_progress
from benchmarks.cli.shared import AsJson, command, err_console, load_or_error, out_console, print_json
from benchmarks.cli.suites import add_suites

DEMO_WORKERS = min(2, os.cpu_count() or 1)
"""Processes of the demo: two halve the time until the report; timed parts run alone."""

bench_app = typer.Typer(help="Compare methods: run a suite, write its report, list the suites.", no_args_is_help=True)

add_reports(bench_app)
add_suites(bench_app)


@command(bench_app, "list")
def bench_list(as_json: AsJson = False) -> None:
    """List the suites of optik and of installed packages, with the error of each that cannot be read."""
    from benchmarks.suite import SUITES, load_suite
    from optik.registry import names

    found = {name: load_or_error(load_suite, name) for name in names(SUITES)}
    if as_json:
        print_json([_suite_row(name, suite) for name, suite in found.items()])
        return
    table = Table("suite", "title", "blocks")
    for name, suite in found.items():
        if isinstance(suite, Exception):
            table.add_row(name, escape(f"error: {suite}"))
            continue
        blocks = (f"{kind.title}: {', '.join(b.id for b in suite.of(kind.name))}" for kind in suite.kinds)
        table.add_row(suite.name, escape(suite.title), escape("\n".join(blocks)))
    out_console.print(table)


def _suite_row(name: str, suite: Any) -> dict[str, Any]:
    """Return a suite, or its error, as plain data for ``optik bench list --json``."""
    if isinstance(suite, Exception):
        return {"name": name, "error": str(suite)}
    return {"name": name, "title": suite.title, "fingerprint": suite.fingerprint, "settings": suite.settings}


@command(bench_app, "run")
def bench_run(
    suite: Annotated[str, typer.Argument(help="A name from `optik bench list`, or a TOML file.")],
    out: Annotated[
        Path, typer.Option(help="Folder of the run: new, empty, or with an interrupted run of the same suite.")
    ],
    workers: Workers = 1,
    dask: Dask = "",
    part_timeout: PartTimeout = None,
    allow_plugins: AllowPlugins = False,
    report: Annotated[bool, typer.Option("--report", help="Also write the report.")] = False,
    as_json: AsJson = False,
) -> None:
    """Run a suite. Interrupted? Repeat the command to resume.

    Single calls are always timed in one process. Exit status: 0 if the run is complete; 1 if a part
    failed; 2 for wrong arguments or a folder that cannot be written; 130 after Ctrl-C.
    """
    folder = run_with_progress(suite, out, workers, allow_plugins, dask, part_timeout)
    manifest = folder.manifest()
    if report:
        bench_report(out, as_json=as_json)
    elif as_json:
        print_json(manifest)
    else:
        out_console.print(
            f"run written to {out}; for its report: optik bench report {shlex.quote(str(out))}",
            highlight=False,
            soft_wrap=True,
        )
    if not manifest["complete"]:
        raise typer.Exit(1)


def demo(
    out: Annotated[Path, typer.Option(help="Folder of the run and the report.")] = Path("optik-demo"),
    workers: Workers = DEMO_WORKERS,
    as_json: AsJson = False,
) -> None:
    """Compare the IK methods and time laws on the paper's workspace and line: run the suite `paper` and write its report."""
    from benchmarks.experiments.claims import judge
    from benchmarks.report import write_report

    folder = run_with_progress("paper", out, workers)
    with err_console.status("writing the report"):
        page = write_report(folder)
    findings = judge(folder)
    if as_json:
        print_json({"report": str(page), "claims": [{"claim": f.claim, "verdict": f.verdict} for f in findings]})
        return
    table = Table("", "the paper's claim", "verdict")
    for f in findings:
        table.add_row(f.key, f.claim, f.verdict)
    out_console.print(table)
    out_console.print(f"report: {page}", highlight=False, soft_wrap=True)
