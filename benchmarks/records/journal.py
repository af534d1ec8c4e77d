"""The journal of a block that is timed in one process: files that survive a crash of the process."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any, Self

import polars as pl

from benchmarks.records.folder import RunFolder
from optik.errors import OutputError
from optik.file_io import write_atomically

JOURNAL = "journal"
"""Ending of the name of a journal, a folder beside the files of its block."""

WORTH_KEEPING = 0.5
"""Least time of work that is written at once [s]: writing more often would disturb the next method's first calls."""


class Journal:
    """The method that runs now, the methods that crashed their process, and the finished rows of an unfinished part.

    The label of each method is written before its work begins. After a crash, `left` is the method that was running.
    """

    def __init__(self, folder: RunFolder | None, name: str = JOURNAL) -> None:
        self._folder, self._name = folder, name
        self._path = None if folder is None else folder.path / name
        self._file: FileIO | None = None
        self.left = self._left()
        self.crashed: dict[str, str] = {}
        if folder is not None:
            self.crashed = folder.read_json(self.crashes) or {}

    @property
    def crashes(self) -> str:
        """Name of the file of crashed methods in the run folder: reasons by label."""
        return f"{self._name}/crashed.json"

    def _left(self) -> str:
        """Return the method that was running when the last process crashed; empty if none was."""
        try:
            content = b"" if self._path is None else (self._path / "at_work").read_bytes()
            return str(json.loads(content.partition(b"\n")[0]))
        except (OSError, ValueError):
            return ""

    # ------------------------------------------------------------ who is at work

    @contextmanager
    def at_work(self, label: str) -> Iterator[None]:
        """Record the method that runs in this context."""
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
            self._folder.write_json(self.crashes, self.crashed)

    # ------------------------------------------------------------ what is finished

    def keep(self, name: str, rows: pl.DataFrame, seconds: float) -> None:
        """Keep rows of an unfinished part."""
        if self._path is not None and seconds >= WORTH_KEEPING:
            self._path.mkdir(parents=True, exist_ok=True)
            write_atomically(self._path / f"{name}.arrow", lambda part: rows.write_ipc(part))

    def kept(self, name: str) -> pl.DataFrame | None:
        """Return the kept rows; None if there are none."""
        if self._path is None:
            return None
        try:
            return pl.read_ipc((self._path / f"{name}.arrow").read_bytes())
        except (OSError, pl.exceptions.PolarsError):
            return None

    # ------------------------------------------------------------ its end

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: Any) -> None:
        if self._file is not None:
            self._file.close()
        if kind is None:
            self._clear()

    def _clear(self) -> None:
        """Remove all files but the crashes, when the block is finished."""
        if self._path is None or not self._path.is_dir():
            return
        for file in self._path.iterdir():
            if file.name != Path(self.crashes).name:
                file.unlink(missing_ok=True)
        if not self.crashed:
            shutil.rmtree(self._path, ignore_errors=True)


UNKEPT = Journal(None)
"""A journal that keeps nothing, for work outside a run."""
