"""Scripts that run in environments of their own, for peers whose packages clash with ours; none is imported here."""
