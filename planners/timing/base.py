"""Time laws by name, and their base: the limits that a law needs and enforces, greatest speeds, refits of s(t) to q(t)."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from enum import StrEnum
from typing import Any, ClassVar, NamedTuple, NoReturn, TypeAlias, final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.registry import ClassName, build_method, names
from optik.types import Array, Flags
from planners.certificate.analysis import MotionAnalysis
from planners.following.follow import JointPath
from planners.limits import DERIVATIVES, LOADED, MotionLimits, PathPoints, check_names, kind_of, symmetric_limit
from planners.trajectory import Trajectory
from planners.trajectory.curve import apply_chain_rule, find_times, quintic

NO_JOINT_MOTION = 1e-11
"""Motion of a joint, or of what another limit bounds, that is rounding error [rad, m]: limits on it are ignored."""
NODE_APART, BRIEF_MOTION = 2e-3, 0.1
"""`NODE_APART` is the least time [s] between a knot for a node of the path and any other knot: shorter pieces of a quintic
amplify the rounding of q in the jerk. It decreases in proportion to the duration of motions shorter than `BRIEF_MOTION` [s]."""
SHORTEST_PIECE = 1e-3
"""Shorter pieces [s] are not halved: rounding in q outweighs the gain of a knot."""
REFINEMENT_ROUNDS = 6
"""Largest number of halvings of a piece: 64 parts reduce the error of the jerk by 64³."""
COMPARED_AT = np.array([0.0625, 0.3, 0.7, 0.9375])
"""Fractions of a piece at which refit and chain rule are compared: between the zeros of the error of quintic Hermite pieces."""
POSITION_AGREES = 1e-9
"""Difference of positions [rad or m] that counts as agreement: far below the tolerance of a path."""
JERK_AGREES = 2e-3
"""Relative tolerance of equal jerks. The certificate checks the refit independently."""


class StopKind(StrEnum):
    """Kind of a stop: the time optimum, the sweep that brakes as hard as the limits allow, or the end of the motion."""

    OPTIMUM = "optimum"
    SWEEP = "sweep"
    END = "end"


class PathState(NamedTuple):
    """A moving state on a path: the path parameter s, and ṡ [1/s] and s̈ [1/s²].

    ``joints`` are the exact q, q̇ and q̈ (n,) at the start of the motion; None for those of the path.
    """

    s: float
    speed: float
    acceleration: float
    joints: tuple[Array, Array, Array] | None = None


class TimeLaw(ABC):
    """Base of time laws along a joint path. A law is a subclass in a file of its own, named by ``METHOD``.

    A law states what it enforces and defines `_time`. The default ``name`` is that of the class in lower case.
    """

    name: ClassVar[str] = ClassName()  # type: ignore[assignment] # read as a str
    enforced: ClassVar[tuple[str, ...]]
    """The limits that the law enforces. The certificate also judges those of `list_enforced` and those that the caller gave."""
    counts_torque: ClassVar[bool] = False
    """Whether the law itself respects torques; then acceleration limits are optional if the torque is limited."""
    speed: float | None = None
    """The requested tool speed [m/s; rad/s for a pure rotation], which stretching the motion must not change; or None."""

    @abstractmethod
    def _time(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory | MotionAnalysis:
        """Return a motion along the joint path from rest to rest, or its analysis, which the certificate then reuses.

        The arguments are those of `run`. Each limit that the law enforces is given, and one of them bounds the motion.
        """

    @final
    def run(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        """Return a motion along the joint path.

        Parameters
        ----------
        joint_path : JointPath
            q(s).
        limits : MotionLimits
            Limits of the motion.

        Returns
        -------
        Trajectory
            From rest to rest.

        Raises
        ------
        InvalidInput
            A limit that the law needs is missing.
        NoSolution
            No timing exists within the limits, or none of them bounds the motion.
        """
        return self.run_with_analysis(joint_path, limits).trajectory

    @final
    def run_with_analysis(self, joint_path: JointPath, limits: MotionLimits) -> MotionAnalysis:
        """Return the motion of `run` with its analysis, which the certificate reuses.

        Parameters
        ----------
        joint_path : JointPath
            q(s).
        limits : MotionLimits
            Limits of the motion.

        Returns
        -------
        MotionAnalysis
            The motion of `run`.

        Raises
        ------
        NoSolution
            As `run`.
        """
        self.check(joint_path, limits)
        bounds, enforced = limits.bounds(joint_path.robot.n), self.list_enforced(limits)
        for name in limits.extra or ():
            if name in enforced:  # before the law, which cannot compute with a limit of 0 where a joint moves
                kind_of(name).check_still(joint_path, bounds[name])
        motion = self._time(joint_path, limits)
        if isinstance(motion, MotionAnalysis):
            return motion
        return MotionAnalysis(joint_path.robot, check_motion(self, motion, joint_path.robot), joint_path.path)

    def run_from(self, joint_path: JointPath, limits: MotionLimits, state: PathState) -> Trajectory:
        """Return a motion along the remaining joint path, from a moving state to its end.

        Parameters
        ----------
        joint_path : JointPath
            q(s).
        limits : MotionLimits
            Limits of the motion.
        state : PathState
            State at the start of the motion.

        Returns
        -------
        Trajectory
            From the state to rest.

        Raises
        ------
        InvalidInput
            The law starts at rest only, or a limit that it needs is missing.
        NoSolution
            No timing exists within the limits from that state.
        """  # noqa: DOC202
        raise InvalidInput("timing", self.name, "a law with run_from, such as 'optimal'")

    def check(self, joint_path: JointPath, limits: MotionLimits) -> None:
        """Raise an error if a limit on the joints that the law needs is missing, or if none of its limits bounds the motion.

        Parameters
        ----------
        joint_path : JointPath
            q(s).
        limits : MotionLimits
            Limits of the motion.

        Raises
        ------
        InvalidInput
            A limit that the law needs is missing, or has another number of joints.
        NoSolution
            The limits that the law enforces leave every part that moves free.
        """
        self.need(limits, joint_path.robot)
        moving, bounds = find_moving(joint_path), limits.bounds(joint_path.robot.n)
        names = (*self.enforced, *(limits.extra or ()))
        if self.enforced and not any(self._is_bounded(joint_path, moving, name, bounds[name]) for name in names):
            refuse_free_motion(joint_path, moving)

    def _is_bounded(self, joint_path: JointPath, moving: Flags, name: str, bound: Any) -> bool:
        """Return whether a limit bounds a part that moves; torques count for laws that respect them by themselves."""
        kind = kind_of(name)
        if not isinstance(bound, np.ndarray):
            rates = kind.rows(PathPoints(joint_path, joint_path.nodes), bound)[..., 0]
            return bool(np.abs(rates).max() * joint_path.end > NO_JOINT_MOTION)
        given = np.isfinite(symmetric_limit(bound))
        if kind.subject is None:
            return bool((given & (moving if kind.homogeneous else self.counts_torque)).any())
        rates = kind.rows(PathPoints(joint_path, joint_path.nodes), np.where(given, 1.0, np.inf))[..., 0]
        return bool(np.abs(rates).max() * joint_path.end > NO_JOINT_MOTION)

    def need(self, limits: MotionLimits, robot: Robot) -> None:
        """Raise InvalidInput if a limit on the joints that the law enforces is missing.

        Parameters
        ----------
        limits : MotionLimits
            Limits of a motion.
        robot : Robot
            The arm.

        Raises
        ------
        InvalidInput
            A limit that the law needs is missing, or has another number of joints.
        """
        bounds = limits.bounds(robot.n)
        for name in limits.extra or ():
            kind_of(name).check_robot(robot, bounds[name])
        if missing := self.list_missing(limits, robot):
            named, unknown = " and ".join(missing), self.list_missing(MotionLimits.of(robot), robot)
            limited = dict.fromkeys((*limits.given_names, *unknown))
            arguments = ", ".join(["robot", *(f"{f}=..." for f in limited)])
            expected = f"limits on {named} for the law {self.name!r}: MotionLimits.of({arguments})"
            raise InvalidInput(
                "limits", f"none on {named}", f"{expected}, which keeps the other limits of {robot.name}"
            )

    def list_missing(self, limits: MotionLimits, robot: Robot) -> list[str]:
        """Return the names of the limits on the joints that the law needs and that are missing.

        Parameters
        ----------
        limits : MotionLimits
            Limits of a motion.
        robot : Robot
            The arm.

        Returns
        -------
        list of str
            Out of velocity, acceleration and jerk; not acceleration if the law respects a given torque limit, and none of the
            order of a given further limit on every joint.
        """
        bound, by_torque = limits.arrays(robot.n), self.counts_torque and limits.torque is not None
        further = {kind.order for kind in map(kind_of, limits.extra or ()) if kind.subject is None}
        free = [f for f in DERIVATIVES if f in self.enforced and not np.isfinite(bound[f]).any()]
        free = [f for f in free if kind_of(f).order not in further]
        return [f for f in free if f != "acceleration" or not by_torque]

    def list_enforced(self, limits: MotionLimits) -> tuple[str, ...]:
        """Return the names of the limits that a plan of this law enforces.

        A plan stretches the law's motion until it respects them. So a law that enforces any limit also enforces the extra ones
        of first and second order; the torque, if it enforces the acceleration; and the torque rate and extra limits of third
        order, if it enforces the jerk.

        Parameters
        ----------
        limits : MotionLimits
            Limits of a motion.

        Returns
        -------
        tuple of str
            Limits of the law, the torque and its rate if they are given, and the extra limits.
        """
        if not self.enforced:
            return ()
        of = {"torque": "acceleration", "torque_rate": "jerk"}
        scaling = [name for name in LOADED if of[name] in self.enforced and limits.value(name) is not None]
        scaling += [name for name in limits.extra or () if kind_of(name).order < 3 or "jerk" in self.enforced]
        return (*self.enforced, *(name for name in scaling if name not in self.enforced))


def find_moving(joint_path: JointPath) -> Flags:
    """Return which joints (n,) move on a joint path."""
    return np.asarray(np.ptp(joint_path.q, axis=0) > NO_JOINT_MOTION)


def refuse_free_motion(joint_path: JointPath, moving: Flags) -> NoReturn:
    """Raise NoSolution for limits that leave all joints (n,) that move free."""
    names = ", ".join(joint_path.robot.joint_names[i] for i in np.flatnonzero(moving))
    raise NoSolution("no limit bounds a joint that moves", s=0.0, advice=f"a finite limit on one of {names}")


def check_law(law: object) -> TimeLaw:
    """Return a time law; raise InvalidInput if it is not one, or enforces unknown limits."""
    if not isinstance(law, TimeLaw):
        raise InvalidInput("timing", repr(law)[:60], "a TimeLaw")
    if type(law).run is not TimeLaw.run:  # which the planner would not call
        raise InvalidInput("timing", f"{law.name} with a method run", "a law that defines _time(joint_path, limits)")
    check_names(getattr(law, "enforced", None), f"enforced of the time law {law.name!r}")
    return law


def laws() -> tuple[str, ...]:
    """Return the names of all time laws."""
    return names("planners.timing")


QUIET = ", quiet "
"""What the name of the law `optimal` has before the frequency of a mode that it leaves at rest."""


def read_law(name: str) -> TimeLaw:
    """Return the law of a plan or file by the name that it has there."""
    base, quiet, frequency = name.partition(QUIET)
    return make_law(base, quiet=float(frequency.removesuffix(" Hz"))) if quiet else make_law(base)


LawLike: TypeAlias = str | os.PathLike[str] | type[TimeLaw] | TimeLaw
"""A time law: its name, file or class, or a law that is built."""


def make_law(law: LawLike, **options: Any) -> TimeLaw:
    """Build a time law by its name, from a file or from a class; return a law that is built already.

    Parameters
    ----------
    law : str, path, type or TimeLaw
        A name from `laws`, a Python file such as ``"./law.py"``, which is run, a class, or a law.
    **options
        Options of the law.

    Returns
    -------
    TimeLaw
        The law.

    Raises
    ------
    UnknownName
        No such law; the nearest names are offered.
    InvalidInput
        An option that the law does not have, or out of range; a file that is no law, or whose
        ``enforced`` is no tuple of names of limits.
    """
    if isinstance(law, str | os.PathLike | type):
        return check_law(build_method("planners.timing", law, "time law", **options))
    if options:
        raise InvalidInput("options", ", ".join(options), "none for a law that is built")
    return check_law(law)


def check_motion(law: TimeLaw, motion: object, robot: Robot) -> Trajectory:
    """Return the result of a law; raise InvalidInput if it is not a trajectory of the arm."""
    if not isinstance(motion, Trajectory) or motion.n != robot.n:
        came = f"a trajectory of {motion.n} joints" if isinstance(motion, Trajectory) else repr(motion)[:60]
        raise InvalidInput(f"result of the time law {law.name!r}", came, f"a Trajectory of {robot.n} joints")
    return motion


def speed_bound(joint_path: JointPath, limits: MotionLimits, s: Array) -> Array:
    """Return the greatest ṡ by all limits of first order: joint velocity, tool speed, rotation speed and extra ones."""
    at, bounds = PathPoints(joint_path, s), limits.bounds(joint_path.robot.n)
    first = [kind for kind in limits.kinds if kind.order == 1 and kind.is_given(bounds[kind.name])]
    slowness = np.zeros(s.size)
    for kind in first:
        slowness = np.fmax(slowness, np.abs(kind.rows(at, bounds[kind.name])[:, :, 0]).max(axis=1))
    if np.isinf(slowness).any():  # a limit that is 0 between the places that `check_still` examines
        at_s = float(s[np.isinf(slowness).argmax()])
        reason = f"a velocity limit is 0 at s = {at_s:.6g} {joint_path.path.unit}, where the joints must move"
        raise NoSolution(reason, s=at_s, advice="a path that stays farther from the ends of the ranges")
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / slowness)


def refit(joint_path: JointPath, law: scipy.interpolate.PPoly, jerk_scale: ArrayLike = 1.0) -> Trajectory:
    """Return the trajectory q(s(t)) as quintic Hermite pieces through exact q, q̇, q̈ that agree with the chain rule.

    q(s(t)) has a degree above 5, so it is refitted with knots at every switch of the law (one-sided accelerations there), at
    every knot of the path, and between them until position and jerk agree with the chain rule
    q⃛ = q' s⃛ + 3 q'' ṡ s̈ + q''' ṡ³. The refit is what is certified and exported.
    """
    t = _find_knots(joint_path, law)
    scale = np.asarray(jerk_scale, dtype=np.float64)
    for _ in range(REFINEMENT_ROUNDS):
        trajectory = _interpolate(joint_path, law, t)
        middle = t[:-1, None] + np.diff(t)[:, None] * COMPARED_AT
        q, jerk = _exact(joint_path, law, t, middle)
        off = np.abs(trajectory(middle.ravel()) - q).max(axis=1).reshape(middle.shape)
        off_jerk = (np.abs(trajectory(middle.ravel(), 3) - jerk) / scale).max(axis=1).reshape(middle.shape)
        wrong = (off.max(axis=1) > POSITION_AGREES) | (off_jerk.max(axis=1) > JERK_AGREES)
        wrong &= np.diff(t) > SHORTEST_PIECE
        if not wrong.any():
            break
        t = np.sort(np.concatenate([t, 0.5 * (t[:-1] + t[1:])[wrong]]))
    return _interpolate(joint_path, law, t)


def _find_knots(joint_path: JointPath, law: scipy.interpolate.PPoly) -> Array:
    """Return the switches of the law, and the times of the path's nodes that are not close to others."""
    switches = law.x
    passed = find_times(law, joint_path.nodes[1:-1], float(switches[-1]))
    apart = NODE_APART if switches[-1] > BRIEF_MOTION else NODE_APART / BRIEF_MOTION * switches[-1]
    after = np.clip(np.searchsorted(switches, passed), 1, switches.size - 1)
    near = np.minimum(np.abs(passed - switches[after - 1]), np.abs(passed - switches[after]))
    passed = passed[near > apart]
    keep = np.r_[True, np.diff(passed) > apart][: passed.size]
    return np.sort(np.concatenate([switches, passed[keep]]))


