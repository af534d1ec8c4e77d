"""The interface of the report: a run as it reads it, sections, winners, and the report of a kind of block."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from benchmarks.blocks.base import GROUP, BlockRows, Kind, load_kind
from benchmarks.blocks.block import TargetOutcome
from benchmarks.experiments.base import UNTESTED, Finding
from benchmarks.records import MANIFEST, RunFolder, slug
from benchmarks.report.boards import Json, method_colour, method_dash, method_symbol
from benchmarks.report.tables import Column, Table, table_of
from benchmarks.statistics import is_too_few
from benchmarks.suite import Suite, drop_removed, suite_of
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.plugins.files import collect_plugins, forbid_code, is_path
from optik.registry import own_names, short_name

QUESTION = Path(__file__).parent / "templates" / "question.html.j2"
"""Template of a section that answers a question: an answer, plots, tables, then text."""


@dataclass(frozen=True)
class Winner:
    """The winner of a question and the other entries, for the first screen of the page."""

    question: str
    """As a reader asks it: "Solves the most targets, from one fixed start"."""
    unit: str
    better: str
    """``more`` or ``less``."""
    entries: tuple[tuple[str, float, float, float], ...]
    """Label, value, and the ends of its 95 % interval, of all that took part; the best first."""
    anchor: str
    """Anchor of the section with the details."""
    note: str = ""
    """Which problems, how many, and who is not ranked and why."""
    how: str = ""
    """What the intervals are, and by which test differences are found; the page shows it on request."""
    level: tuple[str, ...] | None = None
    """Labels of the best entry and of those not significantly different from it, if a paired test was made."""
    count: int | None = None
    """Number of problems or motions in the paired test."""

    @property
    def is_too_few(self) -> bool:
        """Whether the paired test cannot find a difference in so few values."""
        return self.count is not None and is_too_few(self.count, len(self.entries) - 1)

    @property
    def sample(self) -> str:
        """Number of values in the paired test, with a note if they are too few; empty without a test."""
        few = ": too few for a test" if self.is_too_few else ""
        return "" if self.count is None else f" (n = {self.count:,}{few})"

    @property
    def tied(self) -> tuple[str, ...]:
        """Labels of the best and of all not significantly different from it, by the paired test or overlapping intervals.

        With too few values for a test, entries are ranked by value: only those with the best value are listed.
        """
        _, best, low, high = self.entries[0]
        if self.is_too_few:
            return tuple(label for label, value, *_ in self.entries if value == best)
        if self.level is not None:
            return self.level
        return tuple(label for label, _, a, b in self.entries if a <= high and b >= low)


@dataclass(frozen=True)
class Section:
    """One section of the report, or one piece of a section: pieces with the same anchor have a common heading."""

    title: str
    anchor: str
    build: Callable[[Run], dict[str, Any] | None]
    """From the run to what the template shows (its ``c``); None where the run has no data for it."""
    template: Path = QUESTION
    order: int = 95
    """Position on the page, smaller first: 10 to 19 single calls, 20 time laws on many lines, 30 to 60 iteration budgets,
    70 to 90 one line planned, from 100 the appendix."""
    place: str = "section"
    """``section``; or ``top`` for a picture on the first screen, ``terms`` for definitions, ``summary`` for the
    settings of the run."""


def _nothing(run: Run) -> Sequence[Any]:
    return ()


@dataclass(frozen=True)
class KindReport:
    """The report of one kind of block. The kind's module in `report` names it ``REPORT``."""

    sections: tuple[Section, ...]
    subjects: Callable[[Sequence[Any]], Sequence[str]]
    """From its blocks to what they compare, for the first sentence of the report."""
    winners: Callable[[Run], Sequence[Winner]] = _nothing
    """Who is best at what, for the first screen."""
    tables: Callable[[Run], Sequence[Table]] = _nothing
    findings: Callable[[Run], Sequence[str]] = _nothing
    """Key findings for the head of the report, computed."""
    limitations: Callable[[Run], Sequence[str]] = _nothing
    """What a reader should know before quoting its figures."""
    labels: Callable[[Any], Sequence[str]] = lambda block: block.labels
    """Labels of a block that have a colour of their own on the page."""


def load_report(kind: Kind) -> KindReport:
    """Find the report of a kind of block: in this folder's module of its name, in its own module, or the plain one."""
    here = f"benchmarks.report.{kind.name}"
    module = import_module(here if kind.name in own_names(GROUP) and find_spec(here) else type(kind).__module__)
    found: KindReport | None = getattr(module, "REPORT", None)
    return found or plain_report(kind)


