"""Settings of blocks with iteration budgets."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from benchmarks.blocks._entries import BudgetedMethod
from benchmarks.blocks._problems import ProblemBlock
from benchmarks.blocks.base import Entry
from benchmarks.settings import Budgets, Entries, Flag, key


def _varies_options(given: dict[str, Any]) -> bool:
    methods = given["methods"]
    return len(methods) > 1 and len({method.name for method in methods}) == 1


class BudgetBlock(ProblemBlock):
    """One problem set on one robot, solved by some methods at some iteration budgets, one attempt each.

    A method that is ``whole`` has no budget: it is called once as it comes, with its restarts.
    """

    budgets: Budgets = key("Iterations at which every run is judged, increasing.", (100,))
    methods: Annotated[tuple[Entry, ...], Entries(BudgetedMethod)] = key("The IK methods.")
    sweep: Flag = Field(
        default_factory=_varies_options,
        description="Whether it varies options of one method; by default, if all methods are one solver.",
    )

    @property
    def is_sweep(self) -> bool:
        """Whether it varies options of one method."""
        return self.sweep

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The methods."""
        return self.methods
