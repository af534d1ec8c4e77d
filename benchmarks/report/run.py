"""A run as the report reads it: its suite, the rows of its blocks by kind, and one colour for every entry."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from benchmarks.blocks.base import BlockRows, Outcome, load_kind
from benchmarks.experiments.base import UNTESTED, Finding
from benchmarks.records import MANIFEST, RunFolder
from benchmarks.report.base import load_report
from benchmarks.report.figures import Json, method_colour, method_dash, method_symbol
from benchmarks.report.tables import Table
from benchmarks.suite import Suite, suite_of
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.plugins.files import forbid_code, is_path
from optik.plugins.usage import collect_plugins
from optik.registry import short_name


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
            return suite_of(self.manifest["suite"], self.manifest["settings"])

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
    def begun(self) -> list[BlockRows]:
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
    def outcomes(self) -> list[Outcome]:
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
        from benchmarks.experiments.claims import judge

        return judge(self.folder)
