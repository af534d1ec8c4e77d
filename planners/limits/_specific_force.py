"""Limits on the specific force f = Rᵀ (g − p̈) of a carried object at its centre of mass p, in the tool's frame R.

Along a path f = Rᵀ g − Rᵀ p' s̈ − Rᵀ p'' ṡ², so each face E f ≤ b of a polytope is a row of second order. A cone is described by
`FACES` faces that touch it, one of them in the direction of Rᵀ p', or of gravity where it acts across the axis. The law
tightens them by the exact cone. On an interval of time h, f is within h⁴ / 384 max|f⁗| of its cubic Hermite interpolant, which
is in the hull of its four Bézier points. Measures of f are convex, or have convex level sets, so that the largest of the four,
with the remainder, bounds them. By Leibniz's rule

    |f⁗| ≤ B₄ (|g| + P₂) + 4 B₃ P₃ + 6 B₂ P₄ + 4 B₁ P₅ + P₆

with the bounds B on derivatives of rotations, and P on those of p (`planners.certificate.bounds.link_bounds`).
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from optik import kinematics
from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners.limits.inputs import LimitedMotion, LimitedPath, PathPoints, ToolExtreme
from planners.limits.record import PLACES, SampledLimit

FACES = 16
"""Faces of a cone: the optimum is the same from 6 on where the tool does not turn."""
EVENLY = 2.0 * np.pi * np.arange(FACES) / FACES
"""Directions of the faces around the axis, from that of Rᵀ p' on."""
NEAR_LOAD = np.deg2rad([0, 5, -5, 10, -10, 16, -16, 23, -23, 31, -31, 45, -45, 80, -80, 180])
"""Directions of the faces where gravity acts across the axis, from its own on: the cone is used near it."""
LOADED_SHARE = 0.3
"""Fraction of gravity that acts across the axis from which on the faces are near it."""
FAR_SIDE = 4.0 * 9.81
"""How far the other side of a one-sided row is away [m/s²]."""
PROOF_EXCESS = 1e-5
"""Largest excess of a proved value over the largest one found."""


