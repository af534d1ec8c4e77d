"""The tables of keys in suites.md, from the models that read a suite: ``python -m docs.suite_keys`` writes them anew."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from pydantic_core import PydanticUndefined

from benchmarks.blocks.base import GROUP, load_kind
from benchmarks.blocks.block import Target
from benchmarks.blocks.cell import CellMethod, Noise
from benchmarks.blocks.entries import IKPeer, Law, LawPeer, Method
from benchmarks.blocks.freedom import FreeSet
from benchmarks.blocks.timing.settings import Example, LimitSet, LineSet
from benchmarks.settings import Settings
from optik.registry import own_names

PAGE = Path(__file__).with_name("suites.md")
"""The page."""

OF_EVERY_BLOCK = {"id", "title", "targets"}
"""Keys that the page explains once."""

TABLES: dict[str, type[Settings]] = {
    **{name: load_kind(name).block for name in own_names(GROUP)}, "noise": Noise,
    "method": Method, "cell method": CellMethod, "peer": IKPeer, "law": Law, "peer of time laws": LawPeer,
    "lines": LineSet, "limits of timing": LimitSet, "example": Example, "free set": FreeSet, "target": Target,
}  # fmt: skip
"""Models by the name in the marks of the page."""


def draw_table(name: str) -> str:
    """The table of a model."""
    rows = [
        f"| `{key}` | {_default(field)} | {_meaning(field)} |"
        for key, field in TABLES[name].keys().items()
        if key not in OF_EVERY_BLOCK
    ]
    return "\n".join(["| key | default | meaning |", "|---|---|---|", *rows])


def _default(field: Any) -> str:
    if field.is_required():
        return "required"
    value = field.default
    if value is PydanticUndefined or value is None or value in ((), "", {}) or isinstance(value, Settings):
        return ""
    return f"`{json.dumps(value, ensure_ascii=False)}`"


def _meaning(field: Any) -> str:
    unit = (field.json_schema_extra or {}).get("unit", "")
    words = (field.description or "").removesuffix(".")
    return f"{words} [{unit}]" if unit else words


def fill(text: str) -> str:
    """The page with its tables written anew, each between its marks."""
    marks = r"(<!-- keys: ([\w ]+) -->\n)(?:\|.*\n)*(<!-- end -->)"
    return re.sub(marks, lambda mark: f"{mark[1]}{draw_table(mark[2])}\n{mark[3]}", text)


if __name__ == "__main__":
    PAGE.write_text(fill(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
