"""A block as a suite's file defines it: its entries, targets and outcomes, and the columns of its tables."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import polars as pl
from pydantic import model_validator

from benchmarks.settings import LISTED, Flag, Settings, check_different, key, numbered, read
from benchmarks.statistics import median_interval, percentage, quantiles
from optik.arm.library import load
from optik.errors import InvalidInput
from optik.plugins.files import is_path, split_links
from optik.types import Array

# ---------------- columns of a table


Cell = str | float | int | None | tuple[float, float, float]
"""A value of a table: text, a number, None if there is none, or a value with the ends of its interval."""

Of = Callable[[pl.DataFrame], Cell]
"""Computation of a value from the rows of a group, such as those of one method."""

Condition = str | pl.Expr
"""A column of truth values, or an expression."""

What = Condition | Callable[[pl.DataFrame], Array]
"""Numbers of the rows: a column, an expression, or a function of the rows."""


@dataclass(frozen=True)
class Column:
    """A quantity, as a column of a table or a measure that a target names: key, heading, look, and computation."""

    key: str
    words: str
    unit: str = ""
    """Of its values; empty for text, counts and ratios."""
    better: str = ""
    """``more`` or ``less``, where one value is better than another; else empty."""
    show: str = "number"
    """``number`` (three digits), ``precise`` (four), ``exact`` (seven), ``limit`` (a value over its limit: above 1 with
    enough digits to differ from 1), ``p`` (a p-value), ``count``, ``share`` (a percentage), ``text``, ``verdict`` (met or
    missed), or ``mixed``: what the row's ``show`` says, else a percentage where its ``unit`` is %, else a number."""
    aside: bool = False
    """Whether the page shows it only on request: for columns that few readers ask for."""
    among: str = ""
    """Key of a column that must not be empty for a row to be marked best; without a key, any row may be.
    A motion that exceeds a limit must not be called the shortest."""
    of: Callable[..., Any] | None = None
    """From the rows of a group to its value; None where the value is given. If `relative`, it also takes two labels."""
    relative: bool = False
    """Whether the value compares an entry with a second one, the ``to`` of a target."""

    @property
    def is_text(self) -> bool:
        """Whether its values are words, which stand at the left."""
        return self.show in ("text", "verdict")

    def value(self, rows: pl.DataFrame, *labels: str) -> float:
        """Return the computed value as a number, without its interval; NaN if there is none."""
        found = None if self.of is None else self.of(rows, *labels)
        first = found[0] if isinstance(found, tuple) else found
        return float("nan") if first is None else float(first)

    @property
    def head(self) -> str:
        """The heading with the unit."""
        return f"{self.words} [{self.unit}]" if self.unit else self.words


# ---------------------------------------------------------------- computations


def values_of(rows: pl.DataFrame, what: What) -> Array:
    """Return the numbers of a column or an expression, without those that are missing."""
    if callable(what):
        return what(rows)
    return rows.select(what).to_series().drop_nulls().cast(pl.Float64).to_numpy()


def count_of(rows: pl.DataFrame, what: Condition) -> int:
    """Return the number of rows at which a condition is true."""
    return int(rows.select(what).to_series().cast(pl.Boolean).sum())


def _statistic(compute: Callable[[Array], Any], what: What, scale: float, among: Condition | None) -> Of:
    def of(rows: pl.DataFrame) -> float | None:
        found = values_of(rows if among is None else rows.filter(among), what)
        return scale * float(compute(found)) if len(found) else None

    return of


def median(what: What, scale: float = 1.0, *, among: Condition | None = None) -> Of:
    """Return the computation of the median; of no values it is None."""
    return _statistic(np.median, what, scale, among)


def mean(what: What, scale: float = 1.0, *, among: Condition | None = None) -> Of:
    """Return the computation of the mean; of no values it is None."""
    return _statistic(np.mean, what, scale, among)


def largest(what: What, scale: float = 1.0, *, among: Condition | None = None) -> Of:
    """Return the computation of the largest value; of no values it is None."""
    return _statistic(np.max, what, scale, among)


def quantile(what: What, level: float, scale: float = 1.0, *, among: Condition | None = None) -> Of:
    """Return the computation of a quantile, which infinite values do not make NaN; of no values it is NaN."""

    def of(rows: pl.DataFrame) -> float:
        return scale * quantiles(values_of(rows if among is None else rows.filter(among), what), (level,))[0]

    return of


