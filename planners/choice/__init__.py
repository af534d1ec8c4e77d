"""Choice of the free coefficients of a path together with its timing."""
