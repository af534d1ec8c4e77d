"""Cartesian paths: one file a path; a path knows where the tool is at s, and how it turns."""
