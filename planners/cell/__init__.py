"""The paper's whole system: a laser that finds a spot, a main control that plans the motion to it, drives that execute it."""

from planners.cell.cell import Cell
from planners.cell.errors import ErrorSplit, split_configurations, split_errors
from planners.cell.gripper import Gripper, Held
from planners.cell.iso9283 import Cube, PathFigures, PoseFigures, crossings, cube_poses, path_figures, pose_figures
from planners.cell.laser import PanTiltLaser, Plane, Sighting, SightStatus, Spot
from planners.cell.outcome import CellStatus, Outcome, PathSplit, Round, Step

__all__ = [
    "Cell",
    "CellStatus",
    "Cube",
    "ErrorSplit",
    "Gripper",
    "Held",
    "Outcome",
    "PanTiltLaser",
    "PathFigures",
    "PathSplit",
    "Plane",
    "PoseFigures",
    "Round",
    "SightStatus",
    "Sighting",
    "Spot",
    "Step",
    "crossings",
    "cube_poses",
    "path_figures",
    "pose_figures",
    "split_configurations",
    "split_errors",
]
