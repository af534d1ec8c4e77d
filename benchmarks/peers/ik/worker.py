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
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from benchmarks.peers.ik.base import Answer, Failed, NotInstalled, Peer, none, one
from benchmarks.peers.models import urdf
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array

WORKERS = Path(__file__).resolve().parents[1] / "_workers"
"""Folder of the scripts that other environments run."""

LONGEST_CALL = 60.0
"""Time limit of an answer [s]: a worker that exceeds it is ended, and the problem counts as a crash."""

MOST_WORKER_CRASHES = 20
"""Largest number of successive problems with crashes: a restart takes seconds, and the next problems would crash, too."""

LONGEST_START = 300.0
"""Time limit of importing a package and building a robot [s], for a busy machine with a cold disk."""


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
    """A peer whose package is in a separate environment; a subclass only states its facts."""

    name: ClassVar[str]  # of the peer, of its environment, and of its script in benchmarks/peers/_workers
    requirements: ClassVar[tuple[str, ...]]  # what pip installs into the environment

    def __init__(self, robot: Robot, *, iterations: int | None = None) -> None:
        self.robot = robot
        if why := self.missing():
            raise NotInstalled(why)
        self._worker = Worker(self.python(), self.script(), {"urdf": urdf(robot), "iterations": iterations})

    @classmethod
    def environment(cls) -> Path:
        """Return the folder of the peer's environment, which need not exist."""
        return peers_folder() / cls.name

    @classmethod
    def python(cls) -> Path:
        """Return the interpreter of the peer's environment, which need not exist."""
        return cls.environment() / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")

    @classmethod
    def missing(cls) -> str:
        """Return why the peer cannot run here; empty if it can."""
        if cls.python().exists():
            return ""
        return f"no environment in {cls.environment()}: optik bench peer {cls.name} --install"

    @classmethod
    def script(cls) -> Path:
        """Return the file in ``benchmarks/peers/_workers`` that defines the peer's method for the worker process."""
        return WORKERS / f"{cls.name}.py"

    @classmethod
    def version(cls) -> str | None:
        """Return the version of the peer's distribution, read from the metadata in its environment."""
        stem = cls.distribution.replace("-", "_")
        found = sorted(cls.environment().glob(f"**/site-packages/{stem}-*.dist-info"))
        return found[0].name.removesuffix(".dist-info").rpartition("-")[2] if found else None

    def call(self, target: Array, q0: Array) -> Any:
        """Make one call in the worker process; comparisons use `many`, whose times exclude the pipe."""
        answer = self.many([(target, q0)])[0].raw
        if isinstance(answer, Failed):
            raise RuntimeError(f"{answer.outcome}: {answer.error}")
        return answer

    def many(self, arguments: Sequence[tuple[Any, ...]]) -> list[Answer]:
        """Make calls one after another in the worker process, which times each of them."""
        return self._worker.solve([(target.tolist(), q0.tolist()) for target, q0 in arguments])

    def answers(self, raw: Any) -> Array:
        """Return the one configuration, if there is one, clamped to the limits, which these methods respect up to rounding."""
        return none(self.robot) if raw["q"] is None else one(self.robot.limits.clip(raw["q"]))

    def iterations(self, raw: Any) -> int | None:
        """Return the number of iterations; None if the method does not report it."""
        return None if raw["iterations"] is None else int(raw["iterations"])

    def claims(self, raw: Any) -> bool | None:
        """Return whether the method reports success."""
        return None if raw["claimed"] is None else bool(raw["claimed"])

    def fk(self, q: Array) -> Array | None:
        """Return the tool pose by the model in the worker process."""
        return np.array(self._worker.fk(q.tolist()))


class Worker:
    """A process that runs ``serve.py`` with another interpreter; started again after a crash."""

    def __init__(self, python: Path, script: Path, model: dict[str, Any]) -> None:
        self._command = [str(python), "-I", str(WORKERS / "serve.py"), str(script)]
        self._model = model
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
        self._ask({"do": "build", "model": self._model})
        reply = self._next(LONGEST_START)
        if reply is None:
            raise NotInstalled("its worker process ended at the start")
        if "refused" in reply:
            raise InvalidInput("robot", reply["refused"], "an arm that the package supports")
        if "error" in reply:
            raise NotInstalled(f"cannot be loaded in its environment: {reply['error']}")

    def fk(self, q: list[float]) -> Any:
        """Return the tool pose of one configuration."""
        self._ask({"do": "fk", "q": q})
        reply = self._next(LONGEST_CALL) or {"error": "its worker process ended"}
        if "error" in reply:
            raise NotInstalled(f"its forward kinematics failed: {reply['error']}")
        return reply["pose"]

    def solve(self, problems: list[tuple[Any, Any]]) -> list[Answer]:
        """Solve problems; after a crash, repeat that problem and solve the others in a new process."""
        found: list[Answer] = []
        tried_again, crashes = False, 0
        while len(found) < len(problems):
            begin = time.perf_counter_ns()
            self._ask({"do": "solve", "problems": problems[len(found) :]})
            while len(found) < len(problems) and (reply := self._next(LONGEST_CALL)) is not None:
                raw = Failed("raised", reply["error"]) if "error" in reply else reply
                found.append(Answer(raw, reply["ns"], reply["cpu_ns"]))
                tried_again, crashes, begin = False, 0, time.perf_counter_ns()
            if len(found) == len(problems):
                break
            took, how = time.perf_counter_ns() - begin, self._ended()
            if tried_again:
                found.append(Answer(Failed("crashed", how), took, None))
                crashes += 1
            tried_again = not tried_again
            if crashes == MOST_WORKER_CRASHES or not self._restarted():
                lost = Answer(Failed("crashed", f"not called after repeated crashes: {how}"), took, None)
                found += [lost] * (len(problems) - len(found))
        return found

    def _ended(self) -> str:
        """End the process, and describe how it ended."""
        hung = self._hung
        _end(self._process)
        return (
            f"no answer for {LONGEST_CALL:g} s" if hung else f"its process ended with status {self._process.returncode}"
        )

    def _restarted(self) -> bool:
        try:
            self._start()
        except (NotInstalled, InvalidInput):
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
