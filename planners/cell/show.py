"""Executions, tasks and failed plans from files, and their content for a viewer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from optik.arm.plain import read_record, read_word
from optik.errors import InvalidInput, NoSolution
from optik.ik import get_solver
from optik.types import Array
from optik.view.show import Beam, Show, Track, select, thin
from planners.cell.drives.base import Execution
from planners.cell.outcome import Outcome, drive_words, execution_facts, outcome_facts, unread_facts
from planners.certificate.certificate import check_valid, limit_bars
from planners.certificate.certification import conditions_of, cut_between, find_section_times
from planners.certificate.violation import Allow
from planners.files.base import from_plain
from planners.following.failure import joint_unit
from planners.following.follow import DEFAULT_TOLERANCE, JointPath, follow
from planners.motion import Motion
from planners.motion.show import MOST_INSTANTS, certificate_facts, plot_limits, sample_path, sample_track, show_motion
from planners.paths.program import ProgramPath
from planners.planning.failed import check_samples, make_track, show_failed_plan
from planners.planning.planner import PATH_FRACTION
from planners.planning.result import Plan, judge_certificate
from planners.program.events import TimedEvent
from planners.program.planner import ProgramPlan, build_plan
from planners.trajectory import Trajectory

# ---------------- restore_plan


SAME_WAY = 1e-4
"""Largest distance of the motion from the joint path that is found for it [rad, m]: both follow the tool's path to 1e-5, and
another joint path is farther off at once."""


def restore_plan(motion: Motion, *, solver: str = "lm", allow: Allow = ()) -> Plan:
    """Return a plan with a motion from a file. Its joint path is followed again, and the motion is certified again.

    Parameters
    ----------
    motion : Motion
        As `planners.load_motion` reads it.
    solver : str
        The IK method that it was planned with. It matters only for a redundant arm, where each method finds its own joint path.
    allow : str or several
        Violations to permit, as for `planners.save`.

    Returns
    -------
    Plan
        The stored motion with a new certificate.

    Raises
    ------
    InvalidInput
        Not a motion, or one that begins in the middle of its path, or of a group.
    InvalidMotion
        The motion has a violation that ``allow`` does not permit.
    NoSolution
        The path cannot be followed from its start, or gives another joint path.
    UnknownName
        No such IK method.
    """
    if not isinstance(motion, Motion):
        raise InvalidInput("motion", repr(motion)[:60], "a Motion")
    if motion.world is not None:  # the base of its chain moves, so no drive has its gravity
        raise InvalidInput("motion", f"that of the group {motion.robot.name}", "that of one arm: plan.members[NAME]")
    if motion.span is not None and motion.span[0] > 0.0:
        got = (
            f"a replanned motion, which begins at s = {motion.span[0]:.6g}; execute it in the program that replanned it"
        )
        raise InvalidInput("motion", got, "a motion from the start of its path")
    proof = motion.certify()
    check_valid(proof, allow, "the certificate of this motion is not valid: ", "another law, or lower limits")
    if isinstance(motion.path, ProgramPath):
        return _plan_sections(motion, motion.path, solver, allow)
    joints, t, s = _follow_path(motion, solver), proof.t, proof.s
    off = np.abs(joints(np.clip(s, 0.0, joints.end)) - motion.trajectory(t))
    if off.max() > SAME_WAY:
        i, joint = (int(k) for k in np.unravel_index(off.argmax(), off.shape))
        name, away = motion.robot.joint_names[joint], f"{off.max():.3g} {joint_unit(motion.robot, joint)}"
        what = f"{solver} finds another joint path: {name} is {away} off the motion at t = {t[i]:.6g} s"
        raise NoSolution(what, s=float(s[i]), advice="use the IK method of the plan, or plan again")
    status, failure = judge_certificate(proof)
    return Plan(
        motion.robot, motion.path, motion.limits, status, solver, motion.law, joints, failure,
        motion.trajectory, proof, span=motion.span, speed=motion.speed, scene=motion.scene,
    )  # fmt: skip


def _follow_path(motion: Motion, solver: str) -> JointPath:
    """Return the joint path from the motion's start."""
    tolerance = motion.tolerance or DEFAULT_TOLERANCE
    allowed = tolerance.scale(PATH_FRACTION)
    found = follow(get_solver(motion.robot, solver), motion.path, motion.trajectory(0.0), tolerance=allowed)
    if (why := found.failure) is not None:
        raise NoSolution(f"the path of this motion cannot be followed: {why.reason}", s=why.s, advice=why.advice)
    assert found.joint_path is not None
    return found.joint_path


