"""Crash journal of a block that is timed in one process: files that survive a crash of this process."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from typing import Any, Self

import polars as pl

from benchmarks.records.folder import RunFolder, failures, record_failures
from optik.errors import OutputError
from optik.file_io import write_atomically

JOURNAL = "journal"
"""Ending of the name of a journal, a folder next to the table of its block."""

WORTH_KEEPING = 0.5
"""Least time of work that is written at once [s]: writing more often would disturb the next method's first calls."""


class Journal:
    """Crash journal of a block: the method that is running, the methods that crashed, and the rows measured so far.

    The label of each method is written before its work begins. After a crash, `left` is the method that was running. Methods
    that crashed are failures in the manifest of the run. All other files are removed when the block is finished.
    """

    def __init__(self, folder: RunFolder | None, name: str = JOURNAL) -> None:
        self._folder = folder
        self._path = None if folder is None else folder.path / name
        self._table = f"{name.removesuffix(JOURNAL)}parquet"
        self._file: FileIO | None = None
        failed = [] if folder is None else failures(folder)
        self.crashed: dict[str, str] = {one["label"]: one["why"] for one in failed if one["file"] == self._table}

    @property
    def left(self) -> str:
        """The method that was running when the last process crashed; empty if none was."""
        try:
            content = b"" if self._path is None else (self._path / "at_work").read_bytes()
            return str(json.loads(content.partition(b"\n")[0]))
        except (OSError, ValueError):
            return ""

    @contextmanager
    def at_work(self, label: str) -> Iterator[None]:
        """Record that a method is running, until the context ends."""
        self._write(label)
        try:
            yield
        finally:
            self._write("")

    def _write(self, label: str) -> None:
        """Overwrite the first line of the file, with one system call, to leave the next timed call undisturbed."""
        if self._path is None:
            return
        try:
            if self._file is None:
                self._path.mkdir(parents=True, exist_ok=True)
                self._file = FileIO(self._path / "at_work", "w")
            self._file.seek(0)
            self._file.write(json.dumps(label).encode() + b"\n")
        except OSError as error:
            raise OutputError(self._path, f"cannot be written ({error.strerror})") from None

    def blame(self, label: str, why: str) -> None:
        """Record that a method crashed its process; this block does not call it again."""
        self.crashed |= {label: why}
        if self._folder is not None:
            record_failures(self._folder, self._table, label, [why])

    def keep(self, name: str, rows: pl.DataFrame, seconds: float) -> None:
        """Store the rows measured so far in an unfinished part."""
        if self._path is not None and seconds >= WORTH_KEEPING:
            self._path.mkdir(parents=True, exist_ok=True)
            write_atomically(self._path / f"{name}.arrow", lambda part: rows.write_ipc(part))

    def kept(self, name: str) -> pl.DataFrame | None:
        """Return the stored rows of an unfinished part; None if there are none."""
        if self._path is None:
            return None
        try:
            return pl.read_ipc((self._path / f"{name}.arrow").read_bytes())
        except (OSError, pl.exceptions.PolarsError):
            return None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: Any) -> None:
        if self._file is not None:
            self._file.close()
        if kind is None and self._path is not None:
            shutil.rmtree(self._path, ignore_errors=True)


UNKEPT = Journal(None)
"""A journal without files, for work outside a run."""
