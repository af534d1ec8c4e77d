"""Run folders: the manifest, the failures and the rows of a run."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable
from typing import Any

import polars as pl

from benchmarks.records.store import Store
from optik.errors import InvalidInput

FORMAT = "optik-run/3"
"""Name and version of the format of run folders, in ``run.json``."""

MANIFEST = "run.json"
"""File of the manifest."""

MANIFEST_KEYS = {"suite", "title", "fingerprint", "settings", "command", "provenance", "continued", "complete"}
"""Keys that the manifest must have."""

LOCK = ".lock"
"""File of the lock that a writing process holds."""


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
        frames = [part for name in self.part_names(kind, block) if (part := self.read(name)) is not None]
        if not frames:
            return None
        rows, problems = pl.concat(frames, how="vertical_relaxed"), self.read(f"problems/{slug(block)}.parquet")
        if problems is not None and rows["problem"].dtype.is_integer():  # a name is no problem of a table
            rows = rows.join(problems.drop("target", "start", strict=False), on="problem", maintain_order="left")
        keys = [key for key in ("method_index", "problem", "budget") if key in rows.columns]
        return rows.sort(keys, maintain_order=True) if "method_index" in keys else rows

    def part_names(self, kind: str, block: str) -> list[str]:
        """Return the names of the parts of the rows of a block, for `scan`.

        Parameters
        ----------
        kind : str
            Name of the kind of block.
        block : str
            Id of the block.

        Returns
        -------
        list of str
            In order; empty where there are none.
        """
        parts = sorted(self.path.glob(rows_file(kind, block, "parquet", "*")))
        return [part.relative_to(self.path).as_posix() for part in parts]


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
