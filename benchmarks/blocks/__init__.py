"""Blocks of a suite: they solve, execute or time something and write rows. They do not depend on the report."""

import benchmarks.extras  # noqa: F401 -- before the modules that need them
