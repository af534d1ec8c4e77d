"""One IK method of a suite: its options, and what reports call it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.settings import check_keys, check_known, optional_count


@dataclass(frozen=True)
class Method:
    """One of our IK methods; ``max_problems`` is how many problems a slow one is given."""

    label: str
    solver: str
    options: dict[str, Any]
    max_problems: int | None = None


def method_of(data: Any, where: str) -> Method:
    """Check the settings of a method."""
    check_keys(data, {"label", "solver", "options", "max_problems"}, f"{where}: methods", need={"solver"})
    check_known(data["solver"], "optik.ik", "IK method")
    most = optional_count(data.get("max_problems"), f"{where}: max_problems")
    return Method(str(data.get("label", data["solver"])), data["solver"], dict(data.get("options", {})), most)
