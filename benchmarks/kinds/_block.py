"""What a kind of suite block is made of: blocks, entries, parts of the work, rows, and sections of the report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars as pl

from benchmarks.records import RunFolder
from benchmarks.settings import Target

if TYPE_CHECKING:
    from benchmarks.report.run import Run


@dataclass(frozen=True, kw_only=True)
class Block:
    """One block of a suite; every kind adds what it needs.

    Attributes
    ----------
    id : str
        Names the block's files.
    title : str
        What reports call it.
    targets : tuple of Target
        What it is held to.
    """

    id: str
    title: str
    targets: tuple[Target, ...] = ()

    @property
    def sweep(self) -> bool:
        """Whether it varies the options of one method: what it compares takes no colour that a method needs."""
        return False

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the arms that it runs on."""
        return ()

    @property
    def entries(self) -> tuple[Entry, ...]:
        """What it compares, in the order of the suite."""
        return ()

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of all entries."""
        return tuple(entry.label for entry in self.entries)


@dataclass(frozen=True)
class Entry:
    """One thing that a block compares: a method or law of ours, or an outside one.

    Attributes
    ----------
    label : str
        What reports call it.
    name : str
        The name by which it is found.
    options : dict
        Its options.
    most : int or None
        How many problems a slow one is given; all where None.
    role : str
        ``ours``, ``law``, ``peer`` (an outside method) or ``reference``.
    whole : bool
        Whether each problem is one call with all that the method does by itself, where others make one attempt.
    along : bool
        Whether a method makes its iterations at each pose of a line, each from the pose before.
    without : tuple of str
        Limits that a law is not told of.
    """

    label: str
    name: str
    options: dict[str, Any]
    most: int | None = None
    role: str = "ours"
    whole: bool = False
    along: bool = False
    without: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Its options in words."""
        told = [f"without the limits on {' and '.join(self.without).replace('_', ' ')}"] if self.without else []
        return ", ".join([f"{key} = {value}" for key, value in self.options.items()] + told)


@dataclass(frozen=True)
class Part:
    """Work that any process may do, in any order: `Kind.solve` turns `work` into the rows of `file`.

    Attributes
    ----------
    file : str
        Where its rows go, in the run folder; a part whose file is there already is done.
    label : str
        What the progress bar shows.
    work : object
        What `Kind.solve` is given; it goes to another process, so it must be possible to pickle it.
    """

    file: str
    label: str
    work: Any


@dataclass(frozen=True)
class BlockRows:
    """A block with its rows, as the report reads them. A kind may give a subclass with more.

    Attributes
    ----------
    block : Block
        The block.
    rows : DataFrame
        All its rows.
    folder : RunFolder
        The run.
    facts : dict
        What is known of the block beside its rows; ``entries`` holds facts on each entry by label.
    """

    block: Any
    rows: pl.DataFrame
    folder: RunFolder
    facts: dict[str, Any]

    @cached_property
    def entries(self) -> dict[str, dict[str, Any]]:
        """Facts on every entry by label, in the order of the suite."""
        known = self.facts.get("entries", {})
        return {label: known[label] for label in self.block.labels if label in known}


@dataclass(frozen=True)
class Section:
    """One section of the report, or one piece of a section: pieces with the same anchor stand under one heading.

    Attributes
    ----------
    title, anchor : str
        Heading, and its address on the page.
    build : callable
        From the run to what the template shows (its ``c``); None where the run has no data for it.
    template : Path or str
        A Jinja template: its file, or its text.
    order : int
        Where it stands: smaller first. Ours: 10 to 19 single calls, 20 time laws on many lines, 30 to 60 iteration budgets, 70
        to 90 one line planned, 100 and above what closes the page.
    place : str
        ``section``; or ``top`` for a picture on the first screen, ``terms`` for what counts as solved, ``summary`` for what
        was run.
    """

    title: str
    anchor: str
    build: Callable[[Run], dict[str, Any] | None]
    template: Path | str
    order: int = 95
    place: str = "section"
