"""Settings of blocks with iteration budgets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from benchmarks.blocks._entries import check_labels, read_method
from benchmarks.blocks._problems import ProblemBlock, read_problems
from benchmarks.blocks.base import Entry
from benchmarks.settings import check_list
from optik.check import check_count
from optik.errors import InvalidInput


@dataclass(frozen=True, kw_only=True)
class BudgetBlock(ProblemBlock):
    """One problem set on one robot, solved by some methods at some iteration budgets, one attempt each.

    A method that is ``whole`` has no budget: it is called once as it comes, with its restarts.

    Attributes
    ----------
    budgets : tuple of int
        Iterations at which every run is looked at, increasing.
    methods : tuple of Entry
        The IK methods.
    sweep : bool
        Whether it varies options instead of comparing methods; by default, where all methods are one solver.
    """

    budgets: tuple[int, ...]
    methods: tuple[Entry, ...]
    sweep: bool = False

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The methods."""
        return self.methods


def read_block(data: Any) -> BudgetBlock:
    """Check the settings of a block with iteration budgets and return it."""
    where = f"block {data.get('id', '?')!r}" if isinstance(data, dict) else "block"
    shared = read_problems(data, where, {"budgets", "methods", "sweep"}, {"methods"})
    budgets = tuple(check_list(data.get("budgets", [100]), f"{where}: budgets"))
    for budget in budgets:
        check_count(budget, f"{where}: budgets", 1)
    if list(budgets) != sorted(set(budgets)):
        raise InvalidInput(f"{where}: budgets", budgets, "whole numbers, each larger than the one before")
    methods = tuple(_budgeted(m, where) for m in check_list(data["methods"], f"{where}: methods"))
    check_labels(methods, f"{where}: methods")
    sweep = data.get("sweep", len(methods) > 1 and len({m.name for m in methods}) == 1)
    if not isinstance(sweep, bool):
        raise InvalidInput(f"{where}: sweep", repr(sweep)[:60], "true or false")
    return BudgetBlock(**shared, budgets=budgets, methods=methods, sweep=sweep)


def _budgeted(data: Any, where: str) -> Entry:
    """A method that nothing but a budget stops; or one that is called as it comes, ``whole = true``."""
    known = dict(data) if isinstance(data, dict) else data
    whole = known.pop("whole", False) if isinstance(known, dict) else False
    if not isinstance(whole, bool):
        raise InvalidInput(f"{where}: methods: whole", repr(whole)[:60], "true or false")
    method = read_method(known, where)
    for fixed in ("max_iterations", "max_restarts", "time_limit"):
        if fixed in method.options and not whole:
            expected = "budgets in place of it: one attempt, stopped at each budget; or whole = true"
            raise InvalidInput(f"{where}: methods", fixed, expected)
    return replace(method, whole=whole)
