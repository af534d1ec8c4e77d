"""Scripts that measure the figures of an issue: ``python -m tests.figures.NAME`` prints asked beside measured."""
