"""`optik bench run`, `report` and `compare`, and `optik demo`: runs of suites with progress, reports, differences."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.table import Table

from benchmarks.cli.command import JsonCommand, argument, err_console, option, out_console, print_json
from optik.errors import InvalidInput

if TYPE_CHECKING:
    from rich.progress import Progress

    from benchmarks.records import RunFolder
    from benchmarks.report.compare import Comparison

DEMO_WORKERS = min(2, os.cpu_count() or 1)
"""Processes of the demo: two halve the time until the report; timed parts run alone."""

LINE_SECONDS = 10.0
"""Interval between two lines of progress without a bar [s]: a few hundred lines an hour."""

WIDE_ENOUGH = 70
"""Least number of terminal columns for the bar."""

FEWEST_PARTS = 3
"""Least number of finished parts for an estimate of the time left."""

SPEED_SECONDS = 600.0
"""Time over which the speed is averaged [s]."""

MOST_SETTINGS = 10
"""Largest number of different settings that `optik bench compare` prints without ``--all``."""

Tell = Callable[[int, int, str], None]
"""Type of a progress callback, as `benchmarks.run.session.Progress`."""

WORKERS_HELP = "Number of processes. It does not change results, only measured times of plans."
"""Help of ``--workers``."""


# ---------------------------------------------------------------- optik bench run, optik demo


@dataclass(frozen=True, kw_only=True)
class RunCommand(JsonCommand):
    """Run a suite. Interrupted? Repeat the command to resume.

    Single calls are always timed in one process. Exit status: 0 if the run is complete, also where
    a method failed, whose rows say so; 1 if rows are missing; 2 for wrong arguments or a folder that
    cannot be written; 130 after Ctrl-C.
    """

    suite: str = argument("SUITE", "A name from `optik bench list`, or a TOML file.", "benchmarks.suites")
    out: Path = option("Options", "Folder of the run: new, empty, or with an interrupted run of the same suite.", ...)
    workers: int = option("Options", WORKERS_HELP, 1)
    part_timeout: float | None = option(
        "Options", "Time limit of a part in a worker process. [default: 1800 with --workers]", metavar="SECONDS"
    )
    allow_plugins: bool = option(
        "Options",
        "Run the Python files that the suite names; `optik bench check` lists them.",
        False,
        "--allow-plugins",
    )
    against: str = option(
        "Options",
        "Interpreter of another version of optik. Each timed block runs alternately in fresh processes of both interpreters, "
        "until the 95 % interval of the median ratio is narrower than 3 % or each has had 20. The other run is written to "
        "RUN-against, and this run is compared with it.",
        "",
        metavar="PYTHON",
    )
    report: bool = option("Output", "Also write the report.", False, "--report")

    def run(self) -> None:
        """Run the suite, and write its report if requested."""
        if self.against and shutil.which(self.against) is None:
            raise InvalidInput("--against", self.against, "a Python interpreter with optik")
        manifest = self.run_with_progress().manifest()
        if self.against:
            self._run_against(
                os.path.abspath(shutil.which(self.against) or "")
            )  # a link, by which it finds its packages
            return
        if self.report:
            ReportCommand(folder=self.out, as_json=self.as_json).run()
        elif self.as_json:
            print_json(manifest)
        else:
            words = f"run written to {self.out}; for its report: optik bench report {shlex.quote(str(self.out))}"
            out_console.print(words, soft_wrap=True)
        if not manifest["complete"]:
            raise typer.Exit(1)

    def _run_against(self, python: str) -> None:
        """Run the suite by the other interpreter, too, then its timed blocks alternately, and compare the runs."""
        from benchmarks.blocks.contest import run_python
        from benchmarks.records import RunFolder
        from benchmarks.report.compare import is_settled
        from benchmarks.run.against import run_alternately
        from benchmarks.suite import SUITES, load_suite
        from optik.registry import data_file

        file, other = data_file(SUITES, self.suite, "suite").absolute(), self.out.with_name(f"{self.out.name}-against")
        words = ["-m", "benchmarks.cli", "bench", "run", str(file), "--out", str(other)]
        run_python(python, words + ["--allow-plugins"] * self.allow_plugins, f"{self.against}, {self.suite}")
        suite, folders = (
            load_suite(self.suite, allow_plugins=self.allow_plugins),
            (RunFolder(other), RunFolder(self.out)),
        )
        with _show_progress(self.out) as tell:
            run_alternately(
                suite, file, folders[::-1], python, lambda kind, block: is_settled(kind, block, *folders),
                lambda what: tell(0, 1, what),
            )  # fmt: skip
        CompareCommand(first=other, second=self.out, as_json=self.as_json).run()

    def run_with_progress(self) -> RunFolder:
        """Run the suite, print its progress on the error stream, and name the parts that failed."""
        try:
            from benchmarks.run import run_suite
            from benchmarks.suite import load_suite

            suite = load_suite(self.suite, allow_plugins=self.allow_plugins)
            with _show_progress(self.out) as tell:
                folder = run_suite(
                    suite, self.out, workers=self.workers, command=self._describe(),
                    part_timeout=self.part_timeout, progress=tell,
                )  # fmt: skip
        except KeyboardInterrupt:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # nothing is left to stop
            err_console.print("interrupted; repeat the command to resume", style="yellow")
            raise typer.Exit(130) from None
        for part in folder.manifest().get("repeated", []):
            err_console.print(f"repeated: {part['file']}: {part['why']}", soft_wrap=True)
        for part in folder.manifest().get("failed", []):
            times = f", {part['times']} times" if part["times"] > 1 else ""
            words = f"failed: {part['label']} ({part['file']}): {part['why']}{times}"
            err_console.print(words, style="yellow", soft_wrap=True)
        return folder

    def _describe(self) -> str:
        """Return the command that repeats the run."""
        words = ["optik bench run", shlex.quote(self.suite), "--out RUN"]
        words += [f"--workers {self.workers}"] if self.workers != 1 else []
        words += [f"--part-timeout {self.part_timeout:g}"] if self.part_timeout is not None else []
        return " ".join(words + (["--allow-plugins"] if self.allow_plugins else []))


@dataclass(frozen=True, kw_only=True)
class DemoCommand(JsonCommand):
    """Compare the IK methods and time laws on the paper's workspace and line: run the suite `paper` and write its report."""

    out: Path = option("Options", "Folder of the run and the report.", Path("optik-demo"))
    workers: int = option("Options", WORKERS_HELP, DEMO_WORKERS)

    def run(self) -> None:
        """Run the suite, write its report, and print the verdicts."""
        from benchmarks.experiments.claims import judge_claims
        from benchmarks.report import write_report

        folder = RunCommand(suite="paper", out=self.out, workers=self.workers).run_with_progress()
        with err_console.status("writing the report"):
            page = write_report(folder)
        findings = judge_claims(folder)
        if self.as_json:
            print_json({"report": str(page), "claims": [{"claim": f.claim, "verdict": f.verdict} for f in findings]})
            return
        table = Table("", "the paper's claim", "verdict")
        for f in findings:
            table.add_row(f.key, f.claim, f.verdict)
        out_console.print(table)
        out_console.print(f"report: {page}", soft_wrap=True)