def median_with_interval(what: What) -> Of:
    """Return the computation of the median with its bootstrap interval."""
    return lambda rows: median_interval(values_of(rows, what))


def median_with_range(what: What) -> Of:
    """Return the computation of the median with the least and the largest value."""

    def of(rows: pl.DataFrame) -> tuple[float, float, float]:
        found = values_of(rows, what)
        return float(np.median(found)), float(found.min()), float(found.max())

    return of


def count(what: Condition) -> Of:
    """Return the computation of the number of rows at which a condition is true."""
    return lambda rows: count_of(rows, what)


def share(what: Condition, *, among: Condition | None = None) -> Of:
    """Return the computation of the percentage of rows at which a condition is true, with Wilson's interval."""

    def of(rows: pl.DataFrame) -> Cell:
        chosen = rows if among is None else rows.filter(among)
        return percentage(count_of(chosen, what), len(chosen)) if len(chosen) else None

    return of


# ---------------- a block as a suite's file defines it


def measure_named(measures: Sequence[Column], name: str, where: str) -> Column:
    """Find a measure by its name; text columns are not measures."""
    measures = [measure for measure in measures if not measure.is_text]
    found = next((measure for measure in measures if measure.key == name), None)
    if found is None:
        raise InvalidInput(where, f"measure {name!r}", f"one of {', '.join(measure.key for measure in measures)}")
    return found


class Target(Settings):
    """A bound on a measure of a block."""

    measure: str = key("Measure of the block; the end of its name is the unit.")
    method: str = key("Label of the entry that the bound applies to; by default the first.", "")
    to: str = key("Label of the entry whose value is the denominator of a ratio.", "")
    group: str = key("Part of the problems: a kind of motions, a robot, or the label of limits; by default all.", "")
    at_most: Annotated[float | None, numbered("a number")] = key("Largest value; give one of the two bounds.", None)
    at_least: Annotated[float | None, numbered("a number")] = key("Least value; give one of the two bounds.", None)
    goal: Flag = key("Whether the bound is only a goal: the run does not fail if it is missed.", False)

    @model_validator(mode="after")
    def _one_bound(self) -> Target:
        if (self.at_most is None) == (self.at_least is None):
            others = sorted(self.model_fields_set - {"measure"})
            raise InvalidInput("", f"{self.measure} with {others}", "either at_most or at_least")
        return self

    def fitted(
        self, where: str, measures: tuple[Column, ...], labels: tuple[str, ...], groups: tuple[str, ...]
    ) -> Target:
        """Check a target against its block and return it; without a named entry it applies to the first."""
        at = f"{where}: targets"
        measure = measure_named(measures, self.measure, at)
        method = self.method or (labels[0] if labels and "method" not in self.model_fields_set else "")
        if (self.to != "") != measure.relative:
            relative = ", ".join(m.key for m in measures if m.relative) or "no measure of this block"
            came = f"{measure.key} with `to` = {self.to!r}" if self.to else f"{measure.key} without `to`"
            raise InvalidInput(at, came, f"`to` for {relative}, and only there")
        for name in (method, self.to):
            if name and name not in labels:
                raise InvalidInput(at, repr(name), f"a label of the block: {', '.join(labels) or 'it has none'}")
        if self.group and self.group not in groups:
            raise InvalidInput(at, f"group {self.group!r}", f"one of {', '.join(groups) or 'none: it has no groups'}")
        return self.model_copy(update={"method": method})


@dataclass(frozen=True)
class TargetOutcome:
    """One target of a block, with its id and title, and its outcome."""

    block: str
    where: str
    target: Target
    measure: Column
    value: float  # NaN where there is none
    note: str  # how many rows the value is computed from, or why there is none

    @property
    def held(self) -> bool | None:
        """Whether the bound is met; None if nothing was measured."""
        if np.isnan(self.value):
            return None
        if self.target.at_most is not None:
            return self.value <= self.target.at_most
        assert self.target.at_least is not None
        return self.value >= self.target.at_least

    @property
    def asked(self) -> str:
        """The bound as text: ≤ 8 or ≥ 99.99."""
        bound = self.target.at_most if self.target.at_most is not None else self.target.at_least
        return f"{'≤' if self.target.at_most is not None else '≥'} {bound:g}"

    @property
    def what(self) -> str:
        """The measure in words, with the entry and the group of problems that the target names."""
        of = f"{self.target.method}: " if self.target.method else ""
        group = f", {self.target.group.replace('_', '-')}" if self.target.group else ""
        return f"{of}{self.measure.words}{' ' + self.target.to if self.target.to else ''}{group}"

    @property
    def unit(self) -> str:
        """Unit of the value and of the bound."""
        return self.measure.unit


