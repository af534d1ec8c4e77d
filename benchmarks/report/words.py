"""Names and counts in sentences: a reader must see where one name ends and the next begins."""

from __future__ import annotations

from collections.abc import Iterable


def quoted(label: str) -> str:
    """A label as it stands in a list: in quotation marks where it has a comma or a semicolon of its own."""
    return f"“{label}”" if set(label) & set(",;") else label


def listed(labels: Iterable[str]) -> str:
    """Labels in a sentence, with commas between them."""
    return ", ".join(map(quoted, labels))
