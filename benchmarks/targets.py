"""Measures of a block, the targets that a suite sets for them, and their outcomes in a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import polars as pl
from pydantic import model_validator

from benchmarks.settings import Flag, Settings, key, numbered
from optik.errors import InvalidInput


@dataclass(frozen=True)
class Measure:
    """A figure of merit: its name, its unit, its computation and its format."""

    name: str  # what a suite calls it in a target
    unit: str  # of all its values; empty for a ratio or a count
    # from the rows of one entry to the value, or one value for each of `parts`; relative: of both entries, and their labels
    compute: Callable[..., Any]
    words: str = ""  # what reports call it; by default its name
    show: str = "number"  # with three digits, exact (seven), count, or share (a percentage with its interval)
    relative: bool = False  # it compares with a second entry, the `to` of a target

    @property
    def title(self) -> str:
        """Title in reports."""
        return self.words or self.name

    def values(self, rows: pl.DataFrame) -> tuple[float, ...]:
        """Return all values of the measure on the rows of one entry."""
        found = self.compute(rows)
        return tuple(
            float("nan" if value is None else value) for value in (found if isinstance(found, tuple) else (found,))
        )


def measure_named(measures: Sequence[Measure], name: str, where: str) -> Measure:
    """Find a measure by its name."""
    found = next((measure for measure in measures if measure.name == name), None)
    if found is None:
        raise InvalidInput(where, f"measure {name!r}", f"one of {', '.join(measure.name for measure in measures)}")
    return found


class Target(Settings):
    """A bound on a measure of a block."""

    measure: str = key("Measure of the block; the end of its name is the unit.")
    method: str = key("Label of the entry that the bound applies to; by default the first.", "")
    to: str = key("Label of the entry whose value is the denominator of a ratio.", "")
    group: str = key("Part of the problems: a kind of motions, a robot, or the label of limits; by default all.", "")
    at_most: Annotated[float | None, numbered("a number")] = key("Largest value; give one of the two bounds.", None)
    at_least: Annotated[float | None, numbered("a number")] = key("Least value; give one of the two bounds.", None)
    goal: Flag = key("Whether a missed bound is no failure.", False)

    @model_validator(mode="after")
    def _one_bound(self) -> Target:
        if (self.at_most is None) == (self.at_least is None):
            others = sorted(self.model_fields_set - {"measure"})
            raise InvalidInput("", f"{self.measure} with {others}", "either at_most or at_least")
        return self

    def fitted(
        self, where: str, measures: tuple[Measure, ...], labels: tuple[str, ...], groups: tuple[str, ...]
    ) -> Target:
        """Check a target against its block and return it; without a named entry it applies to the first."""
        at = f"{where}: targets"
        measure = measure_named(measures, self.measure, at)
        method = self.method or (labels[0] if labels and "method" not in self.model_fields_set else "")
        if (self.to != "") != measure.relative:
            relative = ", ".join(m.name for m in measures if m.relative) or "no measure of this block"
            came = f"{measure.name} with `to` = {self.to!r}" if self.to else f"{measure.name} without `to`"
            raise InvalidInput(at, came, f"`to` for {relative}, and only there")
        for name in (method, self.to):
            if name and name not in labels:
                raise InvalidInput(at, repr(name), f"a label of the block: {', '.join(labels) or 'it has none'}")
        if self.group and self.group not in groups:
            raise InvalidInput(at, f"group {self.group!r}", f"one of {', '.join(groups) or 'none: it has no groups'}")
        return self.model_copy(update={"method": method})


@dataclass(frozen=True)
class Outcome:
    """One target of a block, with its id and title, and its outcome."""

    block: str
    where: str
    target: Target
    measure: Measure
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
        """The bound: ≤ 8 or ≥ 99.99."""
        bound = self.target.at_most if self.target.at_most is not None else self.target.at_least
        return f"{'≤' if self.target.at_most is not None else '≥'} {bound:g}"

    @property
    def what(self) -> str:
        """The measure in words, with the entry and the group of problems that the target names."""
        of = f"{self.target.method}: " if self.target.method else ""
        group = f", {self.target.group.replace('_', '-')}" if self.target.group else ""
        return f"{of}{self.measure.title}{' ' + self.target.to if self.target.to else ''}{group}"

    @property
    def unit(self) -> str:
        """Unit of the value and of the bound."""
        return self.measure.unit
