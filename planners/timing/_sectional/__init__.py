"""Ramps of the speed along s, and sections, for the laws ruckig and constant_speed."""
