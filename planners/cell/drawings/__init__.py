"""Drawings of a cell as SVG, made from the objects themselves: its layers, its workflow, its link frames and its setting."""

from planners.cell.drawings.frames import draw_frames
from planners.cell.drawings.layers import draw_layers
from planners.cell.drawings.setting import draw_setting
from planners.cell.drawings.workflow import draw_workflow

__all__ = ["draw_frames", "draw_layers", "draw_setting", "draw_workflow"]
