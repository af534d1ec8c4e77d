"""Files of a run: each is written completely or not at all, and tables are checked against their recorded digests."""

from __future__ import annotations

import hashlib
import io
import json
import os
from functools import lru_cache
from pathlib import Path
from typing import Any

import polars as pl

from optik.errors import InvalidInput, OutputError
from optik.file_io import write_atomically

LEDGER = "parts.jsonl"
"""File of the digests: one line of JSON per table, written before the table gets its name."""

DIGEST_BYTES = 16
"""Length of a digest: two tables that differ have the same one by chance once in 1e38 pairs."""


class Store:
    """The files in a folder, by their paths relative to it.

    Every file is written under a temporary name and then renamed, so that no file is ever incomplete. Files are not flushed
    to the disk one by one: after a power failure, the digest reveals a truncated table.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)

    def has(self, name: str) -> bool:
        """Say whether a file exists."""
        return (self.path / name).is_file()

    # ------------------------------------------------------------ writing

    def write(self, name: str, frame: pl.DataFrame) -> None:
        """Write a table as Parquet."""
        content = io.BytesIO()
        frame.write_parquet(content)

        def save(part: Path) -> None:
            part.write_bytes(content.getbuffer())
            self._note(name, content.getbuffer())  # before the file has its name: no table without its line

        write_atomically(self._with_folder(name), save)

    def write_json(self, name: str, data: Any) -> None:
        """Write plain data as strict JSON."""
        self.write_text(name, json.dumps(data, allow_nan=False, indent=1))

    def write_text(self, name: str, text: str) -> None:
        """Write a text file in UTF-8."""
        self.write_bytes(name, text.encode())

    def write_bytes(self, name: str, content: bytes) -> None:
        """Write a file."""
        write_atomically(self._with_folder(name), lambda part: part.write_bytes(content))

    def _with_folder(self, name: str) -> Path:
        """Return the path of a file, and create its folder inside this one."""
        file = self.path / name
        try:
            if self.path.is_dir():
                file.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(file, f"cannot be written ({error.strerror})") from None
        return file

    def _note(self, name: str, content: memoryview) -> None:
        """Record the digest of a table on a line of its own, even after a line that a full disk truncated."""
        digest = hashlib.blake2b(content, digest_size=DIGEST_BYTES).hexdigest()
        line = f"\n{json.dumps([name, digest])}\n".encode()
        with (self.path / LEDGER).open("ab", buffering=0) as opened:
            if opened.write(line) != len(line):
                raise OSError(28, "No space left on device")  # the error of the next attempt

    # ------------------------------------------------------------ reading

    def read(self, name: str) -> pl.DataFrame | None:
        """Read a Parquet table; return None if the file does not exist."""
        if not self.has(name):
            return None
        self._check(name)
        try:
            return pl.read_parquet(self.path / name)
        except (pl.exceptions.PolarsError, OSError):
            raise _damaged(self.path / name) from None

    def scan(self, names: list[str]) -> pl.LazyFrame:
        """Return the rows of at least one table, all with the same columns, as a lazy frame."""
        for name in names:
            self._check(name)
        return pl.scan_parquet([self.path / name for name in names], low_memory=True)

    def read_json(self, name: str) -> Any:
        """Read a JSON file; return None if it does not exist."""
        if not self.has(name):
            return None
        try:
            return json.loads((self.path / name).read_text(encoding="utf-8"))
        except ValueError:
            raise _damaged(self.path / name) from None

    # ------------------------------------------------------------ digests

    def verify(self) -> None:
        """Check every table, and that there are no others; record the tables of a version that recorded no digests."""
        ledger = self.path / LEDGER
        if not ledger.is_file():
            tables = [file for file in self.path.rglob("*.parquet") if not file.name.startswith(".")]
            lines = [json.dumps([self._name(file), _digest(file, *_state(file))]) for file in tables]
            write_atomically(ledger, lambda part: part.write_text("\n".join(lines), encoding="utf-8"))
        for folder in sorted({(self.path / name).parent for name in self._digests() or {}}):
            for file in sorted(folder.glob("*.parquet")):
                self._check(self._name(file))

    def _check(self, name: str) -> None:
        """Raise InvalidInput for a table that this run did not write, unless the run has no digests."""
        digests, file = self._digests(), self.path / name
        if digests is None:
            return
        if name not in digests:
            what = f"{file}, a table that this run did not write"
            raise InvalidInput("run", what, "only tables of this run; delete this file")
        try:
            digest = _digest(file, *_state(file))
        except OSError:
            raise _damaged(file) from None
        if digest != digests[name]:
            raise _damaged(file)

    def _digests(self) -> dict[str, str] | None:
        """Return the recorded digests by name; None without a list."""
        ledger = self.path / LEDGER
        try:
            return _entries(ledger, *_state(ledger))
        except OSError:
            return None

    def _name(self, file: Path) -> str:
        return file.relative_to(self.path).as_posix()


def _damaged(file: Path) -> InvalidInput:
    """Return the error of a damaged file."""
    return InvalidInput("run", f"{file}, damaged", "undamaged files; delete this file and repeat the run")


def _state(file: Path) -> tuple[int, int]:
    """Return modification time and size of a file, by which it is read again when it has changed."""
    stat = file.stat()
    return stat.st_mtime_ns, stat.st_size


@lru_cache(maxsize=1 << 16)
def _digest(file: Path, _time: int, _size: int) -> str:
    """Return the digest of a file."""
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, lambda: hashlib.blake2b(digest_size=DIGEST_BYTES)).hexdigest()


@lru_cache(maxsize=16)
def _entries(ledger: Path, _time: int, _size: int) -> dict[str, str]:
    """Return the digests of a list, without incomplete lines."""
    found = {}
    for line in ledger.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            name, digest = json.loads(line)
        except (ValueError, TypeError):
            continue
        found[str(name)] = str(digest)
    return found
