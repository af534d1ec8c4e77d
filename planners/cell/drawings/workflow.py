"""draw_workflow: the steps that tasks of a cell really went through, with the loops that corrections and new targets make."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, pairwise

import numpy as np

from planners.cell.drawings._svg import MARGIN, Sheet
from planners.cell.outcome import Outcome, Step

ROW, BOX = 42.0, 30.0
"""From one step to the next, and height of a step's box [px]."""

LANE = 22.0
"""Between arrows that go back beside each other [px]."""

LOOPS = {"tool": "correct the rest", "stop": "the spot moved", "replan": "a new line"}
"""Why the workflow goes back, by the step from which it does."""


def draw_workflow(*tasks: Outcome | Sequence[Outcome]) -> str:
    """Draw the workflow of tasks: each step once, in the order in which it was first made, and every way between two steps.

    Parameters
    ----------
    *tasks : Outcome or sequence of Outcome
        What the cell handed back; those of a sequence followed each other.

    Returns
    -------
    str
        Text of an SVG file.
    """
    runs = [[task] if isinstance(task, Outcome) else task for task in tasks]
    taken = [list(chain.from_iterable(outcome.steps for outcome in run)) for run in runs]
    first = {step.name: step for steps in reversed(taken) for step in reversed(steps)}
    names = list(dict.fromkeys(step.name for steps in taken for step in steps))
    ways = dict.fromkeys((a.name, b.name) for steps in taken for a, b in pairwise(steps))
    sheet = Sheet("Workflow of the cell: " + ", ".join(names))
    x, width = MARGIN + LANE * 2, 215.0
    rows = {name: MARGIN + ROW * i for i, name in enumerate(names)}
    for name in names:
        sheet.box(x, rows[name], width, BOX)
        sheet.words((x + 10.0, rows[name] + 20.0), name, bold=True)
        sheet.words((x + width - 10.0, rows[name] + 20.0), made(first[name]), "soft", anchor="end")
    lanes = {-1: 0, 1: 0}
    for way in ways:
        _way(sheet, (x, width), rows, way, lanes)
    for name in [name for name in LOOPS if any(a == name and rows[b] < rows[a] for a, b in ways)]:
        sheet.words((x + width + LANE * (lanes[1] + 0.4), rows[name] + 20.0), LOOPS[name], "z")
    return sheet.svg(rows[names[-1]] + BOX + MARGIN)


def made(step: Step) -> str:
    """Return what a step made, in a word.

    Parameters
    ----------
    step : Step
        A step of an outcome.

    Returns
    -------
    str
        The type of its result; "pose" for a pose.
    """
    if isinstance(step.result, np.ndarray):
        return "pose (4, 4)" if step.result.shape == (4, 4) else "point (3,)"
    return "" if step.result is None else type(step.result).__name__


def _way(
    sheet: Sheet, box: tuple[float, float], rows: dict[str, float], way: tuple[str, str], lanes: dict[int, int]
) -> None:
    """An arrow from one step to another: straight down to the next one, else beside the boxes, back on the right."""
    x, width = box
    start, end = rows[way[0]], rows[way[1]]
    if end == start + ROW:
        sheet.arrow([(x + width / 2, start + BOX), (x + width / 2, end)], "soft")
        return
    back = end < start
    side = 1 if back else -1
    edge = x + width if back else x
    lanes[side] += 1
    lane = edge + side * LANE * lanes[side]
    sheet.arrow([(edge, start + BOX / 2), (lane, start + BOX / 2), (lane, end + BOX / 2), (edge, end + BOX / 2)], "z")
