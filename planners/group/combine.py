"""combine(): two motions on one clock; one of them waits until both are proved collision-free."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from optik.arm.group import Group
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.scene import Scene
from optik.scene.world import chain_in_scene
from optik.types import Indices
from planners.certificate.certificate import Certificate, summary_lines
from planners.certificate.certification import certify
from planners.certificate.clearance import clearance
from planners.following.failure import PlanFailure
from planners.group.limits import PATH, join_member_limits
from planners.group.result import GroupPlan
from planners.limits import TOOL_SPEEDS, MotionLimits
from planners.motion import Motion, PlanStatus
from planners.motion.motion import HasMotion, get_motion
from planners.planning.result import judge_certificate
from planners.trajectory import Trajectory, join, make_rest, shift_pieces

STEP = 0.1
"""Step of the waits that are tried [s]; the longest is the duration of the longer motion."""
SAME_KNOT = 1e-9
"""Difference of two knots [s] below which they are one."""


@dataclass(frozen=True, repr=False)
class CombinedMotion:
    """The motion of the chain through two members whose own motions were given."""

    robot: Robot
    trajectory: Trajectory
    certificate: Certificate
    status: PlanStatus
    failure: PlanFailure | None
    waits: dict[str, float]
    has_motion: bool = True

    def __bool__(self) -> bool:
        return self.status is PlanStatus.SOLVED

    def __str__(self) -> str:
        waits = [f"{name} waits {wait:.3g} s" for name, wait in self.waits.items() if wait]
        why = [] if self.failure is None else [f"reason: {self.failure.reason}", f"try: {self.failure.advice}"]
        lines = [f"{self.status}: {self.robot.name}, two motions", *waits, *why]
        return "\n".join([*lines, *summary_lines(self.certificate)[bool(why) :]])

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return self.trajectory.duration


def combine(
    first: Motion | HasMotion, second: Motion | HasMotion, *, scene: Scene | None = None,
    names: tuple[str, str] = ("left", "right"),
) -> GroupPlan:  # fmt: skip
    """Synchronise two motions, and delay one of them if that is necessary to prove that they do not collide.

    The shortest of the tried delays that works is used.

    Parameters
    ----------
    first, second : Motion or Plan
        Motions from rest to rest of arms that are placed in the world by their bases. Error messages use `names` for them.
    scene : Scene, optional
        Obstacles in the world. By default, only self-collisions and collisions between the members are checked.
    names : (2,) tuple of str
        Names of the two members.

    Returns
    -------
    GroupPlan
        If no delay works, ``bool(plan)`` is False. The plan then has the motion without a delay, and its `failure` names the
        first contact.

    Raises
    ------
    InvalidInput
        A motion that does not rest at its ends, or whose payload or tool changes; an arm without shapes.
    InvalidMotion
        A motion whose own certificate is not valid.
    """
    motions = dict(zip(names, (get_motion(one) for one in (first, second)), strict=True))
    for name, motion in motions.items():
        if not all(motion.certificate.rest):
            raise InvalidInput(name, "a motion that does not rest at both ends", "a motion from rest to rest")
        if len({*getattr(motion.path, "robots", ())}) > 1:
            raise InvalidInput(name, "a program whose payload or tool changes", "a motion of one arm as it is")
        motion.check_valid(())
    group = Group({name: motion.robot for name, motion in motions.items()})
    chain, scene = chain_in_scene(group, *names, scene or Scene()), scene or Scene()
    limits = {name: _without_segments(motion.limits) for name, motion in motions.items()} | {PATH: MotionLimits()}
    durations, best = [motion.trajectory.duration for motion in motions.values()], None
    for waits in _list_waits(max(durations)):
        end = max(wait + duration for wait, duration in zip(waits, durations, strict=True))
        moved = [_delay(motion, wait, end) for motion, wait in zip(motions.values(), waits, strict=True)]
        together = stack_trajectories([one.trajectory for one in moved], group.order(*names))
        best = best or (waits, moved, together)
        if clearance(chain, together, Scene()).proved:
            best = waits, moved, together
            break
    assert best is not None
    waits, moved, together = best
    proof = certify(chain, None, together, join_member_limits(group, chain, limits), scene=Scene())
    status, failure = judge_certificate(proof)
    view: Any = CombinedMotion(chain, together, proof, status, failure, dict(zip(names, waits, strict=True)))
    return GroupPlan(group, *names, limits, scene, view, {}, dict(zip(names, moved, strict=True)))


def _without_segments(limits: MotionLimits) -> MotionLimits:
    """Return the limits without the speed limits of path segments. The certificate of the member's own motion covers these."""
    return limits.select(
        tuple(name for name in limits.names if name not in TOOL_SPEEDS or not np.ndim(limits.value(name)))
    )


def _list_waits(longest: float) -> Iterator[tuple[float, float]]:
    """Yield the waits of both arms that are tried, the shortest first."""
    yield 0.0, 0.0
    for wait in np.arange(STEP, longest + STEP, STEP).tolist():
        yield wait, 0.0
        yield 0.0, wait


def _delay(motion: Motion, wait: float, end: float) -> Motion:
    """Return the motion with a rest before it of duration ``wait``, and a rest after it until the time ``end`` [s]."""
    moved = motion.trajectory
    if wait > 0.0:
        moved = join(make_rest(moved(0.0), wait, 0.0 if moved.s is None else float(moved.s[0])), moved)
    if (left := end - moved.end) > SAME_KNOT:
        moved = join(moved, make_rest(moved(moved.end), left, None if moved.s is None else float(moved.s[-1])))
    return replace(motion, trajectory=moved)


def stack_trajectories(each: Sequence[Trajectory], order: Indices) -> Trajectory:
    """Return one trajectory of all joints.

    Its joint k is joint ``order[k]`` of the concatenated joints of the given trajectories, which have the same duration.
    """
    every = np.sort(np.concatenate([one.knots for one in each]))
    knots = every[np.append(True, np.diff(every) > SAME_KNOT)]
    knots[-1] = every[-1]
    parts = []
    for one in each:
        middle = 0.5 * (knots[:-1] + knots[1:])
        piece = np.clip(np.searchsorted(one.knots, middle, side="right") - 1, 0, one.knots.size - 2)
        parts.append(shift_pieces(one.padded[:, piece], knots[:-1] - one.knots[piece]))
    return Trajectory(scipy.interpolate.PPoly(np.concatenate(parts, axis=2)[:, :, order], knots, extrapolate=True))
