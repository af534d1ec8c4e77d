"""Run the parts in processes, so that their kernels are compiled and cached."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from tempfile import TemporaryFile

from benchmarks.blocks._fresh import ROOT

PROGRESS_SECONDS = 10.0
"""Interval between two lines of progress if the error stream is no terminal [s]."""


class Progress:
    """Counter of compiled kernels on the error stream: one line on a terminal, otherwise a line from time to time."""

    def __init__(self) -> None:
        self.count, self._begin = 0, time.monotonic()
        self._last = self._begin

    def __call__(self, kernel: str) -> None:
        """Count a kernel."""
        self.count += 1
        now, terminal = time.monotonic(), sys.stderr.isatty()
        if terminal or now - self._last > PROGRESS_SECONDS:
            words = f"compiled {self.count} kernels in {now - self._begin:.0f} s: {kernel}"
            print(
                f"\r\x1b[K{words[:70]}\r" if terminal else words,
                end="" if terminal else "\n",
                file=sys.stderr,
                flush=True,
            )
            self._last = now

    def end(self) -> str:
        """Clear the line, and return a summary."""
        print("\r\x1b[K" if sys.stderr.isatty() else "", end="", file=sys.stderr, flush=True)
        return f"{self.count} kernels in {time.monotonic() - self._begin:.0f} s"


def run_parts(parts: Sequence[str], jobs: int, say: Callable[[str], None], **environment: str) -> dict[str, str]:
    """Run the parts in so many processes, and `say` each compiled kernel; return the error of each part that failed."""
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])

    def run(part: str) -> str:
        command = [sys.executable, "-P", "-m", "benchmarks.kernels.process", part]
        env = os.environ | {"PYTHONPATH": path} | environment
        with (
            TemporaryFile("w+") as errors,
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, env=env) as process,
        ):
            for line in process.stdout or ():
                say(line.strip())
            if process.wait() == 0:
                return ""
            errors.seek(0)
            return (errors.read().strip().splitlines() or [f"exit status {process.returncode}"])[-1]

    with ThreadPoolExecutor(jobs) as pool:
        return {part: words for part, words in zip(parts, pool.map(run, parts), strict=True) if words}
