"""Show: the content of a viewer, with the planned and the executed motion, path, scene, laser beam and facts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from optik.arm.robot import Robot
from optik.errors import NoSolution
from optik.scene import Scene
from optik.types import Array
from planners.cell.drives.base import Execution
from planners.cell.outcome import Outcome
from planners.cell.view._facts import (
    certificate_facts,
    drive_words,
    execution_facts,
    motion_facts,
    outcome_facts,
    unread_facts,
)
from planners.certificate.certificate import Certificate
from planners.following.follow import JointPath
from planners.limits import MotionLimits
from planners.motion import HasMotion, Motion, get_motion
from planners.paths.base import Path
from planners.paths.point_to_point import PointToPoint
from planners.trajectory import Trajectory

MOST_INSTANTS = 2000
"""Largest number of instants of a motion; the viewer interpolates cubics between them."""
SAMPLE_PERIOD = 0.004
"""Interval between instants of a short motion [s]; cubics between them deviate by at most 1e-7 rad at usual jerks."""
PATH_POINTS = 400
"""Number of drawn points of a path."""


class Track(NamedTuple):
    """A sampled motion; a viewer interpolates cubics through its positions and velocities.

    Attributes
    ----------
    t : (k,) array
        Times, 0 first [s].
    q, dq : (k, n) arrays
        Configurations [rad, m] and their velocities [rad/s, m/s].
    ddq : (k, n) array or None
        Accelerations [rad/s², m/s²]; None if they are unknown.
    torque : (k, n) array or None
        Measured torques of the motors [N·m, N]; None if there are none.
    """

    t: Array
    q: Array
    dq: Array
    ddq: Array | None = None
    torque: Array | None = None

    def at(self, time: float) -> tuple[Array, Array]:
        """Return the state at a time; at rest outside of the motion.

        Parameters
        ----------
        time : float
            Since the start [s].

        Returns
        -------
        tuple of arrays
            Configuration (n,) [rad, m] and velocities (n,) [rad/s, m/s].
        """
        t, q, dq = self[:3]
        if time <= t[0] or len(t) == 1:
            return q[0], dq[0] if time == t[0] else np.zeros_like(dq[0])
        if time >= t[-1]:
            return q[-1], dq[-1] if time == t[-1] else np.zeros_like(dq[-1])
        k = int(np.searchsorted(t, time, side="right")) - 1
        h = t[k + 1] - t[k]
        u, a, b = (time - t[k]) / h, h * dq[k], h * dq[k + 1]
        c, d = 3.0 * (q[k + 1] - q[k]) - 2.0 * a - b, 2.0 * (q[k] - q[k + 1]) + a + b
        return q[k] + u * (a + u * (c + u * d)), (a + u * (2.0 * c + 3.0 * u * d)) / h


class Beam(NamedTuple):
    """A laser beam: its origin at the unit and its spot, (3,) each, in the arm's base frame [m]."""

    origin: Array
    spot: Array


@dataclass(frozen=True, eq=False)
class Show:
    """The content of a viewer, in the arm's base frame.

    Attributes
    ----------
    robot : Robot
        The arm with its shapes; up is against gravity.
    title : str
        Title.
    planned : Track
        The planned motion, or the sent one.
    path : (m, 3) array
        Points of the commanded path of the tool [m].
    executed : Track or None
        The executed motion.
    scene : Scene or None
        The obstacles.
    limits : MotionLimits or None
        The limits of the motion.
    beam : Beam or None
        The laser beam to the spot.
    facts : tuple of (name, text)
        Rows of a table.
    before : (m, 3) array or None
        Points of the tool along the way around obstacles near which the path began [m].
    """

    robot: Robot
    title: str
    planned: Track
    path: Array
    executed: Track | None = None
    scene: Scene | None = None
    limits: MotionLimits | None = None
    beam: Beam | None = None
    facts: tuple[tuple[str, str], ...] = ()
    before: Array | None = None

    @property
    def duration(self) -> float:
        """End of the longer of both motions [s]."""
        ends = [track.t[-1] for track in (self.planned, self.executed) if track is not None]
        return float(max(ends))


