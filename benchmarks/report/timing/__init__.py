"""Sections of the report on timed motions."""
