"""Which of the robots that come with optik a test is run for."""

from __future__ import annotations

import pytest

import optik

USUAL = ("irb910sc", "panda", "paper6r", "ur5e")
"""Robots of the default run: one that slides, one with a joint to spare, a spherical wrist and none; make soak has all."""
each_robot = pytest.mark.parametrize(
    "name", [name if name in USUAL else pytest.param(name, marks=pytest.mark.soak) for name in optik.robots()]
)
"""All robots, by ``name``."""
