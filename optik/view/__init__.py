"""An arm and its motion to look at: one page that plays it."""

from optik.view.page import Page, show_arm, write_page
from optik.view.show import Beam, Show, Track

__all__ = ["Beam", "Page", "Show", "Track", "show_arm", "write_page"]
