"""restore_plan: the plan of a motion from a file, which drives can execute and stop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from optik.errors import InvalidInput, NoSolution
from optik.ik import get_solver
from planners.certificate.certificate import check_valid
from planners.certificate.sections import conditions_of, cut_between, find_stops
from planners.certificate.violation import Allow
from planners.following.failure import joint_unit
from planners.following.follow import DEFAULT_TOLERANCE, JointPath, follow
from planners.motion import Motion
from planners.paths.program import ProgramPath
from planners.planning.planner import PATH_FRACTION
from planners.planning.request import judge_certificate
from planners.planning.result import Plan
from planners.program.events import TimedEvent
from planners.program.result import ProgramPlan, build_plan

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
        Not a motion, or one that begins in the middle of its path.
    InvalidMotion
        The motion has a violation that ``allow`` does not permit.
    NoSolution
        The path cannot be followed from its start, or gives another joint path.
    UnknownName
        No such IK method.
    """
    if not isinstance(motion, Motion):
        raise InvalidInput("motion", repr(motion)[:60], "a Motion")
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
    times, sections = find_stops(path, motion.trajectory, motion.span), []
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
