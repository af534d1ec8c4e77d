"""draw_workflow: the executed steps of tasks of a cell, with the loops of corrections and new targets."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, pairwise

import numpy as np

from docs.drawings.sheet import MARGIN, WIDTH, Sheet, text_width
from planners.cell.outcome import Outcome, Step

STEP_PITCH, STEP_HEIGHT = 42.0, 30.0
"""Distance between steps, and height of a step's box [px]."""

LANE = 22.0
"""Distance between parallel arrows [px]."""

LOOPS = {"tool": "correct the error", "execution": "read the spot", "stop": "the spot moved", "replan": "a new line"}
"""Labels of the arrows back to an earlier step, by the step at which they begin."""


def draw_workflow(*tasks: Outcome | Sequence[Outcome]) -> str:
    """Draw the steps of tasks, each once in the order of its first execution, with an arrow for every transition."""
    runs = [[task] if isinstance(task, Outcome) else task for task in tasks]
    taken = [list(chain.from_iterable(outcome.steps for outcome in run)) for run in runs]
    first = {step.name: step for steps in reversed(taken) for step in reversed(steps)}
    names = list(dict.fromkeys(step.name for steps in taken for step in steps))
    ways = list(dict.fromkeys((a.name, b.name) for steps in taken for a, b in pairwise(steps)))
    sheet = Sheet("Workflow of the cell: " + ", ".join(names))
    rows = {name: MARGIN + STEP_PITCH * i for i, name in enumerate(names)}
    back = [way for way in ways if rows[way[1]] < rows[way[0]]]
    ahead = [way for way in ways if rows[way[1]] > rows[way[0]] + STEP_PITCH]
    x = MARGIN + LANE * len(ahead)
    width = WIDTH - MARGIN - x - LANE * len(back) - text_width(max(LOOPS.values(), key=len))
    for name in names:
        sheet.box(x, rows[name], width, STEP_HEIGHT)
        sheet.words((x + 10.0, rows[name] + 20.0), name, bold=True)
        sheet.words((x + width - 10.0, rows[name] + 20.0), describe_result(first[name]), "soft", anchor="end")
    for a, b in ways:
        if rows[b] == rows[a] + STEP_PITCH:
            sheet.arrow([(x + width / 2, rows[a] + STEP_HEIGHT), (x + width / 2, rows[b])], "soft")
    for edge, side, beside in ((x, -1, ahead), (x + width, 1, back)):
        for k, (a, b) in enumerate(beside, start=1):
            lane, start, end = edge + side * LANE * k, rows[a] + STEP_HEIGHT / 2, rows[b] + STEP_HEIGHT / 2
            sheet.arrow([(edge, start), (lane, start), (lane, end), (edge, end)], "z")
    for name in dict.fromkeys(a for a, _ in back if a in LOOPS):
        sheet.words((x + width + LANE * (len(back) + 0.3), rows[name] + 20.0), LOOPS[name], "z")
    return sheet.svg(rows[names[-1]] + STEP_HEIGHT + MARGIN)


def describe_result(step: Step) -> str:
    """Return the type of a step's result."""
    if isinstance(step.result, np.ndarray):
        return "pose (4, 4)" if step.result.shape == (4, 4) else "point (3,)"
    return "" if step.result is None else type(step.result).__name__
