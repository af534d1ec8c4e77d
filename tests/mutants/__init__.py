"""Single-point changes of what the proof rests on, each of which a test must notice: ``python -m tests.mutants``."""
