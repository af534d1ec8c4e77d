"""Plans of the line, as the report reads them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import polars as pl

from benchmarks.blocks.base import BlockRows


@dataclass(frozen=True)
class LinePlans(BlockRows):
    """The line by every IK method and law; ``facts["plans"]`` holds the summary of each plan."""

    @property
    def plans(self) -> list[dict[str, Any]]:
        """All plans."""
        return list(self.facts["plans"])

    @cached_property
    def solved(self) -> list[dict[str, Any]]:
        """Those that have a trajectory."""
        return [p for p in self.plans if p["status"] == "solved"]

    @cached_property
    def solver(self) -> str:
        """The first IK method with a trajectory; the first of all where none has one."""
        return str((self.solved or self.plans)[0]["solver"])

    @cached_property
    def laws(self) -> list[str]:
        """Names of all laws, in the order of the plans."""
        return list(dict.fromkeys(p["law"] for p in self.plans))


def compared_plans(plans: list[dict[str, Any]]) -> pl.DataFrame:
    """Plans as two runs are compared on them."""
    names = [f"{p['law']} with {p['solver']}" for p in plans]
    found = {
        "label": [*names, *("all plans" for _ in plans)],
        "problem": [*("the line" for _ in plans), *names],
        "solved": [*(p["status"] == "solved" for p in plans), *(None for _ in plans)],
        "duration": [*(p.get("duration") if p["status"] == "solved" else None for p in plans), *(None for _ in plans)],
        "seconds": [*(None for _ in plans), *(float(p["seconds"]) for p in plans)],
    }
    return pl.DataFrame(found, schema_overrides={"duration": pl.Float64, "seconds": pl.Float64, "solved": pl.Boolean})
