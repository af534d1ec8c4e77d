"""What the CasADi methods share: the symbolic model and the nonlinear programme."""
