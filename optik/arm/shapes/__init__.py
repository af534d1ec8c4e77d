"""The space that an arm's links take, as capsules that enclose them."""

from optik.arm.shapes.check import Capsules
from optik.arm.shapes.model import Shapes

__all__ = ["Capsules", "Shapes"]
