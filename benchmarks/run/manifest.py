"""The beginning of a run: its manifest, and the lock of its folder, which tells the next process what crashed it."""

from __future__ import annotations

import json
import os
import re
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.provenance import provenance
from benchmarks.records import FORMAT, LEDGER, LOCK, MANIFEST, RunFolder
from benchmarks.suite import Suite
from optik.errors import OutputError
from optik.plugins.files import expected
from optik.plugins.usage import check_same_plugins, record_plugins

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl


WAIT = 0.2
"""Time between two attempts to get a lock that another process holds [s]."""

LOCK_BYTES = 4096
"""Largest size of the file of a lock [bytes]."""


class Lock:
    """A lock that this process holds. Its file has the number of the process and its current work.

    The file remains only after a crash. Then it tells the next process how often its work has crashed.
    """

    def __init__(self, file: Path, opened: int) -> None:
        self._file, self._opened = file, opened
        left = _parse(os.read(opened, LOCK_BYTES))
        self._crashed, self._crashes = str(left.get("work", "")), int(left.get("crashes", 0))
        self.is_void = not self._crashed
        self._write(self._crashed, self._crashes)

    def crashes(self, work: str) -> int:
        """Return how often the process crashed in some work."""
        return self._crashes if work == self._crashed else 0

    @contextmanager
    def at_work(self, work: str) -> Iterator[None]:
        """Record the work of this context; a process that ends in it without an exception has crashed."""
        self.is_void = True
        self._write(work, self.crashes(work) + 1)
        yield
        self._write("", 0)

    def _write(self, work: str, crashes: int) -> None:
        """Overwrite the first line of the file; only this line is read."""
        line = json.dumps({"process": os.getpid(), "work": work, "crashes": crashes})
        try:
            os.lseek(self._opened, 0, os.SEEK_SET)
            os.write(self._opened, line.encode() + b"\n")
        except OSError as error:
            raise OutputError(self._file, f"cannot be written ({error.strerror})") from None

    def release(self) -> None:
        """Release the lock. The file is kept if it records a crash whose work is still to be repeated."""
        if sys.platform == "win32":
            os.close(self._opened)  # an open file cannot be removed
        if self.is_void:
            self._file.unlink(missing_ok=True)  # before another process can hold it
        if sys.platform != "win32":
            os.close(self._opened)


@contextmanager
def locked(folder: Path, wait: bool = False) -> Iterator[Lock]:
    """Lock a folder for this process; create the folder if it does not exist.

    The operating system releases the lock when the process ends, also after a crash.
    """
    file = folder / LOCK
    try:
        folder.mkdir(parents=True, exist_ok=True)
        while (opened := _opened(file)) is None and wait:
            time.sleep(WAIT)
    except OSError as error:
        raise OutputError(folder, f"cannot be written ({error.strerror})") from None
    if opened is None:
        words = f"another process writes to it{_holder(file)}; wait for its end, or choose another folder"
        raise OutputError(folder, words)
    lock = Lock(file, opened)
    try:
        yield lock
    finally:
        lock.release()


def _opened(file: Path) -> int | None:
    """Open and lock the file of the lock; return None if another process holds it."""
    while True:
        opened = os.open(file, os.O_RDWR | os.O_CREAT, 0o644)
        if not _taken(opened):
            os.close(opened)
            return None
        try:
            same = os.path.sameopenfile(opened, again := os.open(file, os.O_RDWR))
            os.close(again)
        except FileNotFoundError:
            same = False
        if same:
            return opened
        os.close(opened)  # its last holder has removed it meanwhile


def _taken(opened: int) -> bool:
    """Try to lock the file; return whether this process holds the lock."""
    try:
        if sys.platform == "win32":
            msvcrt.locking(opened, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:  # a file system without locks
        return True
    return True


def _parse(content: bytes) -> dict[str, Any]:
    """Return the content of the first line of a lock's file; nothing if it is damaged."""
    try:
        found = json.loads(content.partition(b"\n")[0])
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _holder(file: Path) -> str:
    """Describe the holder of a lock."""
    try:
        return f" (process {_parse(file.read_bytes())['process']})"
    except (OSError, KeyError):
        return ""


_LEFT_AT_START = re.compile(rf"{re.escape(LOCK)}|\.[0-9a-f]{{12}}\.part")
"""Names of the files of a run that was killed at its start."""


def new_manifest(suite: Suite, workers: int, command: str) -> dict[str, Any]:
    """Return the manifest at the start of a run."""
    return {
        "format": FORMAT,
        "suite": suite.name,
        "title": suite.title,
        "fingerprint": suite.fingerprint,
        "settings": suite.settings,
        "plugins": record_plugins(suite.plugins),
        "command": command,
        "provenance": provenance(suite.seed, workers),
        "continued": [],
        "failed": [],
        "complete": False,
    }


def resumed(folder: RunFolder, manifest: dict[str, Any]) -> dict[str, Any]:
    """Return the manifest of the run in this folder. If the run is resumed, it lists all sessions."""
    path = folder.path
    if path.exists() and not path.is_dir():
        raise OutputError(path, "is a file; choose a folder for the run")
    if _is_empty(folder):
        return manifest
    if not folder.has(MANIFEST):
        raise OutputError(path, "contains something else; choose a new or empty folder for the run")
    old = folder.manifest()
    if old["fingerprint"] != manifest["fingerprint"]:
        raise OutputError(path, f"contains a run of {old['suite']!r} with other settings; choose another folder")
    check_same_plugins(old.get("plugins", []), manifest["plugins"])
    return old if old["complete"] else old | {"continued": _with_session(old["continued"], manifest["provenance"])}


def _with_session(sessions: list[dict[str, Any]], now: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the sessions of a run with one more; if it equals the last one, increase the count ``sessions`` of that."""
    apart = ("created", "sessions")
    if sessions and all(sessions[-1].get(key) == now[key] for key in now if key not in apart):
        return [*sessions[:-1], sessions[-1] | {"sessions": sessions[-1].get("sessions", 1) + 1}]
    return [*sessions, now]


@contextmanager
def begun(folder: RunFolder, manifest: dict[str, Any]) -> Iterator[Lock]:
    """Lock a folder and begin or resume a run in it, with its plug-ins; remove a run that fails before its first other file."""
    existed, fresh = folder.path.exists(), _is_empty(folder)
    try:
        with locked(folder.path) as lock, expected(manifest["plugins"]):
            try:
                _begin(folder, manifest)
                yield lock
            except Exception:
                begun_with = (folder.path / MANIFEST, folder.path / LEDGER)
                if fresh and all(file in begun_with or _LEFT_AT_START.fullmatch(file.name) for file in _files(folder)):
                    for file in begun_with:
                        file.unlink(missing_ok=True)
                raise
    finally:
        if not existed and folder.path.is_dir() and not any(folder.path.iterdir()):
            folder.path.rmdir()


def _begin(folder: RunFolder, manifest: dict[str, Any]) -> None:
    """Write the manifest, remove the remains of a killed process, and check all tables."""
    try:
        folder.write_json(MANIFEST, resumed(folder, manifest))
        for left in folder.path.rglob(".*.part"):
            left.unlink(missing_ok=True)
        folder.verify()
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(folder.path, f"cannot be written ({error.strerror})") from None


def _files(folder: RunFolder) -> Iterator[Path]:
    return (file for file in folder.path.rglob("*") if file.is_file())


def _is_empty(folder: RunFolder) -> bool:
    """Say whether a folder has no files, except those of a run that was killed at its start."""
    return not folder.path.is_dir() or all(_LEFT_AT_START.fullmatch(one.name) for one in folder.path.iterdir())
