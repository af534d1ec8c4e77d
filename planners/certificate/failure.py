"""What a certificate says of a promise that does not hold."""

from __future__ import annotations

from typing import NamedTuple


class Failure(NamedTuple):
    """A promise that does not hold: what, when [s], and the joint, where it is one."""

    words: str
    t: float
    joint: str | None = None
