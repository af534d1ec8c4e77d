"""The paper's claims, each judged from the rows of a run; a claim is one function in one tuple."""

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


def judge(folder: RunFolder) -> list[Finding]:
    """What the run says of every claim; claims whose data it does not hold are "not tested"."""
    return [claim(folder) for claim in CLAIMS]
