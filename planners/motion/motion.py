"""Motion: a trajectory with its arm, path, limits, tolerance and scene, as files store it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Any, Protocol

from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput
from optik.ik.base import Tolerance
from optik.scene import Scene
from optik.scene.contact import check_scene, scene_for
from planners.certificate.certificate import Certificate, check_valid
from planners.certificate.certification import certify
from planners.certificate.checks import check_span
from planners.certificate.violation import ALLOWANCES, Allow, check_allow
from planners.following.failure import FollowStatus
from planners.limits import ALL_LIMITS, MotionLimits, check_path
from planners.motion.event import Event
from planners.paths.base import Path
from planners.trajectory import Trajectory


class PlanStatus(StrEnum):
    """Outcome of planning: a status of path following or of timing.

    CONTACT: the arm is in contact with the scene or itself, or within the margin. NO_LENGTH: start and goal are equal, so there
    is nothing to move. TIMING_INFEASIBLE: the law found no motion.
    LIMITS_EXCEEDED: the motion exceeds limits that the caller gave and that the law does not enforce; or with ``strict=True``,
    the law's motion exceeds a limit that it enforces (then there is no motion). NOT_PROVED: there is a motion, but its
    certificate is not valid for another reason. NO_PATH_FOUND: no way around the obstacles was found, or no sequence of
    configurations along the path; one may exist.
    """

    SOLVED = FollowStatus.SOLVED
    NO_IK = FollowStatus.NO_IK
    OUTSIDE_LIMITS = FollowStatus.OUTSIDE_LIMITS
    BRANCH_JUMP = FollowStatus.BRANCH_JUMP
    SINGULAR = FollowStatus.SINGULAR
    UNREACHABLE = FollowStatus.UNREACHABLE
    CONTACT = FollowStatus.CONTACT
    NO_LENGTH = FollowStatus.NO_LENGTH
    TIMING_INFEASIBLE = "timing_infeasible"
    LIMITS_EXCEEDED = "limits_exceeded"
    NOT_PROVED = "not_proved"
    NO_PATH_FOUND = FollowStatus.NO_PATH_FOUND


@dataclass(frozen=True, eq=False)
class Motion:
    """A timed motion, and the data by which it is certified.

    Parameters
    ----------
    robot, path, limits
        The arm, the path of its tool, and the limits.
    trajectory : Trajectory
        The motion of its joints.
    law : str
        Name of the law that made it.
    enforced : tuple of str
        The limits that the motion must respect: those that its law enforces, and those that the caller gave; by default all.
    tolerance : Tolerance, or (2,) tuple of float, optional
        Largest distance [m] and angle [rad] to the path with which its certificate is valid.
    span : (2,) tuple of float, optional
        The part of the path [s] that it is meant to cover, by default all.
    speed : float, optional
        The constant tool speed [m/s; rad/s for a pure rotation] that the law was given.
    scene : Scene, optional
        Obstacles for an arm with shapes, and the margin to them.
    before : (2,) tuple, optional
        Limits that replace ``limits`` until a time [s].
    events : tuple of Event
        Signals at instants of the motion.

    Raises
    ------
    InvalidInput
        An argument of another type, another number of joints, a limit that does not exist.
    """

    robot: Robot
    path: Path
    limits: MotionLimits
    trajectory: Trajectory
    law: str = ""
    enforced: tuple[str, ...] = ALL_LIMITS
    tolerance: Tolerance | None = None
    span: tuple[float, float] | None = None
    speed: float | None = None
    scene: Scene | None = None
    before: tuple[MotionLimits, float] | None = None
    events: tuple[Event, ...] = ()

    def __post_init__(self) -> None:
        kinds = {"robot": Robot, "path": Path, "limits": MotionLimits, "trajectory": Trajectory, "law": str}
        for argument, kind in kinds.items():
            value = getattr(self, argument)
            if not isinstance(value, kind):
                raise InvalidInput(argument, repr(value)[:60], f"a {kind.__name__}")
        if self.trajectory.n != self.robot.n:
            raise InvalidInput("trajectory", f"{self.trajectory.n} joints", f"the {self.robot.n} of {self.robot.name}")
        self.limits.arrays(self.robot.n)
        check_path(self.limits, self.path)
        if not isinstance(self.enforced, tuple) or any(k not in self.limits.names for k in self.enforced):
            expected = f"a tuple of some of {', '.join(self.limits.names)}"
            raise InvalidInput("enforced", repr(self.enforced)[:120], expected)

        if self.tolerance is not None:
            object.__setattr__(self, "tolerance", Tolerance.of(self.tolerance))
        if self.span is not None:
            object.__setattr__(self, "span", check_span(self.span, self.path))
        if self.speed is not None:
            object.__setattr__(self, "speed", check_number(self.speed, "speed", "a tool speed above 0", above=0.0))
        arms = getattr(self.path, "robots", (self.robot,))
        for arm in dict.fromkeys(arms):
            check_scene(arm, scene_for(arm, self.scene, arms))

    @cached_property
    def certificate(self) -> Certificate:
        """The certificate of the motion, computed once."""
        return self.certify(law=self.law)

    def certify(self, **options: Any) -> Certificate:
        """Certify the motion.

        Parameters
        ----------
        **options
            As for `planners.certify`, in place of the motion's own; without any, the motion is certified once.

        Returns
        -------
        Certificate
            Of the motion.

        Raises
        ------
        InvalidInput
            An option that `planners.certify` does not accept.
        """
        if not options:
            return self.certificate
        known: dict[str, Any] = {name: getattr(self, name) for name in ("law", "enforced", "tolerance", "span")}
        known |= {"scene": self.scene, "before": self.before}
        return certify(self.robot, self.path, self.trajectory, self.limits, **(known | options))

    def check_valid(self, allow: Allow = ()) -> None:
        """Raise `InvalidMotion` if the certificate of the motion is invalid.

        Parameters
        ----------
        allow : str or several
            Violations to permit, as for `planners.save`.

        Raises
        ------
        InvalidMotion
            The motion has a violation that ``allow`` does not permit.
        InvalidInput
            A word that does not exist.
        """
        if set(check_allow(allow)) != set(ALLOWANCES):
            check_valid(self.certificate, allow)


class HasMotion(Protocol):
    """An object with a motion, such as a plan."""

    @property
    def motion(self) -> Motion:
        """The motion; raises `NoSolution` if there is none."""


def get_motion(thing: Motion | HasMotion) -> Motion:
    """Return the motion of a plan, or a motion itself."""
    motion = thing if isinstance(thing, Motion) else getattr(thing, "motion", None)
    if not isinstance(motion, Motion):
        raise InvalidInput("motion", repr(thing)[:60], "a Motion or a Plan")
    return motion
