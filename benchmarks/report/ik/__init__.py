"""Sections of the report on inverse kinematics."""
