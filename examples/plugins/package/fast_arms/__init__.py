"""What the entry points of this package name: a robot, and the path of a suite."""

from pathlib import Path

import optik

SUITE = Path(__file__).parent / "fast_arms.toml"


def pointer():
    """Return an arm of three joints."""
    rows = [optik.DHRow(a=0.0, alpha=1.5707963, d=0.3, theta=0.0), optik.DHRow(a=0.4), optik.DHRow(a=0.3)]
    return optik.Robot.from_dh(rows, optik.JointLimits([-2.9] * 3, [2.9] * 3), name="pointer", source="made up")
