"""A motion to look at: one page that plays it."""

from planners.cell.view.page import write_page
from planners.cell.view.show import Beam, Show, Track, show_execution, show_motion, show_outcome

__all__ = [
    "Beam",
    "Show",
    "Track",
    "show_execution",
    "show_motion",
    "show_outcome",
    "write_page",
]