# ---------------------------------------------------------------- progress


@contextmanager
def _show_progress(out: Path) -> Iterator[Tell]:
    """Show finished parts as a bar on a terminal, and as lines elsewhere."""
    with make_progress() as progress:
        said: float | None = None

        def tell(done: int, total: int, what: str) -> None:
            nonlocal said
            if said is None:  # a method may end the process without a message
                said = time.monotonic()
                words = f"writing {out} (interrupted? repeat the command to resume)"
                err_console.print(words, style="dim", soft_wrap=True)
            left = update_progress(progress, done, total, what)
            if progress.disable and time.monotonic() - said >= LINE_SECONDS:
                said = time.monotonic()
                words = "" if left is None else f", {format_duration(left)} left"
                err_console.print(f"{done} of {total} parts{words}: {what}", soft_wrap=True)

        yield tell


def make_progress(clock: Callable[[], float] = time.monotonic) -> Progress:
    """Return the display of a run's progress, which is disabled where there is no terminal."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.table import Column

    what = TextColumn(
        "{task.description}", markup=False, table_column=Column(no_wrap=True, overflow="ellipsis", ratio=1)
    )
    bar = [BarColumn(20)] if err_console.width >= WIDE_ENOUGH else []
    progress = Progress(
        what, *bar, MofNCompleteColumn(), TextColumn("{task.fields[left]}"), console=err_console, transient=True,
        expand=True, speed_estimate_period=SPEED_SECONDS, get_time=clock,
        disable=not err_console.is_terminal or err_console.is_dumb_terminal,
    )  # fmt: skip
    progress.add_task("compiling", total=None, left="")
    return progress


def update_progress(progress: Progress, done: int, total: int, what: str) -> float | None:
    """Show so many finished parts, and return the time left [s]; None before this process has finished three parts."""
    (task,) = progress.tasks
    if total != task.total:  # the first call, and the first one that knows all parts
        progress.reset(task.id, total=total, completed=done, first=done, left="")
    progress.update(task.id, completed=done, description=what)
    if done - task.fields["first"] < FEWEST_PARTS or not task.speed:  # which excludes the first part: it compiles
        return None
    seconds = (total - done) / task.speed
    progress.update(task.id, left=f"{format_duration(seconds)} left")
    return seconds


def format_duration(seconds: float) -> str:
    """Format a time: 45 s, 3 min 20 s, 2 h 5 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


