"""The claims of the paper: one function for each, which evaluates the claim on the data of a run."""

from __future__ import annotations

from benchmarks.experiments.base import Finding
from benchmarks.experiments.motion import on_the_line, smooth_joints
from benchmarks.experiments.sweeps import damping_trade, start_and_step
from benchmarks.experiments.workspace import linear_error, more_iterations, within_two_millimetres
from benchmarks.records import RunFolder

CLAIMS = (
    within_two_millimetres,
    more_iterations,
    linear_error,
    damping_trade,
    start_and_step,
    smooth_joints,
    on_the_line,
)
"""Claims in the order of the report."""


def judge(folder: RunFolder) -> list[Finding]:
    """Return the findings on all claims; a claim without data in the run is "not tested"."""
    return [claim(folder) for claim in CLAIMS]
