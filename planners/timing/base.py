"""What every time law shares: the limits, what it promises, and the refit of a law on s to a trajectory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from optik.arm.robot import Robot, positive
from optik.check import check_number
from optik.content import content
from optik.errors import InvalidInput
from planners.following.follow import JointPath
from planners.hermite import quintic
from planners.trajectory import Trajectory

Array = NDArray[np.float64]

DERIVATIVES = ("velocity", "acceleration", "jerk")
"""Limits of every joint."""
TOOL_SPEEDS = ("tool_speed", "rotation_speed")
"""Limits of the tool, on the Euclidean norms of v and ω."""
ALL_LIMITS = (*DERIVATIVES, *TOOL_SPEEDS)
SAME_SPEED = 1e-6
"""Share by which a tool speed that was asked may come out as another: whole nanoseconds, and rounding."""


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of a motion, symmetric, per joint; None where free.

    Parameters
    ----------
    velocity, acceleration, jerk : scalar or (n,) array, optional
        [rad/s, rad/s², rad/s³, or metres for prismatic joints].
    tool_speed, rotation_speed : float, optional
        Greatest speed of the tool's point [m/s] and of its rotation [rad/s], as Euclidean norms.

    Raises
    ------
    InvalidInput
        Limits that are not above 0, or not numbers.
    """

    velocity: ArrayLike | None = None
    acceleration: ArrayLike | None = None
    jerk: ArrayLike | None = None
    tool_speed: float | None = None
    rotation_speed: float | None = None

    def __post_init__(self) -> None:
        for field in DERIVATIVES:
            value = getattr(self, field)
            if value is not None:
                kept = positive(value, np.size(value), field)
                object.__setattr__(self, field, kept if np.ndim(value) else float(kept[0]))
        for field in TOOL_SPEEDS:
            value = getattr(self, field)
            if value is not None:
                check_number(value, field, "a speed above 0", above=0.0)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MotionLimits) and self._content() == other._content()

    def __hash__(self) -> int:
        return hash(self._content())

    def _content(self) -> Any:
        return content([getattr(self, field) for field in ALL_LIMITS])

    @staticmethod
    def of(robot: Robot) -> MotionLimits:
        """Return the robot's own limits."""
        return MotionLimits(robot.limits.velocity, robot.limits.acceleration, robot.limits.jerk)

    def arrays(self, n: int) -> dict[str, Array]:
        """Return each as (n,), infinity where free; read-only.

        Raises
        ------
        InvalidInput
            A length other than n.
        """
        kept: dict[int, dict[str, Array]] = self.__dict__.setdefault("_arrays", {})  # asked for many times by a law
        if n not in kept:
            free = np.full(n, np.inf)
            free.setflags(write=False)
            kept[n] = {f: free if (v := getattr(self, f)) is None else positive(v, n, f) for f in DERIVATIVES}
        return dict(kept[n])

    def scaled(self, share: float) -> MotionLimits:
        """Return the same limits, so many times as wide."""
        wider: dict[str, Any] = {f: share * np.asarray(v) for f in ALL_LIMITS if (v := getattr(self, f)) is not None}
        return replace(self, **{f: float(v) if f in TOOL_SPEEDS else v for f, v in wider.items()})

    def to_dict(self, n: int) -> dict[str, Any]:
        """Plain data for files: lists of n numbers, None where free."""
        arrays = {f: [float(x) if np.isfinite(x) else None for x in a] for f, a in self.arrays(n).items()}
        return arrays | {f: getattr(self, f) for f in TOOL_SPEEDS}

    @property
    def tool(self) -> tuple[float, float]:
        """Greatest tool speed [m/s] and rotation speed [rad/s], infinity where free."""
        speed, rotation = (getattr(self, f) for f in TOOL_SPEEDS)
        return (np.inf if speed is None else float(speed), np.inf if rotation is None else float(rotation))


class PathState(NamedTuple):
    """A moving state on a path: the place s, and ṡ [1/s] and s̈ [1/s²] there.

    ``joints`` are the q, q̇ and q̈ (n,) with which the motion begins exactly; None for those of the path.
    """

    s: float
    speed: float
    acceleration: float
    joints: tuple[Array, Array, Array] | None = None


