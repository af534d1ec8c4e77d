"""Retargeted: the motion onto another target, and how it relates to it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from optik.arm.robot import Robot
from optik.types import Array
from planners.limits import MotionLimits
from planners.retarget.certificate import StreamCertificate, trajectory_of
from planners.retarget.cubics import JointCubics
from planners.retarget.reference import BASIS
from planners.trajectory import State, Trajectory, shift_pieces

JOINED_WITHIN = 0.01
"""Distance of every joint to the paced chunk at which a motion has joined it [rad, m]."""


class RetargetStatus(StrEnum):
    """The kind of motion that `retarget` found.

    JOINED: it goes onto the chunk or the plan. GOAL: it goes to joints, or at a velocity. KEPT: it is the running motion,
    because no other was proved.
    """

    JOINED = "joined"
    GOAL = "goal"
    KEPT = "kept"


class Reference(NamedTuple):
    """The paced reference of a chunk.

    ``c`` (k, n) are the coefficients of a uniform quintic B-spline with intervals ``h`` [s] of the chunk's time. ``s`` is the
    chunk's time at the instants ``when`` (m,) of the motion [s], linear between them. ``error`` [rad, m] is the largest
    distance to a target.
    """

    c: Array
    h: float
    when: Array
    s: Array
    error: float

    def error_of(self, motion: Trajectory) -> Trajectory:
        """Return the difference between a motion and the paced reference, as exact polynomials."""
        k, at, s = len(self.c), self.when, self.s
        windows = np.lib.stride_tricks.sliding_window_view(self.c, 6, axis=0)  # (k − 5, n, 6)
        spline = np.einsum("ap,ina->pin", BASIS[0] / self.h ** np.arange(6), windows)[::-1]
        inside = np.arange(1, k - 5) * self.h
        crossed = np.interp(inside[(inside > s[0]) & (inside < s[-1])], s, at)
        t = np.unique(np.concatenate([motion.knots, at[at < motion.end], crossed[crossed < motion.end]]))
        t = t[np.append(True, np.diff(t) > 1e-12)]
        begin, middle = t[:-1], 0.5 * (t[:-1] + t[1:])
        piece = np.searchsorted(motion.knots, middle) - 1
        q = shift_pieces(motion.padded[:, piece], begin - motion.knots[piece])
        i = np.clip(np.searchsorted(at, middle) - 1, 0, at.size - 2)
        moves = (middle > at[0]) & (middle < at[-1])
        rate = np.where(moves, (s[i + 1] - s[i]) / (at[i + 1] - at[i]), 0.0)
        place = np.interp(begin, at, s)
        span = np.clip((np.interp(middle, at, s) / self.h).astype(int), 0, k - 6)
        r = shift_pieces(spline[:, span], place - span * self.h)
        return Trajectory(scipy.interpolate.PPoly(q - r * rate[:, None] ** np.arange(5, -1, -1)[:, None, None], t))


@dataclass(frozen=True, eq=False)
class Retargeted:
    """The result of `retarget`: a motion from the running motion's state to rest. ``bool(result)``: it goes to the target.

    Attributes
    ----------
    status : RetargetStatus
        JOINED, GOAL or KEPT.
    reason : str
        Why the running motion was kept; empty otherwise.
    robot, limits
        The arm, and the limits that the certificate covers.
    at : float
        Time of the running motion at which this motion begins [s].
    curve : JointCubics or Trajectory
        The motion as it was found; `trajectory` is the same.
    certificate : StreamCertificate
        Of the motion; of a kept one for these limits, which it may exceed, and without its scene.
    skipped, repaired : int
        Targets of the chunk before its entry, and targets that were changed. A target is changed if it is outside the ranges,
        or if it alone repeats the one before.
    reference : Reference or None
        The paced reference of a chunk.
    clipped, jumps : int
        Targets of the chunk that were clipped to the ranges; those at which a joint with limits jumps by more than π.
    scatter : float
        Largest standard deviation of the chunk's targets about a smooth curve, over the joints [rad, m].
    cut : str
        Why a chunk of poses ends before its last one; empty if it does not.
    """

    status: RetargetStatus
    reason: str
    robot: Robot
    limits: MotionLimits
    at: float
    curve: JointCubics | Trajectory
    certificate: StreamCertificate
    skipped: int = 0
    repaired: int = 0
    reference: Reference | None = field(default=None, repr=False)
    clipped: int = 0
    jumps: int = 0
    scatter: float = 0.0
    cut: str = ""

    def __bool__(self) -> bool:
        return self.status is not RetargetStatus.KEPT

    def __str__(self) -> str:
        words = {
            RetargetStatus.JOINED: "joins the target",
            RetargetStatus.GOAL: "goes to the target",
            RetargetStatus.KEPT: f"keeps the running motion: {self.reason}",
        }
        lines = [f"{words[self.status]}, from t = {self.at:.6g} s"]
        if self.reference is not None and self:
            after = self.joined_after
            when = "never" if after is None else f"after {after:.3g} s"
            lines.append(f"within {1e3 * JOINED_WITHIN:g} mrad of the paced chunk {when}, pace {self.pace:.3g}")
            lines.append(f"{self.skipped} targets skipped, {self.repaired} repaired")
        return "\n".join([*lines, *([self.cut] if self and self.cut else []), str(self.certificate)])

    def state(self, t: float) -> State:
        """Return position, velocity and acceleration.

        Parameters
        ----------
        t : float
            Time since `at` [s]; after the end the arm is at rest.

        Returns
        -------
        tuple of (n,) arrays
            q, q̇, q̈ [rad, rad/s, rad/s², or m].
        """
        return state_of(self.trajectory, t)

    @cached_property
    def trajectory(self) -> Trajectory:
        """The motion, ``trajectory(t, order)`` for t [s] since `at`, as a `Trajectory`, which `planners.certify` judges."""
        return trajectory_of(self.curve)

    @property
    def pace(self) -> float:
        """Mean rate at which the motion goes through the chunk, over that of the chunk [1]; 1 without a chunk."""
        if self.reference is None:
            return 1.0
        when, s = self.reference.when, self.reference.s
        done = np.flatnonzero(s >= s[-1] - 1e-9)[0]
        return float((s[done] - s[0]) / (when[done] - when[0]))

    @cached_property
    def _error(self) -> Trajectory | None:
        return None if self.reference is None else self.reference.error_of(self.trajectory)

    @cached_property
    def joined_after(self) -> float | None:
        """Time since `at` from which every joint stays within 10 mrad of the paced chunk, proved [s]; None if there is none."""
        if self._error is None or not self:
            return None
        far = np.flatnonzero(self._error.piece_worst(0).max(axis=1) > JOINED_WITHIN)
        t = self._error.knots
        if far.size and far[-1] == t.size - 2:
            return None
        return float(t[far[-1] + 1]) if far.size else 0.0

    @property
    def deviation(self) -> float | None:
        """Proved largest distance of a joint to the paced chunk after `joined_after`, else of the whole motion [rad, m]."""
        if self._error is None:
            return None
        after = 0.0 if self.joined_after is None else self.joined_after
        return float(self._error.piece_worst(0)[self._error.knots[:-1] >= after].max())


def state_of(trajectory: Trajectory, t: float) -> State:
    """Return q, q̇ and q̈ of a motion at a time [s]; after its end it is at rest."""
    if t >= trajectory.end:
        q = trajectory(trajectory.end)
        return q, np.zeros_like(q), np.zeros_like(q)
    return trajectory(t), trajectory(t, 1), trajectory(t, 2)
