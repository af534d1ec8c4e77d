"""Capsules that enclose the links of an arm."""

from optik.arm.shapes.check import Capsules
from optik.arm.shapes.model import Shapes

__all__ = ["Capsules", "Shapes"]
