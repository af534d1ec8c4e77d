"""Common calls whose kernels are compiled in advance, on a machine or for the wheel."""
