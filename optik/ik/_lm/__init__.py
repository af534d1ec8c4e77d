"""Kernels of `lm`: the packed arm, initial guesses, and the search in lanes."""
