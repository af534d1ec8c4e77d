"""Certificates of motions: one file for each proved property, and the active constraint."""
