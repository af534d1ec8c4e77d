"""The content of a viewer for an execution and for a task of the cell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from optik.errors import NoSolution
from optik.types import Array
from optik.view.show import Beam, Show, Track, select, thin
from planners.cell.drives.base import Execution
from planners.cell.facts import drive_words, execution_facts, outcome_facts, unread_facts
from planners.cell.outcome import Outcome
from planners.certificate.certificate import limit_bars
from planners.following.follow import JointPath
from planners.motion.show import (
    MOST_INSTANTS,
    certificate_facts,
    plot_limits,
    sample_path,
    sample_track,
    show_motion,
)
from planners.trajectory import Trajectory


def show_execution(execution: Execution) -> Show:
    """Return the content of a viewer for an execution: the sent and the executed motion.

    Parameters
    ----------
    execution : Execution
        An execution of a drive.

    Returns
    -------
    Show
        If nothing was sent, the content for the plan, with the reason among the facts.

    Raises
    ------
    NoSolution
        The execution of a plan that failed.
    """
    plan = execution.plan
    planned, executed, unread = plan.trajectory, None, 0
    if execution.motion is not None:
        planned = execution.motion
        executed, unread = thin_execution(execution.t, execution.q, execution.dq, execution.torque)
    title = f"{execution.robot.name}: {plan.law} on the drive {drive_words(execution.drive)}"
    show = show_motion(plan)
    facts = (*show.facts, *execution_facts(execution, unread))
    return replace(show, title=title, planned=sample_track(planned), executed=executed, facts=facts)


def show_outcome(outcome: Outcome) -> Show:
    """Return the content of a viewer for a task of the cell: its executions in sequence, with the laser beam.

    Parameters
    ----------
    outcome : Outcome
        An outcome of `Cell.move_to_spot`.

    Returns
    -------
    Show
        Its path has a row of NaN between the paths of two motions. If nothing was executed, the content for the planned motion
        or joint path, with the reason among the facts.

    Raises
    ------
    NoSolution
        The task failed before there was a joint path.
    """
    planned, executed, paths, unread = _collect_executions(outcome)
    if not planned:
        paths = [outcome.robot.fk(track.q)[:, :3, 3] for track in _find_unexecuted(outcome)]
        planned = [(0.0, track) for track in _find_unexecuted(outcome)]
    gaps = [part for points in paths for part in (np.full((1, 3), np.nan), points)][1:]
    beam = None if outcome.beam is None else Beam(*outcome.beam)
    motions = [*certificate_facts(outcome.rounds[0].plan.certificate)] if outcome.rounds else []
    ran = outcome.executions[0].plan if outcome.executions else None
    limits = {} if ran is None else plot_limits(ran.limits, ran.robot.n)
    facts = (*outcome_facts(outcome), *unread_facts(unread), *motions)
    return Show(
        outcome.robot, f"{outcome.robot.name}: to the spot, {str(outcome.status).replace('_', ' ')}", _join(planned),
        np.vstack(gaps), _join(executed) if executed else None, outcome.scene, limits, beam, facts,
        bars=limit_bars(outcome.rounds[0].plan.certificate) if outcome.rounds else (),
    )  # fmt: skip


# ---------------------------------------------------------------- motions at instants


def thin_execution(t: Array, q: Array, dq: Array, torque: Array | None = None) -> tuple[Track | None, int]:
    """Return an executed motion thinned out for a viewer, and its number of instants without a reading."""
    read = np.isfinite(q).all(axis=1) & np.isfinite(dq).all(axis=1)
    if torque is not None and not np.isfinite(torque[read]).all():
        torque = None
    whole, unread = Track(t, q, dq, None, torque), int(read.size - read.sum())
    return thin(select(whole, read), MOST_INSTANTS) if read.any() else None, unread


def _collect_executions(
    outcome: Outcome,
) -> tuple[list[tuple[float, Track]], list[tuple[float, Track]], list[Array], int]:
    """Return the sent and the executed motions with their start times, the paths, and the number of unread instants."""
    planned, executed, paths, began, missing = [], [], [], 0.0, 0
    for execution in outcome.executions:
        if execution.motion is None:
            continue
        did, unread = thin_execution(execution.t, execution.q, execution.dq, execution.torque)
        planned.append((began, sample_track(execution.motion)))
        ends = [execution.motion.duration]
        if did is not None:
            executed.append((began, did))
            ends.append(float(did.t[-1]))
        paths.append(sample_path(execution.plan.path))
        began, missing = began + max(ends), missing + unread
    return planned, executed, paths, missing


def _find_unexecuted(outcome: Outcome) -> list[Track]:
    """Return the last motion that a task planned and did not execute, or the start of its joint path."""
    for step in reversed(outcome.steps):
        if isinstance(step.result, Trajectory):
            return [sample_track(step.result)]
        if isinstance(step.result, JointPath):
            q = step.result(np.zeros(1))
            return [Track(np.zeros(1), q, np.zeros_like(q))]
    raise NoSolution(f"nothing was executed: {outcome.reason}", advice=outcome.advice)


def _join(tracks: list[tuple[float, Track]]) -> Track:
    """Return several motions as one, each from its start time; the arm rests between them."""
    columns: Any = zip(*_add_rests(tracks), strict=True)
    joined = [None if any(part is None for part in column) else np.concatenate(column) for column in columns]
    return thin(Track._make(joined), MOST_INSTANTS)


def _add_rests(tracks: list[tuple[float, Track]]) -> Iterator[Track]:
    """Yield every motion from its start time, and its last instant again, at rest, before the next motion begins."""
    for k, (began, track) in enumerate(tracks):
        track = track._replace(t=began + track.t)
        yield track
        if k + 1 < len(tracks) and tracks[k + 1][0] > track.t[-1]:
            last = select(track, slice(-1, None))
            still = {
                name: np.zeros_like(one) for name in ("dq", "ddq", "jerk") if (one := getattr(last, name)) is not None
            }
            yield last._replace(t=np.array([tracks[k + 1][0]]), **still)
