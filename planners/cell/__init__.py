"""The paper's whole system: a laser that finds a spot, a main control that plans the motion to it, drives that execute it."""

from planners.cell.disturbances import LateHost, LostEncoder, Stall, WrongSetpoint
from planners.cell.drives import Drive, drives, make_drive
from planners.cell.drives.base import Execution, ExecutionStatus, Fault, FaultKind, Moment
from planners.cell.setpoints import Setpoints, setpoints, whole_periods

__all__ = [
    "Drive",
    "Execution",
    "ExecutionStatus",
    "Fault",
    "FaultKind",
    "LateHost",
    "LostEncoder",
    "Moment",
    "Setpoints",
    "Stall",
    "WrongSetpoint",
    "drives",
    "make_drive",
    "setpoints",
    "whole_periods",
]
