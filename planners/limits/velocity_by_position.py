"""Limit on joint velocities that falls towards the ends of the ranges, as FR3's controller checks it."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from optik.arm.limits import VelocityByPosition
from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.types import Array, Flags
from planners.limits._bernstein import multiply, on_pieces, proves_above
from planners.limits.inputs import Extreme, LimitedMotion, LimitedPath, PathPoints
from planners.limits.record import PLACES, RecordLimit

FIRST_EXCESS, RAISED, RAISES = 1e-9, 10.0, 9
"""Excess of the first proved ratio over the sampled one, its growth where the proof fails, and the most proofs."""
STILL = 1e-12
"""Velocity, or derivative in s over the largest one, below which a joint rests: it is rounding."""


class VelocityByPositionLimit(RecordLimit):
    """|q̇| ≤ min(v, −o + √(2 d r)), where r is the distance to the end of the range towards which the joint moves.

    v is the robot's velocity limit, and o and d are the record's offset and deceleration. The ratio λ of a motion is proved as
    2 d r − (q̇ / λ + o)² ≥ 0 wherever the joint moves towards the end: a polynomial of degree 8 in t on each piece, by its
    Bernstein coefficients.
    """

    name: ClassVar[str] = "velocity_by_position"
    units: ClassVar[tuple[str, str]] = ("rad/s", "m/s")
    order: ClassVar[int] = 1
    subject: ClassVar[str | None] = None
    record: ClassVar[Any] = VelocityByPosition

    def check_robot(self, robot: Robot, limit: Any) -> None:
        """Raise InvalidInput for another number of joints, or for a joint without a range that has a deceleration."""
        limited = np.isfinite(limit.deceleration)
        if limited.size != robot.n:
            raise InvalidInput(self.name, f"{limited.size} joints", f"the {robot.n} of {robot.name}")
        if (limited & ~np.isfinite(robot.limits.half)).any():
            raise InvalidInput(self.name, f"a joint of {robot.name} without a range", "joints with two finite limits")

    def _most(self, robot: Robot, limit: Any, q: Array, up: Flags) -> Array:
        """Return the greatest speeds (..., n) at q towards the upper or the lower end; negative beyond where they are 0."""
        limits = robot.limits
        room = np.maximum(np.where(up, limits.upper - q, q - limits.lower), 0.0)
        with np.errstate(invalid="ignore"):
            braked = np.sqrt(2.0 * limit.deceleration * room) - limit.offset
            most = np.where(np.isfinite(limit.deceleration), braked, np.inf)
        return np.asarray(most if limits.velocity is None else np.minimum(most, limits.velocity))

    def _ratio(self, robot: Robot, limit: Any, q: Array, v: Array, still: Array | float) -> Array:
        """Return |v| over the greatest speeds; infinite where a joint moves and none is allowed."""
        most = self._most(robot, limit, q, v > 0.0)
        ratio = np.where(most > 0.0, np.abs(v) / np.where(most > 0.0, most, 1.0), np.inf)
        return np.where(np.abs(v) > still, ratio, 0.0)

    def rows(self, at: PathPoints, limit: Any) -> Array:
        """Return the rows at points of a joint path."""
        still = STILL * np.abs(at.q(1)).max(initial=0.0)
        return self._ratio(at.joint_path.robot, limit, at.q(0), at.q(1), still)[:, :, None]

    def piece_ratios(self, motion: LimitedMotion, limit: Any) -> Array:
        """Return the ratios on each piece of a motion, sampled."""
        states, _ = motion.states(PLACES)
        return np.asarray(self._ratio(motion.robot, limit, states[:, :, 0], states[:, :, 1], STILL).max(axis=1))

    def judge(self, motion: LimitedMotion, limit: Any) -> Extreme:
        """Return the proved ratio of each joint, with the velocity and the time of the largest sampled one."""
        states, t = motion.states(PLACES)
        ratio = self._ratio(motion.robot, limit, states[:, :, 0], states[:, :, 1], STILL).reshape(t.size, -1)
        where, joints = ratio.argmax(axis=0), np.arange(motion.robot.n)
        found, proved, excess = ratio.max(axis=0), np.full(motion.robot.n, np.inf), FIRST_EXCESS
        for _ in range(RAISES):
            tried = found * (1.0 + excess)
            left = np.flatnonzero(~np.isfinite(proved) & (found < np.inf)).tolist()
            holds = [i for i in left if found[i] == 0.0 or self._proves(motion, limit, i, tried[i])]
            proved[holds] = tried[holds]
            if holds == left:
                break
            excess *= RAISED
        value = np.abs(states[:, :, 1].reshape(t.size, -1)[where, joints])
        if motion.jumps[0].any():
            proved = np.full_like(proved, np.inf)
        return Extreme(value, proved, t.ravel()[where])

    def _proves(self, motion: LimitedMotion, limit: Any, i: int, ratio: float) -> bool:
        """Return whether a joint's motion is proved to respect the limit times a ratio."""
        limits, pieces = motion.robot.limits, motion.trajectory
        q, v = on_pieces(pieces, 0)[..., i], on_pieces(pieces, 1)[..., i] / ratio
        if limits.velocity is not None:
            most = float(limits.velocity[i])
            if np.isfinite(most) and not all(proves_above(sign * v, -most) for sign in (1.0, -1.0)):
                return False
        if not np.isfinite(limit.deceleration[i]):
            return True
        for sign, end in ((1.0, limits.upper[i]), (-1.0, limits.lower[i])):
            towards, room = sign * v, -sign * q
            room[0] += sign * end
            shifted = towards.copy()
            shifted[0] += limit.offset[i]
            margin = -multiply(shifted, shifted)
            margin[: room.shape[0]] += 2.0 * limit.deceleration[i] * room
            if not proves_above(margin, 0.0, where=towards):
                return False
        return True

    def check_still(self, joint_path: LimitedPath, limit: Any) -> None:
        """Refuse a path on which a joint must move where its limit is 0."""
        robot, s = joint_path.robot, np.linspace(0.0, joint_path.end, 257)
        q, q1 = joint_path(s), joint_path(s, 1)
        blocked = (self._most(robot, limit, q, q1 > 0.0) <= 0.0) & (np.abs(q1) > 1e-9 * np.abs(q1).max())
        if not blocked.any():
            return
        k, i = (int(x) for x in np.argwhere(blocked)[0])
        gap, up = limit.offset[i] ** 2 / (2.0 * limit.deceleration[i]), bool(q1[k, i] > 0.0)
        end = robot.limits.upper[i] if up else robot.limits.lower[i]
        unit = "m" if robot.prismatic[i] else "rad"
        allowed = f"{'below' if up else 'above'} {end - gap if up else end + gap:.6g} {unit}"
        raise NoSolution(
            f"{robot.joint_names[i]} moves at {q[k, i]:.6g} {unit} towards the {'upper' if up else 'lower'} end of its "
            f"range, {end:.6g} {unit}; there its velocity limit by position is 0, and above 0 only {allowed}",
            s=float(s[k]), joint=robot.joint_names[i], advice=f"a path on which {robot.joint_names[i]} stays {allowed}",
        )  # fmt: skip

    def scaled(self, value: Any, factor: float) -> Any:
        """Return the record whose greatest speeds by position are multiplied by a factor."""
        return VelocityByPosition(factor * value.offset, factor**2 * value.deceleration)


METHOD = VelocityByPositionLimit
