"""Tables of kinds that are not ours: stored when a run ends, so that the report needs none of their code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from benchmarks.kinds.base import KINDS, Block, Kind, Measure, Outcome, Target, load_kind
from benchmarks.records import RunFolder, slug
from optik.errors import UnknownName
from optik.plugins.files import is_path
from optik.registry import names, short_name

if TYPE_CHECKING:
    from benchmarks.report.run import Run

TABLE_ENDING = "table.json"
"""Ending of the file of a stored table."""

OURS = __name__.rpartition(".")[0]
"""The package whose kinds have sections of their own; their tables are not stored."""


def store_table(kind: Kind, block: Any, folder: RunFolder) -> None:
    """Write the table of a block of a kind that is not ours: its entries by its measures, and its targets."""
    if not type(kind).__module__.startswith(f"{OURS}."):
        folder.write_json(kind.file(block, TABLE_ENDING), table_of(kind, block, folder))


def table_of(kind: Kind, block: Any, folder: RunFolder) -> dict[str, Any]:
    """The table of a block as plain data."""
    rows = kind.rows(folder, block)
    measures = [m for m in kind.measures if not m.relative]
    return {
        "kind": kind.title,
        "title": block.title,
        "robots": [short_name(robot) for robot in block.robots],
        "heads": [_head(m) for m in measures],
        "rows": [] if rows is None else [_row(label, part, measures) for label, part in _by_entry(block, rows)],
        "targets": [_outcome(o) for o in kind.outcomes(block, folder)],
    }


def _head(measure: Measure) -> dict[str, Any]:
    return {"name": measure.name, "words": measure.title, "unit": measure.unit, "show": measure.show}


def _row(label: str, rows: pl.DataFrame, measures: Sequence[Measure]) -> dict[str, Any]:
    return {"label": label, "values": [[_plain(v) for v in measure.values(rows)] for measure in measures]}


def _plain(value: float) -> float | str:
    """A number as strict JSON has it."""
    return value if np.isfinite(value) else str(value)


def _by_entry(block: Any, rows: pl.DataFrame) -> list[tuple[str, pl.DataFrame]]:
    """Rows of each entry; all together where there are no entries."""
    if "method" not in rows.columns:
        return [(block.title, rows)]
    labels = rows["method"].unique(maintain_order=True).to_list()
    return [(str(label), rows.filter(pl.col("method") == label)) for label in labels]


def _outcome(o: Outcome) -> dict[str, Any]:
    return {"target": asdict(o.target), "measure": _head(o.measure), "value": _plain(o.value), "note": o.note}


# ---------------------------------------------------------------- where the kind is not available


def _nothing(rows: pl.DataFrame) -> float:
    """What a stored measure computes: it has no code, only its values are stored."""
    return float("nan")


def _measure(head: dict[str, Any]) -> Measure:
    return Measure(head["name"], head["unit"], _nothing, head["words"], show=head["show"])


@dataclass(frozen=True, kw_only=True)
class _StoredBlock(Block):
    arms: tuple[str, ...]

    @property
    def robots(self) -> tuple[str, ...]:
        return self.arms


class _Stored(Kind):
    """A kind whose code is not available, or must not run, and why: what a run has stored of its blocks."""

    def __init__(self, name: str, folder: RunFolder, why: str) -> None:
        self._folder, self.why = folder, why
        self.name = name  # type: ignore[misc]
        files = sorted((folder.path / self.folder).glob(f"*.{TABLE_ENDING}"))
        stored = folder.read_json(f"{self.folder}/{files[0].name}") if files else {}
        self.title = stored.get("kind", name.replace("_", " ").capitalize())  # type: ignore[misc]

    def settings(self, data: Any) -> Block:
        data = data if isinstance(data, dict) else {}
        name = str(data.get("id", slug(self.name)))
        stored = self._table(Block(id=name, title=name))
        arms = tuple(stored.get("robots", ()))
        return _StoredBlock(id=name, title=stored.get("title", str(data.get("title", name))), arms=arms)

    def outcomes(self, block: Block, folder: RunFolder) -> list[Outcome]:
        return [
            Outcome(
                block.id, block.title, Target(**one["target"]), _measure(one["measure"]), float(one["value"]), one["note"]
            )
            for one in self._table(block).get("targets", [])
        ]  # fmt: skip

    def _table(self, block: Block) -> dict[str, Any]:
        table: dict[str, Any] | None = self._folder.read_json(self.file(block, TABLE_ENDING))
        return table or {}


def kind_or_stored(name: str, folder: RunFolder) -> Kind:
    """A kind by its name; where it is not found, or comes from a file, what a run has stored of it.

    A kind that comes from a file is never loaded here: a report runs no code that a suite names.
    """
    if is_path(name):
        return _Stored(short_name(name), folder, "a report runs no code from a file that a suite names")
    try:
        return load_kind(name)
    except (UnknownName, ImportError) as error:
        return _Stored(name, folder, _package_words(name, folder) or f"{str(error).partition(';')[0]}")


def _package_words(name: str, folder: RunFolder) -> str:
    """Which package a kind came from as the run recorded it, where that package is not installed."""
    rows = (row for row in folder.manifest().get("plugins", []) if (row["group"], row["name"]) == (KINDS, name))
    package = next((row for row in rows if "distribution" in row), None)
    if package is None or name in names(KINDS):
        return ""
    return f"the package {package['distribution']} {package['version']}, which it comes from, is not installed"


def tables(kind: Kind, run: Run) -> list[tuple[Any, dict[str, Any] | None]]:
    """The table of every block of a kind: stored, or computed where its code is here."""
    found: list[tuple[Any, dict[str, Any] | None]] = []
    for block in run.suite.of(kind.name):
        table = run.folder.read_json(kind.file(block, TABLE_ENDING))
        if table is None and not why_stored(kind):
            table = table_of(kind, block, run.folder)
        found.append((block, table))
    return found


def why_stored(kind: Kind) -> str:
    """Why the code of a kind is not available."""
    return kind.why if isinstance(kind, _Stored) else ""
