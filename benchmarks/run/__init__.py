"""Runs of a suite, in one or several processes, which can be interrupted and resumed at any time."""

import benchmarks.extras  # noqa: F401 -- before the modules that need them
from benchmarks.run.session import run_suite

__all__ = ["run_suite"]
