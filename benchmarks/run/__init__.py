"""Runs of a suite: parts in some processes or on a cluster, stopped and continued at any moment."""

from benchmarks.run.session import run_suite

__all__ = ["run_suite"]
