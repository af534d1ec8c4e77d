"""Programs: one motion of many parts, with rounded corners, stops, waits and changes of the tool."""

from planners.program.parts import Dwell, Move, Part, Program, ToolChange

__all__ = ["Dwell", "Move", "Part", "Program", "ToolChange"]
