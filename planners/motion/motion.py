"""Motion: a trajectory with its arm, path, limits, events and scene, as files store it, and its stretching to the limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from math import factorial
from typing import Any, NamedTuple, NoReturn, Protocol, cast

import numpy as np
import scipy

from optik.arm.group import Group
from optik.arm.plain import read_list, read_word
from optik.arm.robot import Robot
from optik.check import check_kind, check_number
from optik.errors import InvalidInput, NoSolution
from optik.ik.base import Tolerance
from optik.scene import Scene
from optik.scene.contact import check_scene, scene_for
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis, check_span
from planners.certificate.certificate import Certificate, check_valid
from planners.certificate.certification import certify, check_kinds
from planners.certificate.torque import TorqueBounds
from planners.certificate.violation import ALLOWANCES, MOVING, Allow, check_allow
from planners.following.failure import FollowStatus
from planners.following.joint_path import JointPath
from planners.limits import ALL_LIMITS, MotionLimits, check_names, check_path, kind_of
from planners.limits.base import sides
from planners.limits.inputs import TorqueRatios
from planners.limits.member import MemberLimit
from planners.paths.base import Path
from planners.trajectory import State, Trajectory, map_joints, shift_pieces
from planners.trajectory.curve import quintic

# ---------------- events


EVENT_KEYS = ("t", "signal", "value", "s", "before", "shift")
"""Keys of an event in a file."""


class Event(NamedTuple):
    """A signal at an instant of a motion.

    Attributes
    ----------
    t : float
        Its time since the start [s].
    signal : str
        Name of the signal.
    value : bool, int, float or str
        The value that it takes.
    s : float or None
        The path parameter of its place [m, or rad]; None for a given time.
    before : float
        Time [s] by which the event precedes the instant at which the motion is at s; negative if it follows.
    shift : float
        What was added to its time so that it is a whole number of servo periods [s].
    """

    t: float
    signal: str
    value: bool | int | float | str = 1
    s: float | None = None
    before: float = 0.0
    shift: float = 0.0

    def stretched(self, factor: float) -> Event:
        """Return the event of the motion stretched in time by a factor; a given time stays.

        Parameters
        ----------
        factor : float
            New duration over the old one [1].

        Returns
        -------
        Event
            Without a shift.
        """
        if self.s is None:
            return self
        return self._replace(t=max((self.t - self.shift + self.before) * factor - self.before, 0.0), shift=0.0)


def check_signal(signal: Any, value: Any) -> None:
    """Raise InvalidInput unless a signal has a name and a value that files can hold."""
    if not isinstance(signal, str) or not signal.isprintable() or not signal:
        raise InvalidInput("signal", repr(signal)[:60], "a name that can be printed")
    if not isinstance(value, bool | int | float | str) or (isinstance(value, float) and value - value != 0.0):
        raise InvalidInput("value", repr(value)[:60], "True, False, a finite number or a text")


def events_to_plain(events: Sequence[Event]) -> list[dict[str, Any]]:
    """Return events as plain data for files."""
    return [event._asdict() for event in events]


def read_events(data: Any) -> tuple[Event, ...]:
    """Return the events that `events_to_plain` wrote, after checking them."""
    events = []
    for row in read_list(data, "events"):
        if not isinstance(row, dict) or set(row) != set(EVENT_KEYS):
            raise InvalidInput("events", repr(row)[:60], f"mappings with {', '.join(EVENT_KEYS)}")
        check_signal(read_word(row["signal"], "events"), row["value"])
        for key in EVENT_KEYS:
            if key in ("t", "before", "shift") or (key == "s" and row[key] is not None):
                check_number(row[key], f"events.{key}", "a number")
        events.append(Event(**row))
    return tuple(events)


# ---------------- motion


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


class World(NamedTuple):
    """What stands in the world around a motion of a chain through several mechanisms: their group, and the obstacles."""

    group: Group
    scene: Scene | None


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
    world : World, optional
        Of the motion of a group: its members and obstacles as they stand in the world, where it is shown.

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
    world: World | None = None

    def __post_init__(self) -> None:
        kinds = {"robot": Robot, "path": Path, "limits": MotionLimits, "trajectory": Trajectory, "law": str}
        for argument, kind in kinds.items():
            value = getattr(self, argument)
            check_kind(value, argument, kind)
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
        if self.world is not None:
            self.world.group.places(self.robot)

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


# ---------------- scale a motion in time until it reaches a limit and exceeds none


FIRST_MARGIN = 1e-12
"""Relative margin of a second slow-down, needed if rounding still exceeds a limit; ten times as much for each further one."""
SPARE = 1e-6
"""Largest fraction of the duration that a scaled motion may be too slow: gravity does not scale with a power of the speed."""
RATES = (1e-3, 10.0)
"""Speeds at which a motion is tried that exceeds a limit at rest, over its own."""
MOST_SPEED_UPS = 4
"""Most times that such a motion is sped up again; each adds a few digits."""


def find_stretch_factor(motion: MotionAnalysis, limits: MotionLimits, enforced: tuple[str, ...] | None = None) -> float:
    """Return the least factor by which a motion is stretched in time to respect the limits."""
    if enforced is not None:
        check_names(enforced, "enforced")
    bounds = limits.bounds(motion.robot.n)
    chosen = [kind for kind in limits.kinds if enforced is None or kind.name in enforced]
    return max((kind.stretch_factor(motion, bounds[kind.name]) for kind in chosen), default=0.0)


def find_largest_ratio(motion: MotionAnalysis, limits: MotionLimits, names: tuple[str, ...]) -> float:
    """Return the largest ratio of a motion to these limits, as the certificate judges them."""
    bounds = limits.bounds(motion.robot.n)
    chosen = [kind for kind in limits.kinds if kind.name in names and kind.is_given(bounds[kind.name])]
    return max((float(np.nanmax(kind.judge(motion, bounds[kind.name]).ratio)) for kind in chosen), default=0.0)


def stretch_to_limits(
    robot: Robot, trajectory: Trajectory, limits: MotionLimits | None = None, enforced: tuple[str, ...] | None = None,
    path: Path | None = None, scene: Scene | None = None,
) -> Trajectory:  # fmt: skip
    """Return a trajectory with the least stretch in time at which its certificate is valid.

    A trajectory that the limits would allow to be faster becomes faster. It may begin or end in motion: then its first and last
    velocities change with the stretch, and only the end at rest is missing from its certificate.

    Parameters
    ----------
    robot : Robot
        The arm.
    trajectory : Trajectory
        The motion.
    limits : MotionLimits, optional
        The limits, by default the robot's own.
    enforced : tuple of str, optional
        Names of the limits to respect, by default all.
    path : Path, optional
        Path of the tool, which the motion must cover.
    scene : Scene, optional
        Obstacles and the margin to them.

    Returns
    -------
    Trajectory
        The same positions, at other times.

    Raises
    ------
    NoSolution
        Stretching does not help: the reason names what is violated at any speed.
    InvalidInput
        An argument that `planners.certify` does not accept.
    """
    limits = check_kinds(robot, path, trajectory, limits)
    motion = MotionAnalysis(robot, trajectory, path)
    stretched = motion.stretched(1.0 / _find_largest_rate(motion, limits, enforced or limits.names))
    moved = stretched.trajectory
    proof = certify(robot, path, moved, limits, enforced=enforced, scene=scene, analysis=stretched)
    if left := [each for each in proof.violations if each.words != MOVING]:
        scale = trajectory.duration / moved.duration
        reasons = (f"{each.words.partition(' at t = ')[0]} at t = {each.t * scale:.6g} s" for each in left)
        raise NoSolution(f"violated at any speed: {'; '.join(reasons)}", advice="another motion, or higher limits")
    return moved


def _find_largest_rate(motion: MotionAnalysis, limits: MotionLimits, names: tuple[str, ...]) -> float:
    """Return the largest speed, over that of a motion, at which it respects the limits, or exceeds them least.

    A motion that exceeds a limit at rest may respect it in motion, as dynamic forces keep the liquid in a swung cup.
    """

    def excess(rate: float) -> float:
        return find_largest_ratio(motion.stretched(1.0 / rate), limits, names) - 1.0

    try:
        stretched = stretch_analysed(motion, limits, names)
        rate = motion.trajectory.duration / stretched.trajectory.duration
    except NoSolution:
        stretched = motion
        rate = (
            float(scipy.optimize.minimize_scalar(excess, bounds=RATES, method="bounded").x)
            if excess(1.0) < np.inf
            else 1.0
        )
    if rate == 1.0 or excess(rate) > 0.0:
        return rate
    step = SPARE
    while excess(rate * (1.0 + step)) <= 0.0:
        rate, step = rate * (1.0 + step), 4.0 * step
    high = rate * (1.0 + step)
    while high - rate > SPARE * rate:
        middle = 0.5 * (rate + high)
        rate, high = (middle, high) if excess(middle) <= 0.0 else (rate, middle)
    return rate


def stretch_analysed(
    motion: MotionAnalysis, limits: MotionLimits, enforced: tuple[str, ...] | None = None
) -> MotionAnalysis:
    """Return a motion, scaled in time to reach a limit and exceed none, with its analysis."""
    factor = find_stretch_factor(motion, limits, enforced)
    if not factor > 0.0:
        return motion
    margin = 0.0
    while True:
        if not np.isfinite(factor):
            raise NoSolution("a limit is exceeded at any speed", advice="another path, or higher limits")
        motion = motion.stretched(factor * (1.0 + margin))
        factor = find_stretch_factor(motion, limits, enforced)
        if factor <= 1.0:
            break
        margin = 10.0 * margin if margin else FIRST_MARGIN  # rounding in the scaled motion may still exceed a limit
    for _ in range(MOST_SPEED_UPS):
        if not 0.0 < factor < 1.0 - SPARE:
            break
        closer = motion.stretched(factor)
        factor = find_stretch_factor(closer, limits, enforced)
        if factor > 1.0:
            break
        motion = closer
    return motion


PEAKS = np.array([[1.875, 1.0, 0.1], [5.78, 3.95, 1.0], [60.0, 36.0, 9.0]])
"""Largest velocity, acceleration and jerk of the quintic from a unit of q, q̇ or q̈ to standstill at 0, in unit time."""
FADE_FRACTION = 1e-3
"""Fraction of the jerk limits that the correction of the initial state may use: the time lost is negligible."""
SAME_POSITION = 1e-14
"""Largest difference of positions [rad or m] that is rounding."""


def match_start(trajectory: Trajectory, start: State, limits: MotionLimits) -> Trajectory:
    """Return the motion with exactly this start q, q̇, q̈ (n,) each, which is close to its own.

    q(s) differs from a measured or refitted state by noise or rounding. The difference is added as a quintic that fades to 0
    at the first knot at which its jerk is at most `FADE_FRACTION` of the limits, else at the last. A difference of position
    that is rounding is added as a constant: to fade it out over a short time would need jerk.
    """
    off = np.array([x - trajectory(0.0, order) for order, x in enumerate(start)])
    off[0, np.abs(off[0]) <= SAME_POSITION] = 0.0
    knots, c = trajectory.knots, trajectory.padded.copy()
    jerk = limits.arrays(trajectory.n)["jerk"]
    ends = knots[1:, None]
    peaks = sum(PEAKS[2, i] * np.abs(off[i]) / ends ** (3 - i) for i in range(3)) / jerk
    little = np.flatnonzero(np.max(peaks, axis=1) <= FADE_FRACTION)
    count = int(little[0]) + 1 if little.size else knots.size - 1
    still = np.zeros((1, trajectory.n))
    over = quintic(knots[[0, count]], (off[:1], off[1:2], off[2:]), (still, still, still)).c
    c[:, :count] += shift_pieces(np.repeat(over, count, axis=1), knots[:count])
    c[5] += np.where(off[0] == 0.0, start[0] - trajectory(0.0), 0.0)
    for order, x in enumerate(start):
        c[5 - order, 0] = x / factorial(order)
    return Trajectory(scipy.interpolate.PPoly(c, knots, extrapolate=True), trajectory.s)


STATIC_EXCESS = 1e-3
"""Largest excess of the bound on the static torque over the largest value found, as a fraction of it: if the limit is between
both, the time law decides."""


def static_torque(robot: Robot, along: Trajectory, limit: Array, since: float = 0.0) -> TorqueRatios:
    """Return bounds on the static torque on a joint path: of gravity, and of Coulomb friction in the path's direction.

    Where a joint rests or reverses, as all joints do at both ends, friction counts on both sides.
    """
    analysis = MotionAnalysis(robot, along)
    begin = int(np.searchsorted(along.knots[1:-1], since, side="right"))
    pieces, knots = np.arange(begin, along.knots.size - 1), along.knots[begin:]
    first, last = (analysis.joints_at(pieces, s) for s in (knots[:-1], knots[1:]))
    torques = TorqueBounds(robot, knots, first, last, still=True)
    found = torques.bound_ratios(limit, rate=False, excess=STATIC_EXCESS)
    for model, ends in zip(torques.models, torques.ends, strict=True):
        resting = [(along.end, ends.right[-1, 0])] + ([] if since > 0.0 else [(0.0, ends.left[0, 0])])
        for s, value in resting:
            found = _include_rest(found, limit, s, value, model.coulomb)
    return found


def _include_rest(found: TorqueRatios, limit: Array, s: float, value: Array, friction: Array) -> TorqueRatios:
    """Return the larger of the given ratios and those of a state of rest at s, with friction on both sides."""
    down, up = (value - friction) / limit[0], (value + friction) / limit[1]
    ratio = np.maximum(down, up)
    return TorqueRatios(
        np.maximum(found.ratio, ratio),
        np.maximum(found.found, ratio),
        np.where(ratio > found.found, s, found.time),
        np.where(ratio > found.found, up >= down, found.upper),
    )


def check_statics(joint_path: JointPath, limits: MotionLimits, enforced: tuple[str, ...], since: float = 0.0) -> None:
    """Raise NoSolution if an enforced limit is exceeded along a path however slowly the arm moves."""
    bounds, robot = limits.bounds(joint_path.robot.n), joint_path.robot
    along = Trajectory(scipy.interpolate.PPoly(joint_path.coefficients, joint_path.nodes))
    loaded = [("", robot, along, bounds["torque"])] if limits.torque is not None and "torque" in enforced else []
    for name in (one for one in limits.extra or () if one in enforced):
        kind, limit = kind_of(name), cast(Any, bounds[name])
        kind.check_still(joint_path, limit)
        if isinstance(kind, MemberLimit) and kind.kind.name == "torque":
            moved = map_joints(along, np.eye(robot.n)[list(limit.columns)])
            loaded.append((f"{kind.member}/", limit.robot, moved, kind.kind.array(limit.value, limit.robot.n)))
    for prefix, arm, moved, given in loaded:
        pair = np.stack(sides(given))
        static = static_torque(arm, moved, pair, since)
        ratio = np.where(np.isfinite(pair[1]), static.found, 0.0)
        if ratio.max() > 1.0:
            _refuse_static(prefix, arm, joint_path.path.unit, static, pair, int(ratio.argmax()))


def _refuse_static(prefix: str, robot: Robot, unit: str, static: TorqueRatios, limit: Array, i: int) -> NoReturn:
    """Raise NoSolution for the static torque of one joint, which exceeds its limit."""
    most, s = abs(float(limit[1 if static.upper[i] else 0, i])), float(static.time[i])
    force, joint = "N" if robot.prismatic[i] else "N·m", prefix + robot.joint_names[i]
    raise NoSolution(
        f"the limit of {most:.6g} {force} on the torque of {joint} is below the {static.found[i] * most:.4g} {force} "
        f"that gravity and friction need at s = {s:.4g} {unit} at any speed",
        s=s, joint=joint, advice="another path, a lighter payload, or a higher limit",
    )  # fmt: skip