class SpecificForceLimit(SampledLimit):
    """Base of the limits on the specific force of a carried object."""

    order: ClassVar[int] = 2
    homogeneous: ClassVar[bool] = False
    on_goods: ClassVar[bool] = True
    units: ClassVar[tuple[str, str]] = ("1", "1")

    # ------------------------------------------------------------ what a member defines

    def axis(self, limit: Any) -> Array:
        """Return the axis (3,) of the cone in the tool's frame."""
        return np.asarray(limit.axis)

    @abstractmethod
    def faces(self, limit: Any, mass: float, around: Array) -> tuple[Array, Array]:
        """Return E (k, m, 3) and b (m,) of E f ≤ b, from unit vectors (k, FACES, 3) across the axis."""

    @abstractmethod
    def measure(self, limit: Any, mass: float, f: Array, off: Array | float = 0.0) -> Array:
        """Return the ratio (k,) to the limit of specific forces (k, 3), or a bound on those within `off` (k,) of them."""

    def value(self, limit: Any) -> float:
        """Return the limited value at a ratio of 1."""
        return 1.0

    needs_mass: ClassVar[bool] = True

    # ------------------------------------------------------------ the object

    def check_robot(self, robot: Robot, limit: Any) -> None:
        """Raise InvalidInput without gravity, or without the object's mass where the limit depends on it."""
        if not robot.gravity_magnitude > 0.0:
            raise InvalidInput(self.name, f"{robot.name} without gravity", "an arm with gravity")
        if self.needs_mass and limit.mass is None and robot.payload is None:
            raise InvalidInput(self.name, "no mass", f"mass [kg], or a payload of {robot.name}")

    @staticmethod
    def _object(robot: Robot, limit: Any) -> tuple[float, Array]:
        """Return the object's mass, the heaviest of an interval, and its centre of mass in the tool's frame."""
        payload, mass = robot.payload, getattr(limit, "mass", None)
        com = limit.com if limit.com is not None else (0.0, 0.0, 0.0) if payload is None else payload.com
        return float(mass if mass is not None else 1.0 if payload is None else payload.masses[-1]), np.asarray(com)

    def _chain(self, robot: Robot, limit: Any) -> Any:
        """Return the kinematics of the object's centre of mass."""
        tool = robot.tool.copy()
        tool[:3, 3] += tool[:3, :3] @ self._object(robot, limit)[1]
        return (*robot.chain[:2], tool, *robot.chain[3:])

    def _move(self, robot: Robot, limit: Any, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        """Return Rᵀ g, R (k, 3, 3) and the twist of the centre of mass with two derivatives (k, 3, 6)."""
        chain, q = self._chain(robot, limit), np.ascontiguousarray(q)
        poses, motion = np.empty((len(q), 4, 4)), np.empty((len(q), 3, 6))
        kinematics.fk_batch(chain, q, poses)
        kinematics.tool_motion_batch(chain, q, np.ascontiguousarray(dq), motion)
        R = poses[:, :3, :3]
        return _turn_back(R, np.broadcast_to(_gravity(robot), (len(q), 3))), R, motion

    def _force(self, robot: Robot, limit: Any, joints: Array) -> tuple[Array, Array, Array]:
        """Return Rᵀ g, f and ḟ (k, 3) at states (k, 6, n)."""
        still, R, motion = self._move(robot, limit, joints[:, 0], joints[:, 1:4])
        apparent = _gravity(robot) - motion[:, 1, :3]
        rate = -motion[:, 2, :3] - np.cross(motion[:, 0, 3:], apparent)
        return still, _turn_back(R, apparent), _turn_back(R, rate)

    def _sample(self, motion: LimitedMotion, limit: Any) -> tuple[Array, Array]:
        """Return Rᵀ g and f (m, k, 3) at sampled instants."""
        states, t = motion.states(PLACES)
        still, f, _ = self._force(motion.robot, limit, states.reshape(-1, *states.shape[2:]))
        return still.reshape(*t.shape, 3), f.reshape(*t.shape, 3)

    def sample_ratios(self, motion: LimitedMotion, limit: Any, c: float = 1.0) -> Array:
        """Return the ratios (m, k, 1) of a motion stretched by c at sampled instants."""
        still, f = self._sample(motion, limit)
        given = (still + (f - still) / c**2).reshape(-1, 3)
        return self.measure(limit, self._object(motion.robot, limit)[0], given).reshape(*f.shape[:-1], 1)

    # ------------------------------------------------------------ Limit

    def rows(self, at: PathPoints, limit: Any) -> Array:
        """Return the rows at points of a joint path."""
        robot, q1, q2 = at.joint_path.robot, at.q(1), at.q(2)
        still, R, motion = self._move(robot, limit, at.q(0), np.stack([q1, q2, np.zeros_like(q1)], axis=1))
        linear, square = -_turn_back(R, motion[:, 0, :3]), -_turn_back(R, motion[:, 1, :3])
        n = self.axis(limit)
        x = np.cross(n, np.eye(3)[np.abs(n).argmin()])
        x /= np.linalg.norm(x)
        y = np.cross(n, x)
        loaded = np.hypot(still @ x, still @ y) > LOADED_SHARE * np.linalg.norm(still, axis=1)
        towards = np.where(loaded[:, None], still, linear)
        turned = np.arctan2(towards @ y, towards @ x)[:, None] + np.where(loaded[:, None], NEAR_LOAD, EVENLY)
        around = np.cos(turned)[..., None] * x + np.sin(turned)[..., None] * y
        E, b = self.faces(limit, self._object(robot, limit)[0], around)
        out = np.zeros((len(still), E.shape[1], 4))  # (2 E f − b + w) / (b + w) in [−1, 1]: E f between −w and b
        for column, part in ((0, linear), (1, square), (3, still)):
            out[..., column] = 2.0 * np.einsum("kmi,ki->km", E, part) / (b + FAR_SIDE)
        out[..., 3] += (FAR_SIDE - b) / (b + FAR_SIDE)
        return out

    def excess(self, motion: LimitedMotion, limit: Any) -> Array:
        """Return the dynamic share of the exact cone, the same for all rows."""
        return np.repeat(super().excess(motion, limit), self.faces(limit, 1.0, np.zeros((1, FACES, 3)))[1].size, axis=1)

    def judge(self, motion: LimitedMotion, limit: Any) -> ToolExtreme:
        """Return the proved peak value, its ratio and its time."""
        robot = motion.robot.axes
        mass, com = self._object(robot, limit)
        away = float(np.linalg.norm(robot.tool[:3, 3] + robot.tool[:3, :3] @ com))
        g = robot.gravity_magnitude

        def evaluate(joints: Array) -> Array:
            _, f, rate = self._force(robot, limit, joints)
            return np.concatenate([self.measure(limit, mass, f)[:, None], f, rate], axis=1)

        def enclose(first: Array, last: Array, h: Array, B: Array, P: Array) -> Array:
            B = B[:, -1]
            P = P[:, -1] + away * B
            P4 = (
                B[:, 4] * (g + P[:, 2])
                + 4 * B[:, 3] * P[:, 3]
                + 6 * B[:, 2] * P[:, 4]
                + 4 * B[:, 1] * P[:, 5]
                + P[:, 6]
            )
            off, third = P4 * h**4 / 384.0, h[:, None] / 3.0
            points = (
                first[:, 1:4],
                first[:, 1:4] + third * first[:, 4:],
                last[:, 1:4] - third * last[:, 4:],
                last[:, 1:4],
            )
            return np.asarray(np.max([self.measure(limit, mass, point, off) for point in points], axis=0))

        ratio, time = motion.prove_peak((self.name, limit), evaluate, enclose, PROOF_EXCESS)
        if motion.jumps[:2].any():
            ratio = np.inf
        return ToolExtreme(ratio * self.value(limit), ratio, time)

    def check_still(self, joint_path: LimitedPath, limit: Any) -> None:
        """Refuse a path on which the object is not held at rest."""
        robot, s = joint_path.robot, np.linspace(0.0, joint_path.end, 257)
        q = joint_path(s)
        still, _, _ = self._move(robot, limit, q, np.zeros((len(q), 3, robot.n)))
        ratio = self.measure(limit, self._object(robot, limit)[0], still)
        k = int(ratio.argmax())
        if ratio[k] >= 1.0:
            words = f"{self.describe(limit, float(ratio[k]))} at rest at s = {s[k]:.6g}"
            raise NoSolution(
                words,
                s=float(s[k]),
                advice="another path, another axis of the object in the tool's frame, or a higher limit",
            )

    def describe(self, limit: Any, ratio: float) -> str:
        """Return a sentence about a ratio."""
        return f"the {self.name.replace('_', ' ')} needs {ratio:.4g} times its limit"


def _gravity(robot: Robot) -> Array:
    """Return the acceleration of gravity (3,) in the base frame [m/s²]."""
    g = np.asarray(robot.gravity, dtype=np.float64)
    return np.asarray(robot.gravity_magnitude * g / np.linalg.norm(g))


def _turn_back(R: Array, x: Array) -> Array:
    """Return Rᵀ x for many."""
    return np.asarray(np.einsum("kji,kj->ki", R, x))


def split_by_axis(f: Array, axis: Array) -> tuple[Array, Array]:
    """Return the components of vectors along an axis, and the size of those across it."""
    along = f @ axis
    return along, np.sqrt(np.maximum(np.einsum("ki,ki->k", f, f) - along**2, 0.0))


class TiltLimit(SpecificForceLimit):
    """Base of the limits on the angle between the apparent gravity f and the direction below a container or a tray."""

    units: ClassVar[tuple[str, str]] = ("rad", "rad")
    needs_mass: ClassVar[bool] = False

    def value(self, limit: Any) -> float:
        """Return the greatest angle [rad]."""
        return float(limit.largest_angle)

    def faces(self, limit: Any, mass: float, around: Array) -> tuple[Array, Array]:
        """Return the faces (x cos φ + y sin φ + n tan θ) f ≤ 0, over tan θ."""
        E = around / np.tan(self.value(limit)) + self.axis(limit)
        return E, np.zeros(E.shape[1])

    def measure(self, limit: Any, mass: float, f: Array, off: Array | float = 0.0) -> Array:
        """Return the angle over the greatest one; a ball of radius `off` seen from 0 adds asin(off / |f|)."""
        along, across = split_by_axis(f, self.axis(limit))
        size = np.maximum(np.hypot(along, across), 1e-300)
        angle = np.arctan2(across, -along) + np.arcsin(np.minimum(off / size, 1.0))
        return np.asarray(angle / self.value(limit))

    def scaled(self, value: Any, factor: float) -> Any:
        """Return the record with its angle multiplied by a factor."""
        return value.scaled(factor)

    def describe(self, limit: Any, ratio: float) -> str:
        """Return a sentence about a ratio."""
        angle, most = np.degrees([ratio * self.value(limit), self.value(limit)])
        return f"the {self.name.replace('_', ' ')} is tilted by {angle:.4g}°, more than its {most:.4g}°,"
