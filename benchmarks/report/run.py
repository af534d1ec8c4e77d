"""A run as the report reads it: its suite, the rows of its blocks, and one colour for every method and law."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import polars as pl

from benchmarks.experiments.base import Finding
from benchmarks.metrics import paired
from benchmarks.records import RunFolder
from benchmarks.report.figures import colour, law_colours
from benchmarks.speed import speed_facts, speed_rows
from benchmarks.speed_suite import SpeedBlock
from benchmarks.suite import Block, Suite, suite_of
from benchmarks.timing import example_part
from benchmarks.timing_rows import timing_facts, timing_rows
from benchmarks.timing_suite import TimingBlock


@dataclass(frozen=True)
class Run:
    """What the sections are computed from; each part is read once."""

    folder: RunFolder

    @cached_property
    def manifest(self) -> dict[str, Any]:
        """Content of ``run.json``; InvalidInput where the folder is no run."""
        return self.folder.manifest()

    @cached_property
    def suite(self) -> Suite:
        """The suite that was run."""
        return suite_of(self.manifest["suite"], self.manifest["settings"])

    @cached_property
    def blocks(self) -> list[BlockRows]:
        """Blocks that have rows."""
        out = []
        for block in self.suite.blocks:
            rows = self.folder.rows(block.id)
            if rows is not None:
                out.append(BlockRows(block, rows))
        return out

    @cached_property
    def speed(self) -> list[SpeedRows]:
        """Blocks of single calls that have rows."""
        out = []
        for block in self.suite.speed:
            rows = speed_rows(self.folder, block)
            if rows is not None:
                out.append(SpeedRows(block, rows, speed_facts(self.folder, block)))
        return out

    def speed_colour(self, label: str) -> str:
        """Colour of a method or peer where calls are timed: ours first, then the peers, the same in every block."""
        ours = dict.fromkeys(m.label for b in self.suite.speed for m in b.methods)
        peers = dict.fromkeys(p.label for b in self.suite.speed for p in b.peers)
        return colour(list(ours | peers).index(label))

    @cached_property
    def timing(self) -> list[TimingRows]:
        """Blocks of timed lines that have rows."""
        out = []
        for block in self.suite.timing:
            rows = timing_rows(self.folder, block)
            if rows is not None:
                out.append(TimingRows(block, rows, timing_facts(self.folder, block), self.folder))
        return out

    def timing_colour(self, label: str) -> str:
        """Colour of a time law or peer on many lines: ours first, then the peers, the same in every block."""
        ours = dict.fromkeys(law.label for b in self.suite.timing for law in b.laws)
        peers = dict.fromkeys(peer.label for b in self.suite.timing for peer in b.peers)
        return colour(list(ours | peers).index(label))

    @cached_property
    def comparisons(self) -> list[BlockRows]:
        """Blocks that compare methods; where there are none, all: sweeps of one method's options are the others."""
        return [b for b in self.blocks if not b.sweep] or self.blocks

    @cached_property
    def plans(self) -> list[dict[str, Any]]:
        """The line by every IK method and law."""
        return list(self.folder.read_json("line/plans.json") or [])

    @cached_property
    def solved_plans(self) -> list[dict[str, Any]]:
        """Those that have a trajectory."""
        return [p for p in self.plans if p["status"] == "solved"]

    @cached_property
    def findings(self) -> list[Finding]:
        """What the run says of the paper's claims."""
        from benchmarks.experiments.claims import judge

        return judge(self.folder)

    @cached_property
    def method_colours(self) -> dict[str, int]:
        """Index of a method's colour and symbol, the same wherever it is shown."""
        labels = dict.fromkeys(m.label for b in (*self.comparisons, *self.blocks) for m in b.block.methods)
        return {label: i for i, label in enumerate(labels)}

    def method_colour(self, label: str) -> str:
        """Colour of a method."""
        return colour(self.method_colours[label])

    @cached_property
    def law_colours(self) -> dict[str, str]:
        """Colour of a time law."""
        return law_colours(p["law"] for p in self.plans)


@dataclass(frozen=True)
class SpeedRows:
    """A block of single calls, its rows, and the facts on who took part."""

    block: SpeedBlock
    rows: pl.DataFrame
    facts: dict[str, Any]

    @cached_property
    def entries(self) -> dict[str, dict[str, Any]]:
        """Facts on every method and peer by label, in the suite's order."""
        known = self.facts["entries"]
        return {label: known[label] for label in self.block.labels if label in known}


@dataclass(frozen=True)
class TimingRows:
    """A block of timed lines, its rows, and the facts on who took part."""

    block: TimingBlock
    rows: pl.DataFrame
    facts: dict[str, Any]
    folder: RunFolder

    @cached_property
    def entries(self) -> dict[str, dict[str, Any]]:
        """Facts on every law and peer by label, in the suite's order; the reference apart."""
        known = self.facts["entries"]
        return {label: known[label] for label in self.block.labels if label in known}

    def example(self, name: str) -> pl.DataFrame | None:
        """A part of the line that is looked at closely."""
        return self.folder.read(example_part(self.block, name))


@dataclass(frozen=True)
class BlockRows:
    """A block and its rows."""

    block: Block
    rows: pl.DataFrame

    @property
    def sweep(self) -> bool:
        """Whether it varies the options of one method instead of comparing methods."""
        return self.block.sweep

    @cached_property
    def methods(self) -> list[str]:
        """Labels of the methods that have rows, in the suite's order."""
        return self.rows["method"].unique(maintain_order=True).to_list()

    @cached_property
    def budget(self) -> int:
        """The largest budget."""
        return self.block.budgets[-1]

    @cached_property
    def last(self) -> pl.DataFrame:
        """Rows at the largest budget."""
        return self.rows.filter(pl.col("budget") == self.budget)

    @cached_property
    def paired(self) -> pl.DataFrame:
        """Rows of the problems that every method was run on."""
        return paired(self.rows)

    @cached_property
    def known(self) -> pl.DataFrame:
        """Rows of the problems with a known solution."""
        return self.rows.filter("known")

    def problems(self) -> tuple[int, int]:
        """How many problems, and how many of them have a known solution."""
        first = self.rows.unique("problem")
        return len(first), int(first["known"].sum())
