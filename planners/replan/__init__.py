"""From a moving state on a plan's path: to its end, or to rest."""

from planners.replan.answer import replan

__all__ = ["replan"]
