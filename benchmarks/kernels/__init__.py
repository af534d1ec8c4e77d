"""What users run first, run here once: to compile its kernels on a machine in advance, or to ship them in the wheel."""
