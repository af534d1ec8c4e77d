"""The paper's complete system: a laser locates a spot, a main control plans the motion to it, and a drive executes it."""

from optik.arm.mjcf_writer import mujoco_model, to_mjcf
from planners.cell.calibration import Calibration, CalibrationStatus, calibrate
from planners.cell.cell import Cell, Gripper, HeldObject
from planners.cell.drives import Drive, SimulatedDrive, drives, make_drive
from planners.cell.drives.base import (
    Execution,
    ExecutionStatus,
    Fault,
    FaultKind,
    Moment,
    Setpoints,
    fit_periods,
    make_setpoints,
)
from planners.cell.drives.ideal import IdealDrive
from planners.cell.drives.mujoco import MujocoDrive
from planners.cell.drives.ros import RosDrive
from planners.cell.laser import PanTiltLaser
from planners.cell.outcome import (
    CellStatus,
    ErrorSplit,
    Outcome,
    PathSplit,
    Round,
    Step,
    split_configurations,
    split_errors,
)
from planners.cell.show import restore_plan, show_execution, show_outcome
from planners.cell.sighting import Plane, Sighting, SightStatus, Spot
from planners.ros.rclpy import RclpyTransport
from planners.ros.rosbridge import RosbridgeTransport
from planners.ros.transport import Transport

__all__ = [  # noqa: RUF022 -- by task
    # the cell and its tasks
    "Cell", "Gripper", "HeldObject", "CellStatus", "Outcome", "Round", "Step", "ErrorSplit", "PathSplit", "split_errors",
    "split_configurations",
    # the laser unit
    "PanTiltLaser", "Plane", "Spot", "Sighting", "SightStatus", "Calibration", "CalibrationStatus", "calibrate",
    # drives and what they execute
    "Drive", "SimulatedDrive", "IdealDrive", "MujocoDrive", "RosDrive", "RclpyTransport", "RosbridgeTransport", "Transport",
    "drives", "make_drive", "Setpoints", "Execution", "ExecutionStatus", "Fault", "FaultKind", "Moment", "fit_periods",
    "make_setpoints", "mujoco_model", "to_mjcf",
    # a picture
    "restore_plan", "show_execution", "show_outcome",
]  # fmt: skip