def _plan_sections(motion: Motion, path: ProgramPath, solver: str, allow: Allow) -> ProgramPlan:
    """Return the plan of a program's motion from the plans of its sections; its events keep their times."""
    times, sections = find_section_times(path, motion.trajectory, motion.span), []
    for i, (begin, rest, _) in enumerate(times):
        limits, scene = conditions_of(path, i, motion.limits, motion.scene)
        own = replace(
            motion, robot=path.robots[i], path=path.sections[i], limits=limits, scene=scene, events=(), span=None,
            enforced=tuple(name for name in motion.enforced if name in limits.names),
            trajectory=cut_between(motion.trajectory, begin, rest),
        )  # fmt: skip
        sections.append(restore_plan(own, solver=solver, allow=allow))
    waits = [0.0, *(time.end - time.rest for time in times)]
    events = tuple(TimedEvent(event.t, event.signal, event.value) for event in motion.events)
    return replace(build_plan(sections, waits, (), (), motion.limits, motion.scene), scheduled=events)


# ---------------- the content of a viewer for an execution and for a task of the cell


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
    return replace(
        show, title=title, planned=sample_track(planned), executed=executed, facts=facts,
        **_judge_execution(show, execution.status),
    )  # fmt: skip


def _judge_execution(show: Show, status: str) -> dict[str, Any]:
    """Return the verdict on an execution and on its motion."""
    good = show.good and status in ("done", "dry_run", "stopped")
    return {"verdict": f"execution {str(status).replace('_', ' ')}; {show.verdict}", "good": good}


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


# ---------------- files of executions and of failed plans


EXECUTION = "optik-execution/1"
"""Value of the key ``format`` in the file of an execution; a change of the keys needs another number."""


def show_recorded(data: Mapping[str, Any]) -> Show:
    """Return the content of a viewer for a file of an execution or of a failed plan."""
    return _show_execution(data) if data.get("format") == EXECUTION else show_failed_plan(data)


def _show_execution(data: Mapping[str, Any]) -> Show:
    if "plan" not in data or "setpoints" not in data:
        expected = "one of a motion that was sent, written by `optik drive`"
        raise InvalidInput("PLAN", "an execution without a motion", expected)
    motion = from_plain(data["plan"])
    n, sent = motion.robot.n, read_record(data["setpoints"], ("t", "q"), "setpoints", optional=("dq", "ddq"))
    t, q = check_samples(sent["t"], sent["q"], n, "setpoints")
    rates = [check_samples(t, sent[name], n, f"setpoints.{name}")[1] for name in ("dq", "ddq") if name in sent]
    planned = Track(t, q, *rates) if rates and np.isfinite([q, *rates]).all() else make_track(t, q)
    done, did = check_samples(data.get("t"), data.get("q"), n, "q")
    speed = check_samples(data.get("t"), data.get("dq"), n, "dq")[1]
    torque = None if data.get("torque") is None else check_samples(done, data["torque"], n, "torque")[1]
    executed, unread = thin_execution(done, did, speed, torque)
    drive = read_word(data.get("drive", ""), "drive")
    status = read_word(data.get("status", ""), "status").replace("_", " ")
    rows = [("Drive", drive_words(drive)), ("Execution", status)]
    rows += [(name.capitalize(), read_word(data[name], name)) for name in ("reason", "advice") if data.get(name)]
    show, title = show_motion(motion), f"{motion.robot.name}: {motion.law} on the drive {drive_words(drive)}"
    facts = (*show.facts, *rows, *unread_facts(unread))
    return replace(show, title=title, planned=planned, executed=executed, facts=facts, **_judge_execution(show, status))
