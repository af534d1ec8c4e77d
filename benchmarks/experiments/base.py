"""Claims and misprints of the paper, and the counterpart of each of its figures and equations in the report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

HOLDS, FAILS, PARTLY, UNTESTED = "holds", "does not hold", "holds when", "not tested"
"""Verdicts on a claim; "holds when" is followed by the condition."""


@dataclass(frozen=True)
class Finding:
    """A claim of the paper and its verdict."""

    key: str  # letter of the claim
    claim: str
    verdict: str  # "holds", "does not hold", "holds when …" or "not tested"
    summary: str  # the result, with figures
    rule: str  # by which the verdict is decided
    figures: tuple[tuple[str, str], ...] = ()  # names and values with units


PAPER_TITLE = "Research on Trajectory Planning of a 6R Robotic Manipulator based on Jacobian Iteration"
"""Title of the paper."""

PAPER_METHOD = "the Jacobian iteration with damped least squares (dls)"
"""Method of the paper, in words."""


class Counterpart(NamedTuple):
    """A part of the paper (figure, table, equation or section) and its counterpart in the report."""

    place: str
    what: str  # what it is there
    answer: str  # what answers it
    anchor: str = ""  # section of the report; empty where it is elsewhere


COUNTERPARTS = (
    Counterpart(
        "Fig. 1, 2, 7, 8, 9", "hardware, control system, workflow, set-up, photograph", "optik cell, and the suite cell"
    ),
    Counterpart("Table 1, Fig. 3, eq. 1–2", "modified DH parameters, forward kinematics", "robot paper6r"),
    Counterpart("Eq. 3–13, Fig. 4", "Jacobian iteration with damping λ and step size α", "method dls", "budgets"),
    Counterpart("Eq. 9, 12", "orientation error, step size", "corrected; page “The paper” of the documentation"),
    Counterpart("Eq. 11", "damping factor λ", "damping against the distance to a singularity", "damping"),
    Counterpart("Eq. 14, 15, Fig. 5", "straight line and its samples", "the line with its samples", "line"),
    Counterpart("Eq. 16, 17", "joint velocities, quintic segments", "time law quintic, among other laws", "laws"),
    Counterpart("Fig. 6", "the arm along the line", "the arm along the line, moving", "line"),
    Counterpart("Fig. 10", "positions of laser point and robot end", "spots and tools on the graph paper", "maps"),
    Counterpart("Fig. 11", "X error over the workspace", "map of the error in X, and against the distance", "maps"),
    Counterpart("Fig. 12", "Y error over the workspace", "map of the error in Y, and against the distance", "maps"),
    Counterpart("Fig. 13", "Z error over the workspace", "map of the error in Z, and against the distance", "maps"),
    Counterpart("§4.2: within 2 mm on each axis", "claim (a)", "verdict with its rule", "claims"),
    Counterpart("§4.2: larger range, more iterations", "claim (b)", "verdict with its rule", "claims"),
    Counterpart("§5: error about linear in the distance", "claim (c)", "verdict; curves of each axis", "error"),
    Counterpart("§3.2: small and large λ", "claim (d)", "verdict; table by stratum", "damping"),
    Counterpart("§4.2: start and step size", "claim (e)", "verdict with its rule", "claims"),
    Counterpart("§3.3: smooth velocities", "claim (f)", "verdict; joint motion", "joints"),
    Counterpart("§4.1: on the line, orientation constant", "claim (g)", "verdict; tool motion", "joints"),
)
"""Parts of the paper in its order, then its claims."""
