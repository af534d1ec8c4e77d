"""The paper's whole system: a laser that finds a spot, a main control that plans the motion to it, drives that execute it."""

from planners.cell.errors import ErrorSplit, split_configurations, split_errors
from planners.cell.laser import PanTiltLaser, Plane, Sighting, SightStatus, Spot
from planners.cell.outcome import CellStatus, Outcome, PathSplit, Round, Step

__all__ = [
    "CellStatus",
    "ErrorSplit",
    "Outcome",
    "PanTiltLaser",
    "PathSplit",
    "Plane",
    "Round",
    "SightStatus",
    "Sighting",
    "Spot",
    "Step",
    "split_configurations",
    "split_errors",
]
