"""Which of the robots that come with optik a test is run for."""

from typing import Any

import pytest

import optik

USUAL = ("irb910sc", "panda", "paper6r", "ur5e")
"""Robots of the default run: one that slides, one with a joint to spare, a spherical wrist and none; make soak has all."""


def marked(arm: str, case: Any) -> Any:
    """A case of an arm, of the default run if the arm is."""
    return case if arm in USUAL else pytest.param(case, marks=pytest.mark.soak)


each_robot = pytest.mark.parametrize("name", [marked(name, name) for name in optik.robots()])
"""All robots, by ``name``."""
