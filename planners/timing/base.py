"""What every time law shares: the limits, what it promises, and the refit of a law on s to a trajectory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array
from planners.following.follow import JointPath
from planners.hermite import quintic
from planners.limits import DERIVATIVES, MotionLimits
from planners.trajectory import Trajectory


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


METHOD_BASE = TimeLaw
"""What the METHOD of every module here, and of every plug-in, is a subclass of."""
