"""Motions of several mechanisms on one clock."""
