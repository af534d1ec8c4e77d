"""Limit on joint accelerations that falls with the speed, as motors give it, with a limit of its own on the deceleration."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import scipy
from numpy.typing import ArrayLike

from optik.arm.limits import check_positive
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.types import Array
from planners.limits.inputs import Extreme, LimitedMotion, PathPoints
from planners.limits.record import PLACES, Record, SampledLimit, dynamic_share, find_velocity_reversals
from planners.trajectory import Trajectory
from planners.trajectory.trajectory import shift_pieces

FREE = 1e6
"""Acceleration [rad/s², m/s²] that stands for an infinite limit: a row needs two sides."""
Numbers = float | tuple[float, ...]
"""One number, or one for each joint."""


def _numbers(value: ArrayLike | None, name: str) -> Numbers | None:
    """Return numbers above 0 that a record can hold."""
    if value is None:
        return None
    kept = check_positive(value, np.size(value), f"acceleration_by_velocity.{name}")
    return tuple(kept.tolist()) if np.ndim(value) else float(kept[0])


@dataclass(frozen=True)
class AccelerationByVelocity(Record):
    """A limit on joint accelerations that falls linearly with the speed.

    Parameters
    ----------
    acceleration : float or tuple of n
        Greatest acceleration at rest [rad/s², m/s²].
    deceleration : float or tuple of n, optional
        Greatest deceleration at any speed [rad/s², m/s²]; by default the acceleration at rest.
    free_speed : float or tuple of n, optional
        Speed at which the acceleration is 0 [rad/s, m/s]; infinity for one that does not fall; by default the robot's velocity
        limit.
    """

    acceleration: Numbers = field(metadata={"unit": "rad/s²"})
    deceleration: Numbers | None = field(default=None, metadata={"unit": "rad/s²"})
    free_speed: Numbers | None = field(default=None, metadata={"unit": "rad/s"})

    def __post_init__(self) -> None:
        for name in ("acceleration", "deceleration", "free_speed"):
            object.__setattr__(self, name, _numbers(getattr(self, name), name))


class AccelerationByVelocityLimit(SampledLimit):
    """y = σ q̈ with σ = sign q̇ respects −D ≤ y and y + β |q̇| ≤ A, where β = A / v₀ and v₀ is the free speed.

    It adds two rows for each joint, y + β |q̇| and y, both in [−D, A]; their other sides are implied. The ratio of a joint is
    the larger of (y + β |q̇|) / A and −y / D. Both are polynomials of degree 4 in t where q̇ has one sign, judged by their
    exact extrema.
    """

    name: ClassVar[str] = "acceleration_by_velocity"
    units: ClassVar[tuple[str, str]] = ("rad/s²", "m/s²")
    order: ClassVar[int] = 2
    subject: ClassVar[str | None] = None
    homogeneous: ClassVar[bool] = False
    record: ClassVar[Any] = AccelerationByVelocity

    def check_robot(self, robot: Robot, limit: AccelerationByVelocity) -> None:
        """Raise InvalidInput without a free speed or velocity limits, or for another number of joints."""
        if limit.free_speed is None and robot.limits.velocity is None:
            expected = f"free_speed: {robot.name} has no velocity limits"
            raise InvalidInput(self.name, "no free_speed", expected)
        for values in (limit.acceleration, limit.deceleration, limit.free_speed):
            if values is not None and np.size(values) not in (1, robot.n):
                raise InvalidInput(self.name, f"{np.size(values)} numbers", f"one number, or {robot.n} of them")

    @staticmethod
    def _numbers(robot: Robot, limit: AccelerationByVelocity) -> tuple[Array, Array, Array]:
        """Return A, D and β (n,)."""
        speed = robot.limits.velocity if limit.free_speed is None else limit.free_speed
        braking = limit.acceleration if limit.deceleration is None else limit.deceleration
        given = (
            np.broadcast_to(np.asarray(x, dtype=np.float64), (robot.n,)) for x in (limit.acceleration, braking, speed)
        )
        A, D, v0 = next(given).clip(max=FREE), next(given).clip(max=FREE), next(given)
        return A, D, np.where(A < FREE, A / v0, 0.0)

    def rows(self, at: PathPoints, limit: AccelerationByVelocity) -> Array:
        """Return the rows at points of a joint path; a joint that reverses nearby has the rows of both directions."""
        A, D, beta = self._numbers(at.joint_path.robot, limit)
        q1, q2 = at.q(1), at.q(2)
        sign = np.where(q1 < 0.0, -1.0, 1.0)
        out = np.zeros((*q1.shape, 3, 4))
        out[..., 0], out[..., 1] = (sign * q1)[..., None], (sign * q2)[..., None]
        out[..., 0, 2] = beta * np.abs(q1)
        out[..., 2, :2] *= -1.0  # the other direction
        middle, half = 0.5 * (A - D)[:, None], 0.5 * (A + D)[:, None]
        out[..., 3] = -middle / half
        out[..., :3] /= half[..., None]
        out[..., 2, :] = np.where(find_velocity_reversals(q1)[..., None], out[..., 2, :], 0.0)
        return out.reshape(q1.shape[0], -1, 4)

    def _parts(self, motion: LimitedMotion) -> tuple[Array, Array, Array]:
        """Return y and |q̇| (m, k, n) at sampled instants."""
        states, t = motion.states(PLACES)
        v = states[:, :, 1]
        return np.where(v < 0.0, -1.0, 1.0) * states[:, :, 2], np.abs(v), t

    def sample_ratios(self, motion: LimitedMotion, limit: AccelerationByVelocity, c: float = 1.0) -> Array:
        """Return the ratios (m, k, n) of a motion stretched by c at sampled instants."""
        (A, D, beta), (y, w, _) = self._numbers(motion.robot, limit), self._parts(motion)
        return np.asarray(np.maximum((y / c**2 + beta * w / c) / A, -y / c**2 / D))

    def excess(self, motion: LimitedMotion, limit: AccelerationByVelocity) -> Array:
        """Return the dynamic share of each row."""
        (A, D, beta), (y, w, _) = self._numbers(motion.robot, limit), self._parts(motion)
        middle, half = 0.5 * (A - D), 0.5 * (A + D)
        out = []
        for value in (y + beta * w, y, -y):
            row = (value - middle) / half
            static = np.copysign(1.0, row) * (-middle / half)
            out.append(dynamic_share(np.abs(row), static))
        v, h = motion.trajectory.piece_range(1), np.diff(motion.trajectory.knots)[:, None]
        both = (v[0] <= 0.0) & (v[1] >= 0.0) & (h > 0.0)
        out[2] = np.where(both, out[2], 0.0)
        return np.stack(out, axis=2).reshape(y.shape[0], -1)

    def judge(self, motion: LimitedMotion, limit: AccelerationByVelocity) -> Extreme:
        """Return the exact peak ratio of each joint, with the acceleration and the time there."""
        A, D, beta = self._numbers(motion.robot, limit)
        divided = _divide_at_reversals(motion.trajectory)
        c, h = divided.padded[::-1], np.diff(divided.knots)
        speed, rate = (np.zeros((6, h.size, motion.robot.n)) for _ in range(2))
        for p in range(5):
            speed[p] = (p + 1) * c[p + 1]
        for p in range(4):
            rate[p] = (p + 1) * speed[p + 1]
        middle = sum(speed[p] * (0.5 * h[:, None]) ** p for p in range(5))
        sign = np.where(middle < 0.0, -1.0, 1.0)
        driving, braking = sign * (rate + beta * speed) / A, -sign * rate / D
        extrema = [
            Trajectory(scipy.interpolate.PPoly(each[::-1], divided.knots)).extrema(0) for each in (driving, braking)
        ]
        ratio = np.stack([each.greatest for each in extrema])
        which, joints = ratio.argmax(axis=0), np.arange(motion.robot.n)
        ratio, time = ratio[which, joints], np.stack([each.t_greatest for each in extrema])[which, joints]
        value = np.abs(motion.trajectory(np.minimum(time, motion.trajectory.end), 2)[joints, joints])
        ratio = np.where(motion.jumps[:2].any(axis=(0, 1)), np.inf, ratio)
        return Extreme(value, ratio, time)

    def scaled(self, value: AccelerationByVelocity, factor: float) -> AccelerationByVelocity:
        """Return the record with its accelerations multiplied by a factor."""
        given = {name: getattr(value, name) for name in ("acceleration", "deceleration")}
        scaled: dict[str, Any] = {name: factor * np.asarray(x) for name, x in given.items() if x is not None}
        return replace(value, **scaled)


def _divide_at_reversals(trajectory: Trajectory) -> Trajectory:
    """Return a motion with knots where a joint reverses, so that each velocity has one sign on each piece."""
    low, high = trajectory.piece_range(1)
    knots, times = trajectory.knots, [trajectory.knots]
    for k, i in np.argwhere((low < 0.0) & (high > 0.0)):
        roots = np.roots(trajectory.padded[:5, k, i] * np.arange(5, 0, -1))
        real = roots.real[np.abs(roots.imag) <= 1e-6 * (1.0 + np.abs(roots.real))]
        times.append(knots[k] + real[(real > 0.0) & (real < knots[k + 1] - knots[k])])
    new = np.unique(np.concatenate(times))
    piece = np.clip(np.searchsorted(knots, new[:-1], side="right") - 1, 0, knots.size - 2)
    return Trajectory(scipy.interpolate.PPoly(shift_pieces(trajectory.padded[:, piece], new[:-1] - knots[piece]), new))


METHOD = AccelerationByVelocityLimit