def plain_report(kind: Kind) -> KindReport:
    """Return the report of a kind that has none of its own: for each block a table of its measures, a row for each method."""
    columns = (Column("label", "Method", show="text"), *(one for one in kind.block.measures if not one.relative))

    def tables(run: Run) -> list[Table]:
        return [
            table_of(f"{kind.name}-{slug(b.block.id)}", b.block.title, columns,
                     (({"label": str(label)}, rows) for (label,), rows in b.rows.group_by("method", maintain_order=True)))
            for b in run.of(kind.name)
        ]  # fmt: skip

    def build(run: Run) -> dict[str, Any] | None:
        return {"tables": run.tables_of(kind.name)} if run.of(kind.name) else None

    section = Section(kind.title, kind.name, build)
    return KindReport((section,), lambda blocks: (kind.title.lower(),), tables=tables)


@dataclass(frozen=True)
class Run:
    """The data of the sections, from the folder of a run; each file is read once."""

    folder: RunFolder

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Content of ``run.json``; raises InvalidInput if the folder is no run."""
        return self.folder.manifest()

    @cached_property
    def suite(self) -> Suite:
        """The suite that was run."""
        with (
            collect_plugins(None),
            forbid_code(),
        ):  # its files may be gone, and a report runs no code that a suite names
            return suite_of(self.manifest["suite"], drop_removed(self.manifest["settings"]))

    def robot(self, name: str) -> Robot:
        """Return an arm of the suite: from the data stored in the run, or one that comes with optik."""
        stored = self.manifest.get("robots", {}).get(short_name(name))
        if stored is None and is_path(name):
            expected = (
                f"its data in {self.folder.path / MANIFEST}: a report opens no robot file; repeat the run to write it"
            )
            raise InvalidInput("robot", repr(name), expected)
        return load(name) if stored is None else Robot.from_dict(stored)

    @cached_property
    def _read(self) -> dict[str, list[Any]]:
        """Blocks that have rows, by kind."""
        found: dict[str, list[Any]] = {}
        for kind, block in self.suite.pairs():
            read = kind.read(self.folder, block)
            found.setdefault(kind.name, []).extend([] if read is None else [read])
        return found

    def of(self, kind: str) -> list[Any]:
        """Return the blocks of a kind that have rows."""
        return self._read.get(kind, [])

    @cached_property
    def _tables(self) -> dict[str, list[Table]]:
        return {}

    def tables_of(self, kind: str) -> list[Table]:
        """Return the tables of a kind, computed once."""
        if kind not in self._tables:
            self._tables[kind] = list(load_report(load_kind(kind)).tables(self))
        return self._tables[kind]

    @cached_property
    def blocks_with_rows(self) -> list[BlockRows]:
        """All blocks that have rows."""
        return [b for found in self._read.values() for b in found]

    @cached_property
    def labels(self) -> list[str]:
        """Everything with a colour on the page, each once: our methods first, then the peers, then the sweeps."""
        pairs = list(self.suite.pairs())
        peers = {entry.label for _, block in pairs for entry in block.entries if entry.role == "peer"}
        shown = [(block, load_report(kind).labels(block)) for kind, block in pairs]
        compared = dict.fromkeys(label for block, labels in shown if not block.is_sweep for label in labels)
        found = dict.fromkeys((*compared, *(label for _, labels in shown for label in labels)))
        return sorted(found, key=lambda label: (label not in compared, label in peers))

    def colour(self, label: str) -> str:
        """Return the colour of a method or law, the same on the whole page."""
        return method_colour(self.labels.index(label))

    def symbol(self, label: str) -> str:
        """Return the marker of a method or law."""
        return method_symbol(self.labels.index(label))

    def look(self, label: str) -> Json:
        """Return the look of the lines of a method or law."""
        return {"color": self.colour(label), "width": 2, "dash": method_dash(self.labels.index(label))}

    @cached_property
    def outcomes(self) -> list[TargetOutcome]:
        """Every target of the suite with its outcome."""
        return [outcome for kind, block in self.suite.pairs() for outcome in kind.outcomes(block, self.folder)]

    @cached_property
    def on_paper(self) -> bool:
        """Whether a block tests the paper's claims."""
        bears = any(kind.on_paper for kind, _ in self.suite.pairs())
        return bears and any(finding.verdict != UNTESTED for finding in self.findings)

    @cached_property
    def findings(self) -> list[Finding]:
        """Findings of the run on the paper's claims."""
        from benchmarks.experiments.claims import judge_claims

        return judge_claims(self.folder)
