"""Refusal of motions that are not valid."""

from __future__ import annotations

import numpy as np

from optik.errors import InvalidMotion
from planners.certificate.certificate import Certificate
from planners.certificate.violation import Allow, Violation, check_allow, words_for


def find_forbidden(proof: Certificate, allow: Allow) -> tuple[Violation, ...]:
    """Return the violations of a motion that these words do not permit."""
    allowed = check_allow(allow)
    return tuple(violation for violation in proof.violations if violation.allow not in allowed)


def check_valid(proof: Certificate, allow: Allow = (), context: str = "", advice: str = "") -> None:
    """Raise InvalidMotion with the violations that these words do not permit, if there are any."""
    violations = find_forbidden(proof, allow)
    if violations:
        reason = context + "; ".join(violation.words for violation in violations)
        s = float(np.interp(violations[0].t, proof.binding.t, proof.binding.s))
        raise InvalidMotion(reason, words_for(violations, allow), s=s, joint=violations[0].joint, advice=advice)