def show_motion(motion: Motion | HasMotion) -> Show:
    """Return the content of a viewer for a motion.

    Parameters
    ----------
    motion : Motion or Plan
        Such as `planners.load_motion` reads.

    Returns
    -------
    Show
        Its facts include the motion's certificate.

    Raises
    ------
    NoSolution
        A plan that failed.
    InvalidInput
        Neither a motion nor a plan.
    """
    found = get_motion(motion)
    proof = getattr(motion, "certificate", None)
    if not isinstance(proof, Certificate):
        proof = found.certify()
    return Show(
        found.robot, f"{found.robot.name}: {found.law or 'a motion'}", sample_track(found.trajectory),
        sample_path(found.path), scene=found.scene, limits=found.limits,
        facts=(*motion_facts(found), *certificate_facts(proof)), before=sample_first_way(found.path),
    )  # fmt: skip


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
    facts = (*motion_facts(plan.motion), *certificate_facts(plan.certificate), *execution_facts(execution, unread))
    return Show(
        execution.robot, title, sample_track(planned), sample_path(plan.path), executed, plan.scene, plan.limits, facts=facts
    )  # fmt: skip


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
    limits = outcome.executions[0].plan.limits if outcome.executions else None
    facts = (*outcome_facts(outcome), *unread_facts(unread), *motions)
    return Show(
        outcome.robot, f"{outcome.robot.name}: to the spot, {str(outcome.status).replace('_', ' ')}", _join(planned),
        np.vstack(gaps), _join(executed) if executed else None, outcome.scene, limits, beam, facts,
    )  # fmt: skip


# ---------------------------------------------------------------- motions at instants


def sample_track(trajectory: Trajectory) -> Track:
    """Sample a motion for a viewer."""
    count = int(np.clip(np.ceil(trajectory.duration / SAMPLE_PERIOD), 1, MOST_INSTANTS - 1)) + 1
    t = np.linspace(0.0, trajectory.duration, count)
    return Track(t, trajectory(t), trajectory(t, 1), trajectory(t, 2))


def thin_execution(t: Array, q: Array, dq: Array, torque: Array | None = None) -> tuple[Track | None, int]:
    """Return an executed motion thinned out for a viewer, and its number of instants without a reading."""
    read = np.isfinite(q).all(axis=1) & np.isfinite(dq).all(axis=1)
    if torque is not None and not np.isfinite(torque[read]).all():
        torque = None
    whole, unread = Track(t, q, dq, None, torque), int(read.size - read.sum())
    return thin(_select(whole, read), MOST_INSTANTS) if read.any() else None, unread


def sample_first_way(path: Path) -> Array | None:
    """Return the points of the tool along the way around obstacles near which a path began, or None."""
    if not isinstance(path, PointToPoint) or path.corners is None:
        return None
    u = np.linspace(0.0, len(path.corners) - 1.0, PATH_POINTS)
    q = np.stack([np.interp(u, np.arange(len(path.corners)), x) for x in path.corners.T], axis=1)
    return np.asarray(path.robot.fk(q)[:, :3, 3])


def sample_path(path: Path) -> Array:
    """Return the points of a path to draw."""
    s = np.union1d(np.linspace(0.0, path.end, PATH_POINTS), path.breaks)
    return np.asarray(path.pose(s)[:, :3, 3], dtype=np.float64)


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
            last = _select(track, slice(-1, None))
            still = None if last.ddq is None else np.zeros_like(last.ddq)
            yield last._replace(t=np.array([tracks[k + 1][0]]), dq=np.zeros_like(last.dq), ddq=still)


def thin(track: Track, most: int) -> Track:
    """Return at most so many instants of a motion, both ends included."""
    size = track.t.size
    return _select(track, np.unique(np.linspace(0, size - 1, min(size, most)).round().astype(np.int64)))


def _select(track: Track, chosen: Any) -> Track:
    """Return some of the instants of a motion."""
    return Track._make(None if column is None else column[chosen] for column in track)
