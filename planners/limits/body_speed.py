"""Limit on the speed of every point of the arm's body, which is described by capsules."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from optik import kinematics
from optik.arm.robot import Robot
from optik.compiled import compiled
from optik.errors import InvalidInput
from optik.kinematics import Chain
from optik.types import Array, Indices
from planners.limits.base import Limit
from planners.limits.inputs import LimitedMotion, PathPoints, ToolExtreme
from planners.limits.record import PLACES

Capsules = tuple[Indices, Array, Array, Array]
"""Links (c,), both ends of the axes (c, 3) in the frame of the link's joint [m], and radii (c,) [m]."""


@compiled
def capsule_speeds(chain: Chain, capsules: Capsules, q: Array, dq: Array, out: Array) -> None:
    """Write the greatest speeds (k, c) of the points of capsules.

    |v| is convex on a body, so that the greatest one is on an end sphere. On the sphere of radius r about a point with the
    velocity v it is √((v · ω̂)² + (|v × ω̂| + r |ω|)²). Link 0 rests.

    Shapes and units: q (k, n) [rad, m], dq (k, n) [rad/s, m/s], out (k, c) [m/s].
    """
    n = q.shape[1]
    link, first, second, radius = capsules
    prismatic = chain[1]
    frame, v, w, d = np.empty((n, 4, 4)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.empty(3)
    for k in range(q.shape[0]):
        kinematics.frames(chain, q[k], frame)
        for i in range(n):
            for j in range(3):
                d[j] = frame[i, j, 3] - (frame[i - 1, j, 3] if i else frame[i, j, 3])
            for j in range(3):
                a, b, z = (j + 1) % 3, (j + 2) % 3, frame[i, j, 2] * dq[k, i]
                v[i + 1, j] = v[i, j] + w[i, a] * d[b] - w[i, b] * d[a] + (z if prismatic[i] else 0.0)
                w[i + 1, j] = w[i, j] + (0.0 if prismatic[i] else z)
        for c in range(link.shape[0]):
            m = link[c]
            out[k, c] = 0.0
            if m == 0:
                continue
            size = np.sqrt(w[m, 0] ** 2 + w[m, 1] ** 2 + w[m, 2] ** 2)
            for end in range(2):
                p = first[c] if end == 0 else second[c]
                square, along = 0.0, 0.0
                for j in range(3):
                    d[j] = frame[m - 1, j, 0] * p[0] + frame[m - 1, j, 1] * p[1] + frame[m - 1, j, 2] * p[2]
                for j in range(3):
                    a, b = (j + 1) % 3, (j + 2) % 3
                    u = v[m, j] + w[m, a] * d[b] - w[m, b] * d[a]
                    square, along = square + u * u, along + u * w[m, j]
                along = along / size if size > 0.0 else 0.0
                across = np.sqrt(max(square - along * along, 0.0)) + radius[c] * size
                out[k, c] = max(out[k, c], np.sqrt(along * along + across * across))


class BodySpeed(Limit):
    """Every point of the capsules has at most this speed.

    Proof: on an interval of time h a material point has at most the larger of its speeds at both ends, and h² / 8 max |p⃛|.
    """

    name: ClassVar[str] = "body_speed"
    units: ClassVar[tuple[str, str]] = ("m/s", "m/s")
    order: ClassVar[int] = 1
    subject: ClassVar[str | None] = "body"

    PROOF_EXCESS = 1e-4

    def check_robot(self, robot: Robot, limit: Array) -> None:
        """Raise InvalidInput for an arm without shapes."""
        if robot.shapes is None and self.is_given(limit):
            raise InvalidInput(
                self.name, f"{robot.name} without shapes", "an arm with shapes: Robot.from_urdf(..., shapes=True)"
            )

    @staticmethod
    def _speeds(robot: Robot, q: Array, dq: Array) -> Array:
        """Return the greatest speeds (k, c) of the capsules."""
        assert robot.shapes is not None
        out = np.empty((len(q), len(robot.shapes.capsules[0])))
        q, dq = np.ascontiguousarray(robot.spread(q)), np.ascontiguousarray(robot.spread(dq, 1))
        capsule_speeds(robot.axes.chain, robot.shapes.capsules, q, dq, out)
        return out

    def rows(self, at: PathPoints, limit: Array) -> Array:
        """Return the rows at points of a joint path."""
        if not self.is_given(limit):
            return np.zeros((at.s.size, 1, 1))
        return np.asarray(self._speeds(at.joint_path.robot, at.q(0), at.q(1))[..., None] / limit[0])

    def piece_ratios(self, motion: LimitedMotion, limit: Array) -> Array:
        """Return the ratios on each piece of a motion, sampled."""
        states, t = motion.states(PLACES[::2])
        states = states.reshape(-1, *states.shape[2:])
        speeds = self._speeds(motion.robot, states[:, 0], states[:, 1])
        return np.asarray(speeds.max(axis=1).reshape(t.shape).max(axis=1, keepdims=True) / limit[0])

    def judge(self, motion: LimitedMotion, limit: Array) -> ToolExtreme:
        """Return the proved greatest speed, its ratio and its time."""
        robot = motion.robot.axes
        assert robot.shapes is not None
        link, first, second, radius = robot.shapes.capsules
        unit = float(limit[0]) if self.is_given(limit) else 1.0
        away = np.maximum(np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1)) + radius

        def evaluate(joints: Array) -> Array:
            speeds = self._speeds(robot, joints[:, 0], joints[:, 1]) / unit
            return np.concatenate([speeds.max(axis=1, keepdims=True), speeds], axis=1)

        def enclose(one: Array, other: Array, h: Array, B: Array, P: Array) -> Array:
            third = np.where(link > 0, P[:, link, 3] + away * B[:, link, 3], 0.0) / unit
            return np.asarray((np.maximum(one[:, 1:], other[:, 1:]) + h[:, None] ** 2 / 8.0 * third).max(axis=1))

        ratio, time = motion.prove_peak((self.name, unit), evaluate, enclose, self.PROOF_EXCESS)
        if motion.jumps[0].any():
            ratio = np.inf
        return ToolExtreme(ratio * unit, ratio if self.is_given(limit) else np.nan, time)


METHOD = BodySpeed
