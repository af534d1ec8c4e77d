"""Entries of a block as a suite's file has them: methods, laws and peers, with their options and labels."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, Field

from benchmarks.blocks.base import Entry
from benchmarks.settings import (
    LISTED,
    Flag,
    LawName,
    MaybeCount,
    Options,
    Settings,
    SolverName,
    default_label,
    key,
    named,
)
from optik.errors import InvalidInput
from optik.registry import short_name
from planners.limits import ALL_LIMITS

LABEL_MEANING = "Name in reports; by default its own."
"""Meaning of the key `label`."""


class Method(Settings):
    """An IK method."""

    solver: SolverName = key("IK method: a name from `optik doctor`, or the path of a file.")
    label: str = Field(default_factory=default_label("solver"), description=LABEL_MEANING)
    options: Options = key("Options of the method.", {})
    max_problems: MaybeCount = key("Largest number of problems, for slow methods; by default all.", None)

    def entry(self) -> Entry:
        """Return the method as an entry of the block."""
        return Entry(self.label, self.solver, self.options, self.max_problems)


class BudgetedMethod(Method):
    """An IK method that only a budget stops, or with ``whole = true`` one with its default settings."""

    whole: Flag = key(
        "Whether each problem is one call with default settings and restarts, instead of one attempt.", False
    )

    def entry(self) -> Entry:
        """Return the method as an entry of the block."""
        for fixed in ("max_iterations", "max_restarts", "time_limit"):
            if fixed in self.options and not self.whole:
                expected = "budgets in place of it: one attempt, stopped at each budget; or whole = true"
                raise InvalidInput("", fixed, expected)
        return Entry(self.label, self.solver, self.options, self.max_problems, whole=self.whole)


def _limits(names: tuple[Any, ...]) -> tuple[str, ...]:
    if unknown := [limit for limit in names if limit not in ALL_LIMITS]:
        raise InvalidInput("", repr(unknown[0])[:60], f"limits out of {', '.join(ALL_LIMITS)}")
    return names


class Law(Settings):
    """A time law."""

    law: LawName = key("Time law: a name, or the path of a file.")
    label: str = Field(default_factory=default_label("law"), description=LABEL_MEANING)
    options: Options = key("Options of the law.", {})
    without: Annotated[tuple[Any, ...], LISTED, AfterValidator(_limits)] = key(
        "Limits that the law does not know; its motions are judged by them.", ()
    )

    def entry(self, role: str = "law") -> Entry:
        """Return the law as an entry of the block."""
        return Entry(self.label, self.law, self.options, role=role, without=self.without)


class IKPeer(Settings):
    """A method of another package."""

    peer: Annotated[str, named("benchmarks.peers.ik", "peer")] = key("Outside method: a name, or the path of a file.")
    label: str = Field(
        default_factory=lambda given: short_name(given["peer"]).replace("_", " "), description=LABEL_MEANING
    )
    max_problems: MaybeCount = key("Largest number of problems, for slow methods; by default all.", None)
    iterations: MaybeCount = key("Largest number of iterations, for methods that accept one.", None)

    def entry(self) -> Entry:
        """Return the peer as an entry of the block."""
        options = {} if self.iterations is None else {"iterations": self.iterations}
        return Entry(self.label, self.peer, options, self.max_problems, "peer")


class LawPeer(Settings):
    """A time law of another package."""

    peer: Annotated[str, named("benchmarks.peers.laws", "peer of timing")] = key(
        "Outside law: a name, or the path of a file."
    )
    label: str = Field(
        default_factory=lambda given: short_name(given["peer"]).replace("_", " "), description=LABEL_MEANING
    )
    max_lines: MaybeCount = key("Largest number of motions of each set, for slow laws; by default all.", None)

    def entry(self) -> Entry:
        """Return the peer as an entry of the block."""
        return Entry(self.label, self.peer, {}, self.max_lines, "peer")
