"""What every process of `forks` has imported, and Numba has compiled once: the first time takes it half a second."""

import numba

from benchmarks.cli.app import main

assert main
numba.njit(lambda x: x)(1.0)
