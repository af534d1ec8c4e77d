"""Compilation of kernels by Numba: decorators, cache of machine code, and the archive in the wheel."""

from optik.compiled.kernel import compiled, inlined, parallel

__all__ = ["compiled", "inlined", "parallel"]
