"""Motions over time: piecewise polynomials, their exact extrema, and their interpolation by controllers."""

from planners.trajectory.trajectory import (
    Extrema,
    State,
    Trajectory,
    append_rest,
    cut_after,
    cut_before,
    join,
    make_rest,
    map_joints,
    shift_pieces,
    simulate_controller,
    without_rounding,
)

__all__ = [
    "Extrema", "State", "Trajectory", "append_rest", "cut_after", "cut_before", "join", "make_rest", "map_joints",
    "shift_pieces", "simulate_controller", "without_rounding",
]  # fmt: skip