def _piecewise(law: scipy.interpolate.PPoly, t: Array, x: Array, order: int) -> Array:
    """Return a derivative of the law at x (m, k), one-sided at the ends of the intervals of t."""
    p = law.derivative(order) if order else law
    i = np.clip(np.searchsorted(law.x, 0.5 * (t[:-1] + t[1:]), side="right") - 1, 0, law.x.size - 2)
    u = x - law.x[i][:, None]
    value = np.zeros_like(u)
    for c in p.c:
        value = value * u + c[i][:, None]
    return np.asarray(value)


def _interpolate(joint_path: JointPath, law: scipy.interpolate.PPoly, t: Array) -> Trajectory:
    """Return quintic Hermite pieces between knots t through the exact q, q̇ and q̈, one-sided where s̈ jumps."""
    ends = np.stack([t[:-1], t[1:]], axis=1)
    s, v, a = (_piecewise(law, t, ends, order) for order in (0, 1, 2))
    s = np.clip(s, 0.0, joint_path.end)
    s[0, 0], s[-1, 1] = law.c[-1, 0], joint_path.end
    q, q1, q2 = (joint_path(s.ravel(), order).reshape(*s.shape, -1) for order in (0, 1, 2))
    dq, ddq = apply_chain_rule((q1, q2), (v[..., None], a[..., None]))
    q[1:, 0], dq[1:, 0] = q[:-1, 1], dq[:-1, 1]  # one value of q and q̇ at a knot, to the last bit
    return Trajectory(
        quintic(t, (q[:, 0], dq[:, 0], ddq[:, 0]), (q[:, 1], dq[:, 1], ddq[:, 1])), np.append(s[:, 0], s[-1, 1])
    )


def _exact(joint_path: JointPath, law: scipy.interpolate.PPoly, t: Array, x: Array) -> tuple[Array, Array]:
    """Return the exact q and jerk at x (m, k) by the chain rule, as (m·k, n)."""
    s, v, a, j = (_piecewise(law, t, x, order).ravel()[:, None] for order in (0, 1, 2, 3))
    at = np.clip(s[:, 0], 0.0, joint_path.end)
    q, *derivatives = (joint_path(at, order) for order in (0, 1, 2, 3))
    return q, apply_chain_rule(derivatives, (v, a, j))[2]


METHOD_BASE = TimeLaw
"""Base class of the METHOD of every module here and of every plug-in."""
