"""Random seeds by problem, method and trial: results do not depend on parts, workers or order."""

from __future__ import annotations

import hashlib
import random
from typing import Any

import numpy as np


def trial_seed(seed: int, problem: int, method: str, trial: int = 0) -> int:
    """Seed of one trial of a method on a problem."""
    named = int.from_bytes(hashlib.blake2b(method.encode(), digest_size=8).digest(), "little")
    return int(np.random.SeedSequence((seed, problem, named, trial)).generate_state(1)[0])


def reseed(method: Any, seed: int, problem: int, label: str, trial: int = 0) -> None:
    """Seed all random number generators that a method may use, before one trial of it.

    These are Python's `random`, NumPy's global generator, and whatever the method's own ``reseed(number)`` sets, where it
    has one.
    """
    number = trial_seed(seed, problem, label, trial)
    random.seed(number)  # both generators are global: older packages use them
    np.random.seed(number)  # noqa: NPY002
    own = getattr(method, "reseed", None)
    if callable(own):
        own(number)
