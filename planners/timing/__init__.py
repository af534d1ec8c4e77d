"""Time laws: one module a law, found by its name; each turns a joint path and limits into a `Trajectory`."""

from planners.timing.base import LawLike, TimeLaw, laws, make_law

__all__ = ["LawLike", "TimeLaw", "laws", "make_law"]
