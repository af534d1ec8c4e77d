"""Peers in separate environments: a worker process runs and times their calls, and may crash without ending the run."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

from benchmarks.peers.base import Absent, Answer, Failed, Peer
from optik.errors import InvalidInput

WORKERS = Path(__file__).resolve().parent / "_workers"
"""Folder of the scripts that other environments run."""

LONGEST_CALL = 60.0
"""Time limit of an answer [s]: a worker that exceeds it is ended, and the problem counts as a crash."""

MOST_WORKER_CRASHES = 20
"""Largest number of successive problems with crashes: a restart takes seconds, and the next problems would crash, too."""

LONGEST_START = 300.0
"""Time limit of importing a package and building a robot [s], for a busy machine with a cold disk."""

MOST_KEPT = 4
"""Number of worker processes that are kept for later calls with the same model: importing Drake takes a second."""


def peers_folder() -> Path:
    """Return the folder of the environments of peers: ``$OPTIK_PEERS``, otherwise ``optik/peers`` in the user's data folder."""
    if own := os.environ.get("OPTIK_PEERS"):
        return Path(own)
    if sys.platform == "win32":
        data = os.environ.get("LOCALAPPDATA") or str(Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        data = str(Path.home() / "Library" / "Application Support")
    else:
        data = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return Path(data) / "optik" / "peers"


class WorkerPeer(Peer):
    """A peer whose package is in a separate environment, where a worker process makes and times its calls."""

    environment: ClassVar[str]  # name of the environment, and of the peer that installs it
    worker: Worker

    @classmethod
    def folder(cls) -> Path:
        """Return the folder of the environment, which need not exist."""
        return peers_folder() / cls.environment

    @classmethod
    def python(cls) -> Path:
        """Return the interpreter of the environment, which need not exist."""
        return cls.folder() / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")

    @classmethod
    def missing(cls) -> str:
        """Return why the peer cannot run here; empty if it can."""
        if cls.python().exists():
            return ""
        return f"no environment in {cls.folder()}: optik bench peer {cls.environment} --install"

    @classmethod
    def version(cls) -> str | None:
        """Return the version of the peer's distribution, read from the metadata in its environment."""
        packages = "Lib/site-packages" if sys.platform == "win32" else "lib/python*/site-packages"
        found = sorted(cls.folder().glob(f"{packages}/{cls.distribution.replace('-', '_')}-*.dist-info"))
        return found[0].name.removesuffix(".dist-info").rpartition("-")[2] if found else None

    @classmethod
    def start(cls, script: str, model: dict[str, Any], *, keep: bool = False) -> Worker:
        """Start a worker process with a script of `_workers`, or return the one that is kept for the script and model."""
        if why := cls.missing():
            raise Absent(why)
        return (_kept if keep else Worker)(cls.python(), WORKERS / f"{script}.py", json.dumps(model))

    def plain(self, *arguments: Any) -> tuple[Any, ...]:
        """Return the arguments of a call as plain data."""
        return tuple(each.tolist() for each in arguments)

    def call(self, *arguments: Any) -> Any:
        """Make one call in the worker process; comparisons use `many`, whose times exclude the pipe."""
        return self.worker.ask(*self.plain(*arguments)).raw

    def many(self, arguments: Sequence[tuple[Any, ...]]) -> list[Answer]:
        """Make calls one after another in the worker process, which times each of them."""
        return self.worker.solve([self.plain(*each) for each in arguments])


class Worker:
    """A process that runs ``serve.py`` with another interpreter; started again after a crash."""

    def __init__(self, python: Path, script: Path, model: str) -> None:
        self._command = [str(python), "-I", str(WORKERS / "serve.py"), str(script)]
        self._model: dict[str, Any] = json.loads(model)
        self.starts = 0
        self._start()

    def _start(self) -> None:
        self.starts += 1
        self._hung = False
        self._process = subprocess.Popen(
            self._command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        weakref.finalize(self, _end, self._process)
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=_read, args=(self._process.stdout, self._lines), daemon=True).start()
        self._ask({"model": self._model})
        reply = self._next(LONGEST_START)
        if reply is None:
            raise Absent("its worker process ended at the start")
        if "refused" in reply:
            raise InvalidInput("robot", reply["refused"], "an arm that the package supports")
        if "error" in reply:
            raise Absent(f"cannot be loaded in its environment: {reply['error']}")

    def ask(self, *problem: Any, do: str = "call") -> Answer:
        """Solve one problem; raise `Failed` where that fails."""
        (answer,) = self.solve([problem], do)
        if isinstance(answer.raw, Failed):
            raise answer.raw
        return answer

    def solve(self, problems: Sequence[tuple[Any, ...]], do: str = "call") -> list[Answer]:
        """Solve problems; after a crash, repeat that problem and solve the others in a new process."""
        answers: list[Answer] = []
        tried_again, crashes = False, 0
        while len(answers) < len(problems):
            begin = time.perf_counter_ns()
            self._ask({"do": do, "problems": problems[len(answers) :]})
            while len(answers) < len(problems) and (reply := self._next(LONGEST_CALL)) is not None:
                raw = Failed("raised", reply["error"]) if "error" in reply else reply["answer"]
                answers.append(Answer(raw, reply["ns"], reply["cpu_ns"]))
                tried_again, crashes, begin = False, 0, time.perf_counter_ns()
            if len(answers) == len(problems):
                break
            took, how = time.perf_counter_ns() - begin, self._ended()
            if tried_again:
                answers.append(Answer(Failed("crashed", how), took, None))
                crashes += 1
            tried_again = not tried_again
            if crashes == MOST_WORKER_CRASHES or not self._restarted():
                lost = Answer(Failed("crashed", f"not called after repeated crashes: {how}"), took, None)
                answers += [lost] * (len(problems) - len(answers))
        return answers

    def _ended(self) -> str:
        """End the process, and describe how it ended."""
        _end(self._process)
        status = f"its process ended with status {self._process.returncode}"
        return f"no answer for {LONGEST_CALL:g} s" if self._hung else status

    def _restarted(self) -> bool:
        try:
            self._start()
        except (Absent, InvalidInput):
            return False
        return True

    def _ask(self, request: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # it has ended: the missing answer shows that
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()

    def _next(self, seconds: float) -> dict[str, Any] | None:
        """Return the next answer; None if the process ended or took too long."""
        try:
            line = self._lines.get(timeout=seconds)
        except queue.Empty:
            self._hung = True
            return None
        return dict(json.loads(line)) if line else None


_kept = lru_cache(MOST_KEPT)(Worker)


def _read(stream: Any, lines: queue.SimpleQueue[str]) -> None:
    """Put lines into a queue, and an empty line when the stream ends."""
    for line in stream:
        lines.put(line)
    lines.put("")


def _end(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with contextlib.suppress(OSError):
                stream.close()
