"""Blocks of a suite: what is solved, executed or timed, and the rows that come of it. Nothing in here knows of reports."""