class Block(Settings):
    """One block of a suite, as its file defines it."""

    noun: ClassVar[str] = "block"
    """Name of the block in errors, before its id."""
    measures: ClassVar[tuple[Column, ...]] = ()
    """Measures that its targets can name."""
    not_problems: ClassVar[frozenset[str]] = frozenset()
    """Further settings that do not change its problems."""

    id: str = key("Names the block's files.")
    title: str = key("Name of the block in reports; by default the title of its kind, followed by the id.", "")
    targets: Annotated[tuple[Target, ...], LISTED] = key("Bounds that the report checks.", ())

    @classmethod
    def read(cls, data: Any) -> Self:
        """Check the table of a suite's file."""
        where = f"{cls.noun} {data.get('id', '')!r}".removesuffix(" ''") if isinstance(data, dict) else cls.noun
        block = read(cls, data, where)
        check_different(list(block.labels), where, "label")
        targets = tuple(target.fitted(where, block.measures, block.labels, block.groups) for target in block.targets)
        return block.model_copy(update={"targets": targets})

    @property
    def is_sweep(self) -> bool:
        """Whether the block varies the options of one method; its entries then have no colour of their own."""
        return bool(getattr(self, "sweep", False))

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the arms of the block."""
        return (self.robot,) if hasattr(self, "robot") else ()

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Methods, laws and peers that the block compares, in the order of the suite."""
        given = (entry for group in ("methods", "laws", "peers") for entry in getattr(self, group, ()))
        return tuple(entry for entry in given if isinstance(entry, Entry))

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of all entries."""
        return tuple(entry.label for entry in self.entries)

    @property
    def groups(self) -> tuple[str, ...]:
        """Groups of its problems that a target can name."""
        return ()


NOT_PROBLEMS = frozenset({
    "id", "title", "targets", "methods", "laws", "peers", "solvers", "budgets", "sweep", "rounds", "repeats", "reference",
    "evaluation_budgets", "example",
})  # fmt: skip
"""Settings of blocks that do not change their problems."""


def hash_problems(block: Block, seed: int) -> str:
    """Return the SHA-256 of what makes the problems of a block: its settings, the content of its arms and files, the seed."""
    given = block.model_dump(mode="json", exclude=set(NOT_PROBLEMS | block.not_problems))
    content = [block.noun, seed, _with_content(given), [load(name).to_dict() for name in block.robots]]
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


def _with_content(value: Any) -> Any:
    """Return settings with the digest of each file in place of its path."""
    if isinstance(value, dict):
        return {key: _with_content(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_with_content(inner) for inner in value]
    if isinstance(value, str) and is_path(value) and (file := Path(split_links(value)[0])).is_file():
        return hashlib.sha256(file.read_bytes()).hexdigest() + split_links(value)[1]
    return value


@dataclass(frozen=True)
class Entry:
    """One entry of a block: a method or law of ours, or a peer."""

    label: str  # name in reports
    name: str  # by which it is found, or the path of its file
    options: dict[str, Any]
    most: int | None = None  # number of problems that a slow one is given; None for all
    role: str = "ours"  # ours, law, peer or reference
    whole: bool = False  # each problem is one call with restarts, where others make one attempt
    along: bool = False  # a method iterates at each pose of a line, each from the pose before
    without: tuple[str, ...] = ()  # limits that are hidden from a law

    @property
    def words(self) -> str:
        """Its options in words."""
        told = [f"without the limits on {' and '.join(self.without).replace('_', ' ')}"] if self.without else []
        return ", ".join([f"{key} = {value}" for key, value in self.options.items()] + told)

    def ending_after(self, budget: int | None) -> Entry:
        """Return the entry with one attempt of some iterations per problem; one with its own settings is unchanged."""
        if self.whole or budget is None:
            return self
        limit = {"iterations": budget} if self.role == "peer" else {"max_iterations": budget, "max_restarts": 0}
        return replace(self, options=self.options | limit)
