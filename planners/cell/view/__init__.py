"""A motion to look at: in one page that plays it, or in the browser while a simulated drive executes it."""

from planners.cell.view.live import Viewer
from planners.cell.view.page import write_page
from planners.cell.view.show import Beam, Show, Track, show_execution, show_motion, show_outcome

__all__ = [
    "Beam",
    "Show",
    "Track",
    "Viewer",
    "show_execution",
    "show_motion",
    "show_outcome",
    "write_page",
]
