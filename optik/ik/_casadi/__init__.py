"""Base class, solver interface and symbolic model of the CasADi methods."""
