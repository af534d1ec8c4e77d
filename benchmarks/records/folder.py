"""Run folders: write the files of a run, each completely or not at all, and read them."""

from __future__ import annotations

import io
import json
import os
import re
from pathlib import Path
from typing import Any

import polars as pl

from benchmarks.records.ledger import LEDGER, Ledger, damaged
from optik.errors import InvalidInput, OutputError
from optik.file_io import write_atomically
from optik.plugins.usage import check_same_plugins

FORMAT = "optik-run/2"
"""Name and version of the format of run folders, in ``run.json``."""
MANIFEST_KEYS = {"suite", "title", "fingerprint", "settings", "command", "provenance", "continued", "complete"}
"""Keys that ``run.json`` must have."""


LOCK = ".lock"
"""File of the lock that a writing process holds."""

ARMS = "robots.json"
"""File of the robots that do not come with optik, by their names in reports; missing if there are none."""


class RunFolder:
    """A folder with ``run.json``, ``parts.jsonl``, ``problems/``, ``ik/``, ``line/``, ``speed/`` and ``timing/``.

    Every file is written under a temporary name and then renamed, so that no file is ever incomplete. To resume an
    interrupted run, run it again. ``parts.jsonl`` has the digest of every table. A table that is damaged, or that this run
    did not write, raises an error. Files are not flushed to the disk one by one: after a power failure, the digest reveals a
    truncated table.

    Parameters
    ----------
    path : str or path-like
        The folder; `create` makes it.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._ledger = Ledger(self.path)

    # ------------------------------------------------------------ opening

    def create(self, manifest: dict[str, Any]) -> dict[str, Any]:
        """Start a run in this folder, or resume one with the same settings.

        A resumed run keeps the provenance of its first session and appends that of every later session, until the run
        is complete.

        Parameters
        ----------
        manifest : dict
            Content of ``run.json`` for a new run.

        Returns
        -------
        dict
            Content of ``run.json`` as it is now.

        Raises
        ------
        OutputError
            The folder cannot be written, or contains a run with other settings or files that are not of a run.
        """
        try:
            manifest = self.checked(manifest)
            for folder in ("problems", "ik", "line", "speed", "timing"):
                (self.path / folder).mkdir(parents=True, exist_ok=True)
            for left in self.path.rglob(".*.part"):  # from a process that was killed while writing
                left.unlink(missing_ok=True)
            self.write_json("run.json", manifest)
            self._ledger.begin()
            self._ledger.verify()
            return manifest
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(self.path, f"cannot be written ({error.strerror})") from None

    def checked(self, manifest: dict[str, Any]) -> dict[str, Any]:
        """Return the manifest as `create` would, without writing anything.

        Parameters
        ----------
        manifest : dict
            Content of ``run.json`` for a new run.

        Returns
        -------
        dict
            Content of ``run.json`` as `create` would leave it.

        Raises
        ------
        OutputError
            The path is a file, or a folder with a run with other settings or with files that are not of a run.
        InvalidInput
            The run was begun with another version of a plug-in.
        """
        if self.path.exists() and not self.path.is_dir():
            raise OutputError(self.path, "is a file; choose a folder for the run")
        return manifest if self.empty else self._continued(manifest)

    @property
    def empty(self) -> bool:
        """Whether the folder has no files, except those of a run that was killed at its start."""
        ours = re.compile(rf"{re.escape(LOCK)}|\.[0-9a-f]{{12}}\.part")
        return not self.path.is_dir() or all(ours.fullmatch(one.name) for one in self.path.iterdir())

    @property
    def begun(self) -> bool:
        """Whether any table has been written."""
        return any(self.path.rglob("*.parquet"))

    def discard(self) -> None:
        """Remove the files and folders that `create` made, if the run has no others."""
        for name in ("run.json", LEDGER):
            (self.path / name).unlink(missing_ok=True)
        for folder in ("problems", "ik", "line", "speed", "timing"):
            if (self.path / folder).is_dir() and not any((self.path / folder).iterdir()):
                (self.path / folder).rmdir()

    def _continued(self, manifest: dict[str, Any]) -> dict[str, Any]:
        if not (self.path / "run.json").is_file():
            raise OutputError(self.path, "contains something else; choose a new or empty folder for the run")
        old = self.manifest()
        if old.get("fingerprint") != manifest["fingerprint"]:
            raise OutputError(
                self.path, f"contains a run of {old.get('suite')!r} with other settings; choose another folder"
            )
        check_same_plugins(old.get("plugins", []), manifest.get("plugins", []))
        return old if old["complete"] else old | {"continued": _with(old["continued"], manifest["provenance"])}

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
            data = json.loads((self.path / "run.json").read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            raise InvalidInput("run", str(self.path), "a folder written by optik bench run") from None
        if not isinstance(data, dict) or data.get("format") != FORMAT or not set(data) >= MANIFEST_KEYS:
            raise InvalidInput("run", f"{self.path}, a run of another format", f"a run of format {FORMAT}")
        return data

    # ------------------------------------------------------------ writing

    def has(self, name: str) -> bool:
        """Say whether a file exists.

        Parameters
        ----------
        name : str
            Path of the file, relative to the run folder.

        Returns
        -------
        bool
            Whether it exists.
        """
        return (self.path / name).is_file()

    def write(self, name: str, frame: pl.DataFrame) -> None:
        """Write a table as Parquet.

        Parameters
        ----------
        name : str
            Path of the file, relative to the run folder.
        frame : DataFrame
            The table.
        """
        self._make_room(name)
        content = io.BytesIO()
        frame.write_parquet(content)

        def save(part: Path) -> None:
            part.write_bytes(content.getbuffer())
            self._ledger.note(name, content.getbuffer())  # before the file has its name: no table without its line

        write_atomically(self.path / name, save)

    def write_json(self, name: str, data: Any) -> None:
        """Write plain data as strict JSON.

        Parameters
        ----------
        name : str
            Path of the file, relative to the run folder.
        data : Any
            Dictionaries, lists, text, finite numbers, truth values and None.
        """
        self._make_room(name)
        write_atomically(
            self.path / name,
            lambda part: part.write_text(json.dumps(data, allow_nan=False, indent=1), encoding="utf-8"),
        )

    def write_text(self, name: str, text: str) -> None:
        """Write a text file in UTF-8, its folder too.

        Parameters
        ----------
        name : str
            Path of the file, relative to the run folder.
        text : str
            Its content.

        Raises
        ------
        OutputError
            It cannot be written.
        """
        self._make_room(name)
        write_atomically(self.path / name, lambda part: part.write_text(text, encoding="utf-8"))

    def _make_room(self, name: str) -> None:
        """Create the folder of a file inside this one; `create` makes this one."""
        if self.path.is_dir():
            try:
                (self.path / name).parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise OutputError(self.path / name, f"cannot be written ({error.strerror})") from None

    # ------------------------------------------------------------ reading

    def read(self, name: str) -> pl.DataFrame | None:
        """Read a Parquet table.

        Parameters
        ----------
        name : str
            Path of the file, relative to the run folder.

        Returns
        -------
        DataFrame or None
            The table; None if the file does not exist.

        Raises
        ------
        InvalidInput
            The file is damaged.
        """
        if not self.has(name):
            return None
        self._ledger.check(name)
        try:
            return pl.read_parquet(self.path / name)
        except (pl.exceptions.PolarsError, OSError):
            raise InvalidInput(*damaged(self.path / name)) from None

    def read_json(self, name: str) -> Any:
        """Read a JSON file.

        Parameters
        ----------
        name : str
            Path of the file, relative to the run folder.

        Returns
        -------
        Any
            Its content; None if the file does not exist.

        Raises
        ------
        InvalidInput
            The file is damaged.
        """
        if not self.has(name):
            return None
        try:
            return json.loads((self.path / name).read_text(encoding="utf-8"))
        except ValueError:
            raise InvalidInput(*damaged(self.path / name)) from None

    def scan(self, names: list[str]) -> pl.LazyFrame:
        """Return the rows of tables with the same columns as a lazy frame.

        Parameters
        ----------
        names : list of str
            Paths of the files, relative to the run folder; at least one.

        Returns
        -------
        LazyFrame
            All their rows.

        Raises
        ------
        InvalidInput
            A file is damaged, or was not written by this run.
        """
        for name in names:
            self._ledger.check(name)
        return pl.scan_parquet([self.path / name for name in names], low_memory=True)

    # ------------------------------------------------------------ all rows of a block

    def part_names(self, top: str, block: str) -> list[str]:
        """Return the names of the parts of a block, ``TOP/BLOCK--….parquet``.

        Parameters
        ----------
        top : str
            Folder of the parts.
        block : str
            Id of the block.

        Returns
        -------
        list of str
            In order; empty where there are none.
        """
        return [f"{top}/{file.name}" for file in sorted((self.path / top).glob(f"{slug(block)}--*.parquet"))]

    def parts(self, top: str, block: str) -> pl.DataFrame | None:
        """Return all rows of a block from its parts, ``TOP/BLOCK--….parquet``.

        Parameters
        ----------
        top : str
            Folder of the parts.
        block : str
            Id of the block.

        Returns
        -------
        DataFrame or None
            In the order of the parts; None where there are none.

        Raises
        ------
        InvalidInput
            A part is damaged.
        """
        frames = [part for name in self.part_names(top, block) if (part := self.read(name)) is not None]
        return pl.concat(frames, how="vertical_relaxed") if frames else None

    def rows(self, block: str) -> pl.DataFrame | None:
        """Return all IK rows of a block, joined with its problems, sorted by method, problem and budget.

        ``known`` comes from the problem set; the solutions of the compared methods do not change it.

        Parameters
        ----------
        block : str
            Name of the block.

        Returns
        -------
        DataFrame or None
            One row per method, problem and budget; None if the block was not run.

        Raises
        ------
        InvalidInput
            A file is damaged, or the problems of the block are missing.
        """
        rows = self.parts("ik", block)
        problems = self.read(f"problems/{slug(block)}.parquet")
        if rows is None:
            return None
        if problems is None:
            raise InvalidInput(
                "run", f"no problems of the block {block!r}", "a complete run; delete ik/ and repeat the run"
            )
        joined = rows.join(problems.drop("target", "start"), on="problem")
        return joined.sort("method_index", "problem", "budget")


def _with(sessions: list[dict[str, Any]], now: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the sessions of a run with one more; if it equals the last one, increase the count ``sessions`` of that."""
    apart = ("created", "sessions")
    if sessions and all(sessions[-1].get(key) == now[key] for key in now if key not in apart):
        return [*sessions[:-1], sessions[-1] | {"sessions": sessions[-1].get("sessions", 1) + 1}]
    return [*sessions, now]


def slug(text: str) -> str:
    """Return a file name for a label: lower-case letters, digits, dots and dashes; λ and α are spelt out."""
    spelt = text.lower().replace("λ", "lambda").replace("α", "alpha")
    return re.sub(r"[^a-z0-9.]+", "-", spelt).strip("-")
