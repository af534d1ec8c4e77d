"""The usual calls, run once: to compile their kernels on a machine in advance, or to ship them in the wheel."""
