"""Violations that a certificate finds, and the words that permit them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from optik.errors import InvalidInput

ALLOWANCES = ("contact", "path", "limits", "jerk", "coverage", "not_proved")
"""The words of ``allow=``. They permit: contact, or a distance below the margin; a path error above the tolerance; exceeded
limits, jumps and ranges; an exceeded jerk limit; a missing part of the path; bounds that are neither violated nor proved."""
LIMIT_WORDS = ("limits", "jerk")
"""Words that permit exceeded limits of the motion."""
MOVING = "the motion does not end at rest"
"""Violation of a motion that another one must continue."""
Allow = str | Iterable[str]
"""One word of `ALLOWANCES`, or several."""


class Violation(NamedTuple):
    """A violation: its text, its time [s], the word of `ALLOWANCES` that permits it, and the joint, if it concerns one."""

    words: str
    t: float
    allow: str
    joint: str | None = None


def check_allow(allow: Allow, words: Sequence[str] = ALLOWANCES) -> tuple[str, ...]:
    """Return the words of ``allow=``; raises InvalidInput for one that does not exist."""
    given = (allow,) if isinstance(allow, str) or not isinstance(allow, Iterable) else tuple(allow)
    if any(not isinstance(word, str) or word not in words for word in given):
        raise InvalidInput("allow", repr(allow)[:60], f"some of: {', '.join(words)}")
    return given


def word_of_limit(name: str) -> str:
    """Return the word that permits an exceeded limit."""
    return "jerk" if name == "jerk" else "limits"


def required_limits(names: tuple[str, ...], allow: Allow) -> tuple[str, ...]:
    """Return the limits that a motion must respect, without those whose violation these words permit."""
    allowed = check_allow(allow)
    return tuple(name for name in names if word_of_limit(name) not in allowed)


def words_for(violations: Sequence[Violation], allow: Allow = ()) -> tuple[str, ...]:
    """Return the words that permit these violations, including the words already given."""
    needed = {*check_allow(allow), *(violation.allow for violation in violations)}
    return tuple(word for word in ALLOWANCES if word in needed)
