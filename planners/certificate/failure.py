"""What a certificate finds violated, the word that permits each violation, and the refusal of a motion with others."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from optik.errors import InvalidInput, InvalidMotion

if TYPE_CHECKING:
    from planners.certificate.certificate import Certificate

ALLOWANCES = ("contact", "path", "limits", "jerk", "coverage", "not_proved")
"""The words of ``allow=``: contact, or less than the margin; the tool off its path; limits, jumps and ranges; the limit on the
jerk; a part of the path that is missing; and what is neither violated nor proved to be kept."""
LIMIT_WORDS = ("limits", "jerk")
"""Those that permit to exceed a limit of the motion."""

Allow = str | Iterable[str]
"""One word or several."""


class Failure(NamedTuple):
    """A violation: in words, when [s], the word of `ALLOWANCES` that permits it, and the joint, if it is one."""

    words: str
    t: float
    allow: str
    joint: str | None = None


def check_allow(allow: Allow, words: Sequence[str] = ALLOWANCES) -> tuple[str, ...]:
    """Return the words of ``allow=``; raises InvalidInput for one that does not exist."""
    given = (allow,) if isinstance(allow, str) or not isinstance(allow, Iterable) else tuple(allow)
    if any(word not in words for word in given):
        raise InvalidInput("allow", repr(allow)[:60], f"some of: {', '.join(words)}")
    return given


def word_of_limit(name: str) -> str:
    """Return the word that permits to exceed a limit."""
    return "jerk" if name == "jerk" else "limits"


def required_limits(names: tuple[str, ...], allow: Allow) -> tuple[str, ...]:
    """Return those limits that a motion must keep although these words permit some violations."""
    allowed = check_allow(allow)
    return tuple(name for name in names if word_of_limit(name) not in allowed)


def forbidden(proof: Certificate, allow: Allow) -> tuple[Failure, ...]:
    """Return the violations of a motion that these words do not permit."""
    allowed = check_allow(allow)
    return tuple(failure for failure in proof.failures if failure.allow not in allowed)


def check_valid(proof: Certificate, allow: Allow = (), context: str = "", advice: str = "") -> None:
    """Raise InvalidMotion with the violations that these words do not permit, if there are any."""
    failures = forbidden(proof, allow)
    if failures:
        reason = context + "; ".join(failure.words for failure in failures)
        s = float(np.interp(failures[0].t, proof.binding.t, proof.binding.s))
        raise InvalidMotion(reason, words_for(failures, allow), s=s, joint=failures[0].joint, advice=advice)


def words_for(failures: Sequence[Failure], allow: Allow = ()) -> tuple[str, ...]:
    """Return the words that permit these violations, together with those that are given already."""
    needed = {*check_allow(allow), *(failure.allow for failure in failures)}
    return tuple(word for word in ALLOWANCES if word in needed)
