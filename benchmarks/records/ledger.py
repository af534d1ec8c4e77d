"""The list of the tables that a run has written, with their digests, to detect damaged and foreign tables."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from optik.errors import InvalidInput
from optik.file_io import write_atomically

LEDGER = "parts.jsonl"
"""File of the list: one line of JSON per table, written before the table gets its name."""

DIGEST_BYTES = 16
"""Length of a digest: two tables that differ have the same one by chance once in 1e38 pairs."""


class Ledger:
    """The list of the tables of a run."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._file = folder / LEDGER
        self._digests: dict[str, str] = {}
        self._read_at: tuple[int, int] | None = None
        self._good: set[tuple[str, int, int]] = set()

    def begin(self) -> None:
        """Create the list if there is none, with the existing tables."""
        if not self._file.is_file():
            tables = [f for f in self._folder.rglob("*.parquet") if not f.name.startswith(".")]
            lines = [json.dumps([self._name(f), _digest(f)]) for f in tables]
            write_atomically(self._file, lambda part: part.write_text("\n".join(lines), encoding="utf-8"))

    def note(self, name: str, content: memoryview) -> None:
        """Add a table on a line of its own, even after a line that a full disk truncated."""
        line = f"\n{json.dumps([name, _short(content)])}\n".encode()
        with self._file.open("ab", buffering=0) as opened:
            if opened.write(line) != len(line):
                raise OSError(28, "No space left on device")  # the error of the next attempt

    def check(self, name: str) -> None:
        """Raise InvalidInput for a table that this run did not write, unless the run has no list."""
        digests, file = self._all(), self._folder / name
        if digests is None:
            return
        if name not in digests:
            raise InvalidInput(
                "run", f"{file}, a table that this run did not write", "only tables of this run; delete this file"
            )
        stat = file.stat()
        state = (name, stat.st_mtime_ns, stat.st_size)
        if state not in self._good:
            try:
                digest = _digest(file)
            except OSError:
                raise InvalidInput(*damaged(file)) from None
            if digest != digests[name]:
                raise InvalidInput(*damaged(file))
            self._good.add(state)

    def verify(self) -> None:
        """Check every table of the run, and that there are no others."""
        for folder in sorted({(self._folder / name).parent for name in self._all() or {}}):
            for file in sorted(folder.glob("*.parquet")):
                self.check(self._name(file))

    def _name(self, file: Path) -> str:
        return file.relative_to(self._folder).as_posix()

    def _all(self) -> dict[str, str] | None:
        """Return the digests by name, read again if the list has changed; None without a list."""
        try:
            stat = self._file.stat()
            if (stat.st_mtime_ns, stat.st_size) != self._read_at:
                lines = self._file.read_text(encoding="utf-8", errors="replace").splitlines()
                self._digests = dict(filter(None, map(_entry, lines)))
                self._read_at = (stat.st_mtime_ns, stat.st_size)
        except OSError:
            return None
        return self._digests


def damaged(file: Path) -> tuple[str, str, str]:
    """Return the arguments of `InvalidInput` for a damaged file of a run."""
    return "run", f"{file}, damaged", "undamaged files; delete this file and repeat the run"


def _short(content: memoryview) -> str:
    return hashlib.blake2b(content, digest_size=DIGEST_BYTES).hexdigest()


def _digest(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, lambda: hashlib.blake2b(digest_size=DIGEST_BYTES)).hexdigest()


def _entry(line: str) -> tuple[str, str] | None:
    """Return name and digest of a line; None if it is incomplete."""
    try:
        name, digest = json.loads(line)
    except (ValueError, TypeError):
        return None
    return str(name), str(digest)
