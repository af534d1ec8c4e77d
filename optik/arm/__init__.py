"""Models of serial arms: joints, limits, masses and shapes, read from tables and files."""
