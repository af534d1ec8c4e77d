"""Failures of a run: methods, counts and reasons, in the section of their kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.blocks.base import Kind
from benchmarks.records import slug
from benchmarks.report.base import Cell, Column, Section, Table
from benchmarks.report.run import Run
from benchmarks.report.words import listed

_FAILURES = Path(__file__).parent / "templates" / "failures.html.j2"
"""Template of the table."""

FAILURE_COLUMNS = (
    Column("label", "Method", show="text"),
    Column("block", "Problems", show="text"),
    Column("times", "times", show="count"),
    Column("why", "why", show="text"),
    Column("files", "files with missing rows or crashes", show="count", aside=True),
)
"""Columns of the table of failures."""

Failures = list[dict[str, Any]]


def failures(run: Run) -> dict[str, Failures]:
    """Return the failures in `run.json` by the name of their block's kind."""
    found: dict[str, Failures] = {}
    for one in run.manifest.get("failed", []):
        kind, block = _whose(run, str(one["file"]))
        found.setdefault(kind.name, []).append({**one, "block": block})
    return found


def _whose(run: Run, file: str) -> tuple[Kind, str]:
    """Return the kind that wrote or should have written a file, and the title of the block."""
    pairs = list(run.suite.pairs())
    for kind, block in pairs:
        if file.startswith((kind.file(block), kind.file(block, "", "*").removesuffix("*."))):
            return kind, block.title
    return pairs[0][0], file.rpartition("/")[2]


def failure_table(kind: Kind, run: Run) -> Table | None:
    """Return the failures of a kind, each method and reason once."""
    counted: dict[tuple[str, str, str], list[int]] = {}
    for one in failures(run).get(kind.name, []):
        of = counted.setdefault((str(one["label"]), str(one["block"]), str(one["why"])), [0, 0])
        of[0] += int(one["times"])
        of[1] += 1
    rows: tuple[Mapping[str, Cell], ...] = tuple(
        {"label": label, "block": block, "why": why, "times": times, "files": files}
        for (label, block, why), (times, files) in counted.items()
    )
    note = "A part that fails is repeated in smaller pieces. Problems in which a method crashed count as not solved."
    return Table(f"failed-{slug(kind.name)}", f"{kind.title}: failures", FAILURE_COLUMNS, rows, note) if rows else None


def failure_section(kind: Kind, home: Section, run: Run) -> Section | None:
    """Return a piece of a kind's own section with the table of failures."""
    table = failure_table(kind, run)
    if table is None:
        return None
    return Section(home.title, home.anchor, lambda run: {"tables": [table]}, _FAILURES, home.order)


def home_of(kind: Kind, sections: Sequence[Section]) -> Section:
    """Return the report section that lists a kind's failures: the section with the kind's title, else its first one."""
    own = sorted((s for s in sections if s.place == "section"), key=lambda section: section.order)
    return next((section for section in own if section.title == kind.title), own[0])


def failure_words(run: Run) -> str:
    """Describe the failures in a sentence for the head of the report."""
    labels = dict.fromkeys(str(one["label"]) for found in failures(run).values() for one in found)
    return f"Failures or crashes: {listed(labels)}." if labels else ""