# ---------------------------------------------------------------- optik bench report, optik bench compare


class ReportFormat(StrEnum):
    """Formats of a report."""

    HTML = "html"
    MD = "md"
    CSV = "csv"
    TEX = "tex"


@dataclass(frozen=True, kw_only=True)
class ReportCommand(JsonCommand):
    """Write the report of a run into its folder: one HTML page that works offline, or its tables as Markdown, CSV or LaTeX.

    The page saves each figure as SVG.
    """

    folder: Path = argument("RUN", "Folder of a run.")
    format: list[ReportFormat] | None = option(
        "Output",
        "Repeatable. html: one page with figures; md: all tables in report.md; csv or tex: a file per table. By default html.",
    )
    columns: str = option(
        "Output",
        "Columns of the tables in md, csv and tex, by their keys, with commas: the heads of the CSV files. Tables without "
        "any of them are left out.",
        "",
        metavar="KEYS",
    )

    def run(self) -> None:
        """Write the report."""
        from benchmarks.records import RunFolder

        formats = list(dict.fromkeys(self.format or [ReportFormat.HTML]))
        columns = [key for key in map(str.strip, self.columns.split(",")) if key]
        if columns and not {ReportFormat.MD, ReportFormat.CSV, ReportFormat.TEX} & set(formats):
            raise InvalidInput("--columns", repr(self.columns), "--format md, csv or tex")
        with err_console.status("writing the report"):
            written = {one: self._write(one, RunFolder(self.folder), columns) for one in formats}
        files = [str(path) for paths in written.values() for path in paths]
        if self.as_json:
            print_json({"report": files[0] if files else None, "files": files})
            return
        for one, paths in written.items():
            words = "no tables written: no part of this run is finished"
            if paths:
                whole = one in (ReportFormat.HTML, ReportFormat.MD)
                words = f"report: {paths[0]}" if whole else f"{len(paths)} tables in {paths[0].parent}"
            out_console.print(words, soft_wrap=True)

    def _write(self, form: ReportFormat, folder: RunFolder, columns: list[str]) -> list[Path]:
        """Write the files of a format."""
        from benchmarks.report import formats, write_report

        if form is ReportFormat.HTML:
            return [write_report(folder)]
        writers = {
            ReportFormat.MD: formats.write_markdown,
            ReportFormat.CSV: formats.write_csv,
            ReportFormat.TEX: formats.write_tex,
        }
        return writers[form](folder, columns)


