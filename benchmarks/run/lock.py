"""The lock of a folder: one process at a time writes to it, and the next one knows in which work it crashed."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.records import LOCK
from optik.errors import OutputError

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
        """Release the lock; remove its file unless it records a crash whose work this process has not repeated."""
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
