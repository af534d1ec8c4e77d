"""The lock of a run folder: one process at a time writes to it."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.records import LOCK
from optik.errors import OutputError

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl


WAIT = 0.2
"""Time between two attempts to get a lock that another process holds [s]."""


@contextmanager
def locked(folder: Path, wait: bool = False) -> Iterator[None]:
    """Lock a run folder for this process; create the folder if it does not exist.

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
    try:
        yield
    finally:
        if sys.platform == "win32":
            os.close(opened)  # an open file cannot be removed
            file.unlink(missing_ok=True)
        else:
            file.unlink(missing_ok=True)  # before another process can hold it
            os.close(opened)


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
            os.ftruncate(opened, 0)
            os.write(opened, str(os.getpid()).encode())
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


def _holder(file: Path) -> str:
    """Describe the holder of a lock."""
    try:
        return f" (process {int(file.read_text(encoding='ascii'))})"
    except (OSError, ValueError):
        return ""
