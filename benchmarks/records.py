"""Run folders: the manifest, the tables with their digests, the failures, and the crash journals of timed blocks."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import shutil
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from io import FileIO
from pathlib import Path
from typing import Any, Self

from benchmarks.extras import polars as pl
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


FORMAT = "optik-run/4"
"""Name and version of the format of run folders, in ``run.json``."""

MANIFEST = "run.json"
"""File of the manifest."""

MANIFEST_KEYS = {"suite", "title", "fingerprint", "settings", "command", "provenance", "continued", "complete"}
"""Keys that the manifest must have."""


class RunFolder(Store):
    """A folder with ``run.json``, ``parts.jsonl`` and the tables of a run, one file for each part.

    No file is ever incomplete. To resume an interrupted run, run it again. ``parts.jsonl`` has the digest of every table. A
    table that is damaged, or that this run did not write, raises an error.

    Parameters
    ----------
    path : str or path-like
        The folder.
    """

    def manifest(self) -> dict[str, Any]:
        """Read ``run.json``.

        Returns
        -------
        dict
            Suite, settings, fingerprint and provenance of the run.

        Raises
        ------
        InvalidInput
            The folder is not a run of this format.
        """
        try:
            data = json.loads((self.path / MANIFEST).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            raise InvalidInput("run", str(self.path), "a folder written by optik bench run") from None
        if not isinstance(data, dict) or data.get("format") != FORMAT or not set(data) >= MANIFEST_KEYS:
            raise InvalidInput("run", f"{self.path}, a run of another format", f"a run of format {FORMAT}")
        return data

    def rows(self, kind: str, block: str) -> pl.DataFrame | None:
        """Return all rows of a block with the columns of its problems.

        ``known`` comes from the problem set; the solutions of the compared methods do not change it.

        Parameters
        ----------
        kind : str
            Name of the kind of block, such as ``calls``.
        block : str
            Id of the block.

        Returns
        -------
        DataFrame or None
            In the order of the parts, or by method, problem and budget where methods have a number; None if the block was
            not run.

        Raises
        ------
        InvalidInput
            A file is damaged.
        """
        parts = sorted(self.path.glob(rows_file(kind, block, "parquet", "*")))
        frames = [part for file in parts if (part := self.read(self._name(file))) is not None]
        if not frames:
            return None
        rows, problems = pl.concat(frames, how="vertical_relaxed"), self.read(f"problems/{slug(block)}.parquet")
        if problems is not None and rows["problem"].dtype.is_integer():  # a name is no problem of a table
            rows = rows.join(problems.drop("target", "start", strict=False), on="problem", maintain_order="left")
        keys = [key for key in ("method_index", "problem", "budget") if key in rows.columns]
        return rows.sort(keys, maintain_order=True) if "method_index" in keys else rows


def rows_file(kind: str, block: str, ending: str = "parquet", part: str = "") -> str:
    """Return the name of a file of a block in a run folder: of a part of its rows, or another one."""
    return f"rows/{slug(kind)}/{slug(block)}{'--' if part else ''}{part}.{ending}"


def failures(folder: RunFolder) -> list[dict[str, Any]]:
    """Return the recorded failures of a run."""
    found: list[dict[str, Any]] = (folder.read_json(MANIFEST) or {}).get("failed", [])
    return found


def record_failures(folder: RunFolder, file: str, label: str, reasons: Iterable[str]) -> None:
    """Record the failures of a method, or of a block, in a file in the manifest, in place of earlier ones."""
    before = failures(folder)
    others = [one for one in before if (one["file"], one["label"]) != (file, label)]
    now = [{"file": file, "label": label, "why": why, "times": n} for why, n in Counter(reasons).items()]
    if now or len(others) < len(before):
        update_manifest(folder, failed=others + now)


def update_manifest(folder: RunFolder, **entries: Any) -> None:
    """Replace entries of the manifest."""
    folder.write_json(MANIFEST, (folder.read_json(MANIFEST) or {}) | entries)


def slug(text: str) -> str:
    """Return a file name for a label: lower-case letters, digits, dots and dashes; λ and α are spelt out."""
    spelt = text.lower().replace("λ", "lambda").replace("α", "alpha")
    return re.sub(r"[^a-z0-9.]+", "-", spelt).strip("-")


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