class TimeLaw(ABC):
    """A way to run along a joint path. A law is a subclass in a file of its own that names itself ``METHOD``."""

    name: ClassVar[str]
    keeps: ClassVar[tuple[str, ...]]
    """Which limits the law promises to keep; the certificate judges exactly those."""
    speed: float | None = None
    """The tool speed [m/s; rad/s for a pure rotation] that was asked and that nothing after the law may change; or None."""

    @abstractmethod
    def run(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        """Time the joint path.

        Raises
        ------
        InvalidInput
            A limit that the law needs is missing.
        NoSolution
            No timing exists within the limits.
        """

    def run_from(self, joint_path: JointPath, limits: MotionLimits, state: PathState, *, stop: bool) -> Trajectory:
        """Time the rest of the joint path from a moving state to its end, or to rest as soon as may be.

        Raises
        ------
        InvalidInput
            The law starts at rest only, or a limit that it needs is missing.
        NoSolution
            No timing exists within the limits from that state.
        """
        raise InvalidInput("timing", self.name, "a law that can start from a moving state: optimal")

    def need(self, limits: MotionLimits, robot: Robot) -> dict[str, Array]:
        """Return the limits as arrays, or say which one the law needs and does not have."""
        bound = limits.arrays(robot.n)
        missing = [f for f in self.keeps if f in DERIVATIVES and not np.isfinite(bound[f]).any()]
        if missing:
            arguments = ", ".join(f"{f}=..." for f in missing)
            raise InvalidInput(
                "limits",
                f"none for {robot.name}",
                f"limits on {' and '.join(missing)} for the law {self.name!r}: MotionLimits({arguments})",
            )
        return bound


def speed_bound(joint_path: JointPath, limits: MotionLimits, s: Array) -> Array:
    """Greatest ṡ (k,) at s (k,) by the limits on joint velocity, tool speed and rotation speed; infinity where none binds."""
    bound = limits.arrays(joint_path.robot.n)["velocity"]
    tool_speed, rotation_speed = limits.tool
    with np.errstate(divide="ignore", invalid="ignore"):
        greatest = np.min(bound / np.abs(joint_path(s, 1)), axis=1)
        if np.isfinite((tool_speed, rotation_speed)).any():
            twist = joint_path.path.twist(s)
            for speed, part in ((tool_speed, twist[:, :3]), (rotation_speed, twist[:, 3:])):
                greatest = np.fmin(greatest, speed / np.linalg.norm(part, axis=1))
    return np.asarray(greatest)


def derivatives_at(joint_path: JointPath, per_interval: int = 2) -> tuple[Array, Array, Array]:
    """|q'|, |q''|, |q'''| (k, n) on a dense grid in s: the coefficients of a law's limits."""
    x = joint_path.nodes
    s = np.append((x[:-1, None] + np.diff(x)[:, None] * (np.arange(per_interval) / per_interval)).ravel(), x[-1])
    q1, q2, q3 = (np.abs(joint_path(s, order)) for order in (1, 2, 3))
    return q1, q2, q3


def refit(joint_path: JointPath, law: Any, jerk_scale: ArrayLike = 1.0) -> Trajectory:
    """Trajectory of q(s(t)): quintic Hermite through exact q, q̇, q̈, until it agrees with the chain rule.

    q(s(t)) is of a higher degree than 5, so it is refitted with a knot at every switch of the law (one-sided
    accelerations there), at every knot of the path, and more between until position and jerk agree with the chain rule
    q⃛ = q' s⃛ + 3 q'' ṡ s̈ + q''' ṡ³. The refit is what is certified and exported.

    Parameters
    ----------
    joint_path : JointPath
        q(s).
    law : scipy.interpolate.PPoly
        s(t) from 0 to the path's end, increasing; coefficients (·, m).
    jerk_scale : scalar or (n,) array
        Size of a jerk that matters [rad/s³]; agreement is asked to 0.2 % of it.

    Returns
    -------
    Trajectory
        Ends exactly where the joint path ends.
    """
    t = _first_knots(joint_path, law)
    scale = np.asarray(jerk_scale, dtype=np.float64)
    for _ in range(6):
        trajectory = _through(joint_path, law, t)
        middle = t[:-1, None] + np.diff(t)[:, None] * np.array([0.0625, 0.3, 0.7, 0.9375])
        q, jerk = _chain(joint_path, law, t, middle)
        off = np.abs(trajectory(middle.ravel()) - q).max(axis=1).reshape(middle.shape)
        off_jerk = (np.abs(trajectory(middle.ravel(), 3) - jerk) / scale).max(axis=1).reshape(middle.shape)
        wrong = (off.max(axis=1) > 1e-9) | (off_jerk.max(axis=1) > 2e-3)
        wrong &= np.diff(t) > 1e-3  # below a millisecond rounding in q outweighs what a knot adds
        if not wrong.any():
            break
        t = np.sort(np.concatenate([t, 0.5 * (t[:-1] + t[1:])[wrong]]))
    return _through(joint_path, law, t)


def _first_knots(joint_path: JointPath, law: Any) -> Array:
    """Switches of the law, and the times at which the path's nodes are passed, where those stand well apart."""
    switches = law.x
    nodes = joint_path.nodes
    lo, hi = np.zeros(nodes.size), np.full(nodes.size, switches[-1])
    for _ in range(60):  # s(t) increases: bisect all knots together
        t = 0.5 * (lo + hi)
        below = law(t) < nodes
        lo, hi = np.where(below, t, lo), np.where(below, hi, t)
    passed = t[1:-1]
    apart = 2e-3 if switches[-1] > 0.1 else 2e-2 * switches[-1]
    after = np.clip(np.searchsorted(switches, passed), 1, switches.size - 1)
    near = np.minimum(np.abs(passed - switches[after - 1]), np.abs(passed - switches[after]))
    passed = passed[near > apart]
    keep = np.r_[True, np.diff(passed) > apart][: passed.size]
    return np.sort(np.concatenate([switches, passed[keep]]))


def _piecewise(law: Any, t: Array, x: Array, order: int) -> Array:
    """The law's derivative at x (m, k), by the law's piece that holds each interval of t (so one-sided at its ends)."""
    p = law.derivative(order) if order else law
    i = np.clip(np.searchsorted(law.x, 0.5 * (t[:-1] + t[1:]), side="right") - 1, 0, law.x.size - 2)
    u = x - law.x[i][:, None]
    value = np.zeros_like(u)
    for c in p.c:
        value = value * u + c[i][:, None]
    return np.asarray(value)


def _through(joint_path: JointPath, law: Any, t: Array) -> Trajectory:
    ends = np.stack([t[:-1], t[1:]], axis=1)
    s, v, a = (_piecewise(law, t, ends, order) for order in (0, 1, 2))
    s = np.clip(s, 0.0, joint_path.end)
    s[0, 0], s[-1, 1] = 0.0, joint_path.end
    q, q1, q2 = (joint_path(s.ravel(), order).reshape(*s.shape, -1) for order in (0, 1, 2))
    v, a = v[..., None], a[..., None]
    dq, ddq = q1 * v, q1 * a + q2 * v * v
    q[1:, 0], dq[1:, 0] = q[:-1, 1], dq[:-1, 1]  # one value of q and q̇ at a knot, to the last bit
    return Trajectory(quintic(t, (q[:, 0], dq[:, 0], ddq[:, 0]), (q[:, 1], dq[:, 1], ddq[:, 1])))


def _chain(joint_path: JointPath, law: Any, t: Array, x: Array) -> tuple[Array, Array]:
    """Exact q and jerk at x (m, k) by the chain rule, flattened to (m·k, n)."""
    s, v, a, j = (_piecewise(law, t, x, order).ravel()[:, None] for order in (0, 1, 2, 3))
    at = np.clip(s[:, 0], 0.0, joint_path.end)
    q, q1, q2, q3 = (joint_path(at, order) for order in (0, 1, 2, 3))
    return q, q1 * j + 3.0 * q2 * v * a + q3 * v**3
