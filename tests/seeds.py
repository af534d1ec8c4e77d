"""Seeds of tests whose assertion is a rate, a mean or a count over random draws: the same tests with other draws on request."""

import os

SHIFT = int(os.environ.get("OPTIK_TEST_SEED", "0"))


def shift_seed(seed: int) -> int:
    """Return a test's own seed plus the environment variable OPTIK_TEST_SEED."""
    return seed + SHIFT
