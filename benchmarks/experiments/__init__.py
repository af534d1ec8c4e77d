"""Experiments: the claims and misprints of the paper, evaluated on the data of a run."""

import benchmarks.extras  # noqa: F401 -- before the modules that need them
