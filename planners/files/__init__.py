"""Motions in files and messages: one file a format."""
