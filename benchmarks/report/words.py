"""Names and counts in sentences, with clear boundaries between names."""

from __future__ import annotations

from collections.abc import Iterable


def quoted(label: str) -> str:
    """Return a label for a list: in quotation marks if it contains a comma or a semicolon."""
    return f"“{label}”" if set(label) & set(",;") else label


def listed(labels: Iterable[str]) -> str:
    """Return the labels in a sentence, with commas between them."""
    return ", ".join(map(quoted, labels))
