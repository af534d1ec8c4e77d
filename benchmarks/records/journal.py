"""What is at work in a block that is timed in one process, kept in files that outlive the process."""

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
"""Work of so many seconds is kept at once: writing after less would cool the caches of the next method's first calls."""


class Journal:
    """Who of a block is at work, whose process ended at that, and what is finished of a part that is not.

    A process that ends in the middle of a call can say nothing any more. So the label of each method is written before
    its work begins: `left` tells the next process whom the last one died in.
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
        """Name of the file of methods that ended their process, in the run folder: why, by label."""
        return f"{self._name}/crashed.json"

    def _left(self) -> str:
        """Who was at work when the last process died; empty where it did not die in any method's work."""
        try:
            content = b"" if self._path is None else (self._path / "at_work").read_bytes()
            return str(json.loads(content.partition(b"\n")[0]))
        except (OSError, ValueError):
            return ""

    # ------------------------------------------------------------ who is at work

    @contextmanager
    def at_work(self, label: str) -> Iterator[None]:
        """Say whose work is done now."""
        self._write(label)
        try:
            yield
        finally:
            self._write("")

    def _write(self, label: str) -> None:
        """Overwrite the first line of the file: one call of the system, which a timed call that follows does not notice."""
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
        """Record that a method ended its process: it is not called in this block again."""
        self.crashed |= {label: why}
        if self._folder is not None:
            self._folder.write_json(self.crashes, self.crashed)

    # ------------------------------------------------------------ what is finished

    def keep(self, name: str, rows: pl.DataFrame, seconds: float) -> None:
        """Keep some rows of a part that is not finished."""
        if self._path is not None and seconds >= WORTH_KEEPING:
            self._path.mkdir(parents=True, exist_ok=True)
            write_atomically(self._path / f"{name}.arrow", lambda part: rows.write_ipc(part))

    def kept(self, name: str) -> pl.DataFrame | None:
        """Rows that were kept."""
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
        """Remove all but the crashes: the block is finished."""
        if self._path is None or not self._path.is_dir():
            return
        for file in self._path.iterdir():
            if file.name != Path(self.crashes).name:
                file.unlink(missing_ok=True)
        if not self.crashed:
            shutil.rmtree(self._path, ignore_errors=True)


UNKEPT = Journal(None)
"""Keeps nothing: for work outside a run."""
