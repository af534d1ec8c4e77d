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

__all__ = [
    "Calibration",
    "CalibrationStatus",
    "Cell",
    "CellStatus",
    "Drive",
    "ErrorSplit",
    "Execution",
    "ExecutionStatus",
    "Fault",
    "FaultKind",
    "Gripper",
    "HeldObject",
    "IdealDrive",
    "Moment",
    "MujocoDrive",
    "Outcome",
    "PanTiltLaser",
    "PathSplit",
    "Plane",
    "RclpyTransport",
    "RosDrive",
    "RosbridgeTransport",
    "Round",
    "Setpoints",
    "SightStatus",
    "Sighting",
    "SimulatedDrive",
    "Spot",
    "Step",
    "Transport",
    "calibrate",
    "drives",
    "fit_periods",
    "make_drive",
    "make_setpoints",
    "mujoco_model",
    "restore_plan",
    "show_execution",
    "show_outcome",
    "split_configurations",
    "split_errors",
    "to_mjcf",
]
