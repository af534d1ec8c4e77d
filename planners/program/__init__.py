"""Programs: one motion of many parts, with rounded corners, stops, waits, events and changes of the tool."""

from planners.program.events import PathEvent, PeriodicEvent, TimedEvent
from planners.program.file import load_program
from planners.program.parts import Dwell, Move, Part, Program, ToolChange
from planners.program.planner import ProgramPlan

__all__ = [
    "Dwell", "Move", "Part", "PathEvent", "PeriodicEvent", "Program", "ProgramPlan", "TimedEvent", "ToolChange",
    "load_program",
]  # fmt: skip
