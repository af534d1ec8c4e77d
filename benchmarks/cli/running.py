"""`optik bench run`: run a suite with progress, Ctrl-C and a list of failures."""

from __future__ import annotations

import shlex
import signal
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any
from urllib.parse import urlsplit

import typer

from benchmarks.cli.shared import err_console

if TYPE_CHECKING:
    from rich.progress import Progress, Task

AllowPlugins = Annotated[
    bool,
    typer.Option("--allow-plugins", help="Run the Python files that the suite names; `optik bench check` lists them."),
]
Workers = Annotated[
    int, typer.Option(help="Number of processes. It does not change results, only measured times of plans.")
]
Dask = Annotated[
    str, typer.Option(metavar="ADDRESS", help="Run on the Dask cluster of this scheduler: tls://HOST:PORT.")
]
PartTimeout = Annotated[
    float | None,
    typer.Option(metavar="SECONDS", help="Time limit of a part in a worker process. [default: 1800 with --workers]"),
]

LINE_SECONDS = 10.0
"""Interval between two lines of progress without a bar [s]: a few hundred lines an hour."""

WIDE_ENOUGH = 70
"""Least number of terminal columns for the bar and the rate."""

FEWEST_PARTS, RATE_SECONDS = 4, 30.0
"""Least number of finished parts for a rate, and the time over which it is averaged [s]."""

Tell = Callable[[int, int, str], None]
"""Type of a progress callback, as `benchmarks.run.session.Progress`."""


def run_with_progress(
    suite: str,
    out: Path,
    workers: int,
    allow_plugins: bool = False,
    dask: str = "",
    part_timeout: float | None = None,
) -> Any:
    """Run a suite and print its progress on the error stream."""
    try:
        from benchmarks.run import run_suite
        from benchmarks.suite import load_suite

        asked = load_suite(suite, allow_plugins=allow_plugins)
        command = _command(suite, workers, allow_plugins, dask, part_timeout)
        if dask:
            _warn(dask)
        with _progress() as tell:
            folder = run_suite(
                asked, out, workers=workers, command=command, dask=dask, part_timeout=part_timeout,
                progress=_announce_once(tell, out),
            )  # fmt: skip
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # nothing is left to stop
        err_console.print("interrupted; repeat the command to resume", style="yellow")
        raise typer.Exit(130) from None
    for one in folder.manifest().get("failed", []):
        words = f"failed: {one['label']} ({one['file']}): {one['why']}, {one['times']} times"
        err_console.print(
            words.removesuffix(", 1 times"), style="yellow", markup=False, highlight=False, soft_wrap=True
        )
    return folder


def _command(suite: str, workers: int, allow_plugins: bool, dask: str, part_timeout: float | None) -> str:
    """Return the command that repeats this run."""
    words = ["optik bench run", shlex.quote(suite), "--out RUN"]
    words += [f"--workers {workers}"] if workers != 1 else []
    words += [f"--dask {shlex.quote(dask)}"] if dask else []
    words += [f"--part-timeout {part_timeout:g}"] if part_timeout is not None else []
    return " ".join(words + (["--allow-plugins"] if allow_plugins else []))


def _warn(dask: str) -> None:
    from benchmarks.run.cluster import warn_of_plain_text

    if not _has_port(dask):
        return  # the error reports this
    if words := warn_of_plain_text(dask):
        err_console.print(f"warning: {words}", style="yellow", markup=False, highlight=False, soft_wrap=True)


def _has_port(address: str) -> bool:
    """Say whether an address has a port."""
    try:
        return urlsplit(address if "://" in address else f"tcp://{address}").port is not None
    except ValueError:
        return False


# ---------------------------------------------------------------- progress


def _announce_once(tell: Tell, out: Path) -> Tell:
    """Return a callback that first prints how to resume: a method may kill the process without a message."""
    said = False

    def first(done: int, total: int, what: str) -> None:
        nonlocal said
        if not said:
            words = f"writing {out} (interrupted? repeat the command to resume)"
            err_console.print(words, style="dim", markup=False, highlight=False, soft_wrap=True)
            said = True
        tell(done, total, what)

    return first


@contextmanager
def _progress() -> Iterator[Tell]:
    """Show a bar with rate and time left on a terminal, and lines elsewhere."""
    if not err_console.is_terminal or err_console.is_dumb_terminal:
        yield _Lines().tell
        return
    with _bar() as bar:
        task, rate = bar.add_task("compiling", total=None, rate=0.0), _Rate()
        yield lambda done, total, what: bar.update(
            task, completed=done, total=total, description=what, rate=rate.after(done, time.monotonic())
        )


def _bar() -> Progress:
    """Return the progress display, with fewer columns on narrow terminals."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn
    from rich.table import Column
    from rich.text import Text

    class Rate(ProgressColumn):
        """Parts per second."""

        def render(self, task: Task) -> Text:
            return Text(f"{task.fields['rate']:.3g}/s" if task.fields["rate"] else "")

    class Left(ProgressColumn):
        """Time left."""

        def render(self, task: Task) -> Text:
            rate = task.fields["rate"]
            return Text(f"{_duration((task.total - task.completed) / rate)} left" if rate and task.total else "")

    what = TextColumn("{task.description}", table_column=Column(no_wrap=True, overflow="ellipsis", ratio=1))
    wide = err_console.width >= WIDE_ENOUGH
    between = (BarColumn(20), MofNCompleteColumn(), Rate()) if wide else (MofNCompleteColumn(),)
    return Progress(what, *between, Left(), console=err_console, transient=True, expand=True)


class _Rate:
    """Rate of finished parts [1/s] over the last half minute, without the first part, which compiles."""

    def __init__(self) -> None:
        self._done: deque[tuple[float, int]] = deque()
        self._first: int | None = None

    def after(self, done: int, now: float) -> float:
        """Return the rate; 0 until a few parts are finished."""
        if self._first is None:
            self._first = done
        if done > self._first and (not self._done or done > self._done[-1][1]):
            self._done.append((now, done))
        while len(self._done) > FEWEST_PARTS and now - self._done[0][0] > RATE_SECONDS:
            self._done.popleft()
        if len(self._done) < FEWEST_PARTS or now <= self._done[0][0]:
            return 0.0
        return (self._done[-1][1] - self._done[0][1]) / (now - self._done[0][0])


class _Lines:
    """Progress as lines, for output without a bar."""

    def __init__(self) -> None:
        self._last, self._rate = time.monotonic(), _Rate()

    def tell(self, done: int, total: int, what: str) -> None:
        now = time.monotonic()
        rate = self._rate.after(done, now)
        if now - self._last < LINE_SECONDS:
            return
        self._last = now
        words = f"{done} of {total} parts"
        if rate > 0.0:
            words += f", {rate:.3g}/s, {_duration((total - done) / rate)} left"
        err_console.print(f"{words}: {what}", markup=False, highlight=False, soft_wrap=True)


def _duration(seconds: float) -> str:
    """Format a time: 45 s, 3 min 20 s, 2 h 5 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
