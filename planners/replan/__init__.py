"""Replanning from a moving state: to the end of the path, or to rest on it."""

from planners.replan.answer import replan

__all__ = ["replan"]