@dataclass(frozen=True, kw_only=True)
class CompareCommand(JsonCommand):
    """Compare two runs of the same blocks: better, worse, the machine, or within noise.

    Equal problems are compared in pairs by McNemar's and Wilcoxon's tests with Holm's correction. Blocks with other problems
    are not compared. A time must also differ by more than the spread between rounds. If a reference computation took another
    time, too, the verdict is "the machine". Runs of `optik bench run --against` are compared by the median ratio of their
    processes. The exit status is 1 if B is worse than A by more than the threshold.
    """

    first: Path = argument("A", "Folder of the first run.")
    second: Path = argument("B", "Folder of a second run of the same blocks.")
    threshold: float = option(
        "Options",
        "Exit with status 1 if B is worse by more: percent of a time, percentage points of a rate.",
        5.0,
        min=0.0,
    )
    show_all: bool = option("Output", "Also show differences within noise.", False, "--all")

    def run(self) -> None:
        """Print the comparison."""
        from benchmarks.records import RunFolder
        from benchmarks.report.base import Run
        from benchmarks.report.compare import as_data, compare_runs

        comparison = compare_runs(Run(RunFolder(self.first)), Run(RunFolder(self.second)))
        worse = len(comparison.worse_than(self.threshold))
        if self.as_json:
            print_json(
                {
                    "a": str(self.first), "b": str(self.second), "threshold": self.threshold, "worse_past_threshold": worse,
                    "differences": [as_data(d) for d in comparison.differences], "left_out": list(comparison.left_out),
                    "settings": [one._asdict() for one in comparison.settings],
                }
            )  # fmt: skip
        else:
            self._print(comparison)
            verdicts = [d.verdict for d in comparison.differences]
            counts = ", ".join(
                f"{verdicts.count(word)} {word}" for word in ("better", "worse", "the machine", "within noise")
            )
            out_console.print(f"{counts}; worse by more than {self.threshold:g}: {worse}", soft_wrap=True)
        if worse:
            raise typer.Exit(1)

    def _print(self, found: Comparison) -> None:
        """Print the different settings, the differences, and the parts that were not compared."""
        from benchmarks.report.tables import number

        table = Table("block", "method", "measure", "A", "B", "change", "")
        looks = {"better": "green", "worse": "red", "the machine": "yellow"}
        for d in found.differences:
            if self.show_all or d.verdict in looks:
                change = f"{d.change:+.2f} {'points' if d.unit == '%' else '%'}"
                measure = f"{d.measure} [{d.unit}]" if d.unit else d.measure
                cells = (d.block, d.label, measure, number(d.a, 4), number(d.b, 4), change, d.verdict)
                table.add_row(*cells, style=looks.get(d.verdict))
        for key, a, b in found.settings[: None if self.show_all else MOST_SETTINGS]:
            words = f"setting {key}: {_format_setting(a)} in A, {_format_setting(b)} in B"
            out_console.print(words, style="yellow", soft_wrap=True)
        if len(found.settings) > MOST_SETTINGS and not self.show_all:
            out_console.print(f"{len(found.settings) - MOST_SETTINGS} more settings differ; --all shows them")
        if table.row_count:
            out_console.print(table)
        for words in found.left_out:
            out_console.print(f"not compared: {words}", soft_wrap=True)


def _format_setting(value: Any) -> str:
    """Return a setting on one line, as JSON; "not set" for None."""
    text = "not set" if value is None else json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 80 else f"{text[:79]}…"
