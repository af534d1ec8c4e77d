"""Runs of a suite, in processes or on a cluster, which can be interrupted and resumed at any time."""

from benchmarks.run.session import run_suite

__all__ = ["run_suite"]
