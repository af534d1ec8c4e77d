"""Curve of the joints through nodes, with continuous third derivatives: the path of a program between two stops."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from math import comb
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from optik import kinematics
from optik.arm.robot import Robot
from optik.check import finite_array
from optik.errors import InvalidInput
from optik.types import Array, Indices
from planners.paths.base import PiecewisePath, check_arm, check_recorded, check_robot, fields
from planners.paths.poses import rotation_derivative_norms
from planners.trajectory.curve import BINOMIAL, bells, evaluate

# ---------------- proved bounds on the derivatives of the tool along a curve of the joints


def tool_twists(robot: Robot, joints: Array) -> Array:
    """Return the twists and their first two derivatives (k, 3, 6) of joints and their first three derivatives (k, 4, n)."""
    twists = np.empty((len(joints), 3, 6))
    q, derivatives = np.ascontiguousarray(joints[:, 0]), np.ascontiguousarray(joints[:, 1:])
    kinematics.tool_motion_batch(robot.chain, q, derivatives, twists)
    return twists


def bound_tool_derivatives(robot: Robot, most: Array, width: Array, twists: Array) -> Array:
    """Return bounds (m, 2, 4) on the derivatives of position and rotation on pieces of a curve of the joints.

    The fourth is by reach alone. A lower one is at most its largest sample, plus half the distance of the samples times the
    bound above it.

    Shapes and units: most (m, 5, n), bounds on the joints and their derivatives; width (m,) of the pieces; twists
    (m c, 3, 6) at equal distances on each piece, both ends included [per unit of s].
    """
    bounds = reach_bounds(robot, most)
    norms = np.stack([
        np.linalg.norm(twists[:, :, :3], axis=2), rotation_derivative_norms(*np.swapaxes(twists[:, :, 3:], 0, 1))
    ], axis=1)  # fmt: skip
    samples = norms.reshape(len(width), -1, 2, 3)
    half = 0.5 * width[:, None] / (samples.shape[1] - 1)
    for k in (2, 1, 0):
        between = (1.0 + 1e-12) * samples[..., k].max(axis=1) + half * bounds[:, :, k + 1]
        bounds[:, :, k] = np.minimum(bounds[:, :, k], between)
    return bounds


def reach_bounds(robot: Robot, most: Array) -> Array:
    """Return bounds (m, 2, 4) for any motion with such rates: a link turns at most at the sum of those before it."""
    # A link vector t behind joint i gives |t_xy| Bᵢ + |t_z| Bᵢ₋₁, the Bell polynomials of the sums of |q⁽ᵐ⁾| of the
    # revolute joints up to i, since joint i does not move points on its own axis; a prismatic joint gives a product.
    if (follow := robot.linkage) is not None:
        robot, most = robot.axes, follow.spread_bounds(most)
    k = len(most)
    turning = np.where(robot.prismatic, 0.0, most)
    turning[:, 0] = 0.0
    sums = np.concatenate([np.zeros((k, 5, 1)), np.cumsum(turning, axis=2)], axis=2)
    turns = np.empty((robot.n + 1, k, 5))
    for i in range(robot.n + 1):
        bells(np.ascontiguousarray(sums[:, :, i]), turns[i])
    links = np.concatenate([robot.fixed, robot.tool[None]])[:, :3, 3]
    position = np.zeros((k, 5))
    for i, link in enumerate(links):
        position += float(np.hypot(link[0], link[1])) * turns[i] + abs(link[2]) * turns[max(i - 1, 0)]
        if i < robot.n and robot.prismatic[i]:
            for m in range(5):
                for j in range(m + 1):
                    position[:, m] += BINOMIAL[m, j] * most[:, j, i] * turns[i][:, m - j]
    return np.stack([position[:, 1:], turns[-1][:, 1:]], axis=1)


# ---------------- curve of the joints through nodes


HIGHER = np.linalg.inv(np.array([[1, 1, 1, 1], [4, 5, 6, 7], [12, 20, 30, 42], [24, 60, 120, 210]], float))
"""Coefficients of u⁴ … u⁷ of a septic, from what its value and its first three derivatives at u = 1 lack."""
TO_BERNSTEIN = np.array([[comb(i, j) / comb(7, j) for j in range(8)] for i in range(8)])
"""Bernstein coefficients of a septic from those of its powers of u: the hull of the coefficients contains the septic."""
PIECE_SAMPLES = 4
"""Intervals between samples of each piece for the bounds on derivatives."""


class JointCurve(PiecewisePath):
    """Curve of the joints through nodes with given derivatives, of degree 7 between two nodes.

    Its derivatives up to the third are continuous. Poses and twists are exact, by forward kinematics.

    Parameters
    ----------
    robot : Robot
        The arm.
    s : (k,) array
        Path parameters of the nodes, increasing from 0 [rad, or m]; any scale.
    q : (k, n) array
        Configurations there [rad, m].
    derivatives : (k, 3, n) array
        q', q'', q''' there.
    breaks : (m,) array, optional
        Path parameters between which bounds are given, both ends included; by default the nodes.
    owners : (m − 1, 2) array of int, optional
        For each piece between breaks the segment whose limits hold, and the other one in a rounded corner, else the same.

    Raises
    ------
    InvalidInput
        Arrays of other shapes, NaN, or path parameters that do not increase from 0.
    """

    name: ClassVar[str] = "joint_curve"
    unit = "rad"
    in_joints = True
    density = 1.5

    def __init__(
        self, robot: Robot, s: ArrayLike, q: ArrayLike, derivatives: ArrayLike, *, breaks: ArrayLike | None = None,
        owners: ArrayLike | None = None,
    ) -> None:  # fmt: skip
        check_robot(robot)
        k, n = np.shape(s)[0] if np.ndim(s) else 0, robot.n
        self.robot, self.s, self.q = robot, _read(s, (k,), "s"), _read(q, (k, n), "q")
        self.derivatives = _read(derivatives, (k, 3, n), "derivatives")
        self._breaks = self.s if breaks is None else _read(breaks, np.shape(breaks), "breaks")
        for name, x in (("s", self.s), ("breaks", self._breaks)):
            if x.ndim != 1 or x.size < 2 or x[0] != 0.0 or x[-1] != self.s[-1] or not (np.diff(x) > 0.0).all():
                raise InvalidInput(name, repr(x)[:60], "at least two numbers that increase from 0, up to the last s")
        pieces = self._breaks.size - 1
        given = np.zeros((pieces, 2)) if owners is None else _read(owners, (pieces, 2), "owners")
        self.owners: Indices = given.astype(np.int64)
        self.segments = int(self.owners.max()) + 1
        self._c = _septics(self.s, self.q, self.derivatives)

    @property
    def end(self) -> float:
        """Last path parameter [rad, or m]."""
        return float(self.s[-1])

    @property
    def breaks(self) -> Array:
        """Path parameters between which bounds are given."""
        return self._breaks

    @property
    def nodes(self) -> Array:
        """Path parameters of the nodes."""
        return self.s

    def coordinates(self, s: Array) -> Array:
        """Return the joints along the path.

        Parameters
        ----------
        s : (k,) array
            Path parameters [rad, or m].

        Returns
        -------
        (k, 4, n) array
            Configurations and their first three derivatives in s [rad, m].
        """
        return np.stack([self._at(s, order) for order in range(4)], axis=1)

    def _at(self, s: Array, order: int) -> Array:
        out = np.empty((s.size, self.robot.n))
        evaluate(self._c, self.s, np.ascontiguousarray(s), order, out)
        return out

    def configurations(self, robot: Robot, s: ArrayLike, order: int = 0) -> Array:
        """Return configurations at s, or their derivatives."""
        check_arm(robot, self.robot)
        return self._at(np.asarray(s, dtype=np.float64), order)

    def _evaluate(self, x: Array, order: int) -> Array:
        return (
            self.robot.fk(self._at(x, 0)) if order == 0 else tool_twists(self.robot, self.coordinates(x))[:, order - 1]
        )

    def least_on_pieces(self, values: Array) -> Array:
        """Return values of the pieces: those of their first owners."""
        return np.asarray(values[self.owners[:, 0]])

    @cached_property
    def _hulls(self) -> tuple[Array, Array, Array]:
        """The least and greatest configuration (m, n) between nodes, and bounds (m, 5, n) on |q⁽ᵏ⁾|, from Bernstein points."""
        h = np.diff(self.s)[:, None]
        points = np.einsum("ij,jkn->ikn", TO_BERNSTEIN, self._c[::-1] * h[None] ** np.arange(8)[:, None, None])
        least, greatest = points.min(axis=0), points.max(axis=0)
        most = np.empty((len(h), 5, self.robot.n))
        for k in range(5):
            most[:, k] = np.abs(points).max(axis=0)
            points = np.diff(points, axis=0) * (7 - k) / h[None]
        return least, greatest, most

    @property
    def hull(self) -> tuple[Array, Array]:
        """Least and greatest configurations (m, n) between two nodes [rad, m], as bounds."""
        return self._hulls[:2]

    @cached_property
    def node_bounds(self) -> Array:
        """Bounds (m, 2, 4) as `piece_bounds`, between two nodes."""
        h = np.diff(self.s)
        s = self.s[:-1, None] + h[:, None] * (np.arange(PIECE_SAMPLES + 1) / PIECE_SAMPLES)
        s[:, -1] = self.s[1:]
        return bound_tool_derivatives(
            self.robot, self._hulls[2], h, tool_twists(self.robot, self.coordinates(s.ravel()))
        )

    def piece_bounds(self) -> Array:
        """Return bounds (k − 1, 2, 4) on the derivatives of position and rotation between breaks."""
        return self._greatest_between_breaks(self.node_bounds)

    def joint_bounds(self) -> Array:
        """Return bounds (k − 1, 4, n) on the derivatives of the joints between breaks."""
        return self._greatest_between_breaks(self._hulls[2][:, 1:])

    def _greatest_between_breaks(self, values: Array) -> Array:
        """Return the greatest of values (m, ...) of the pieces between nodes, between any two breaks."""
        first = np.searchsorted(self.s, self._breaks[:-1], side="right") - 1
        last = np.searchsorted(self.s, self._breaks[1:], side="left")
        padded = np.concatenate([values, np.zeros_like(values[:1])])
        return np.asarray(np.maximum.reduceat(padded, np.stack([first, last], axis=1).ravel(), axis=0)[::2])

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for files, with the name and fingerprint of the arm."""
        return {
            "path": self.name, "robot": self.robot.name, "fingerprint": self.robot.fingerprint, "s": self.s.tolist(),
            "q": self.q.tolist(), "derivatives": self.derivatives.tolist(), "breaks": self._breaks.tolist(),
            "owners": self.owners.tolist(),
        }  # fmt: skip

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], robot: Robot | None = None) -> Self:
        """Return the path that `to_dict` wrote, for the arm that it belongs to."""
        names = "robot", "fingerprint", "s", "q", "derivatives", "breaks", "owners"
        name, fingerprint, s, q, derivatives, breaks, owners = fields(data, cls.name, *names)
        return cls(check_recorded(robot, name, fingerprint), s, q, derivatives, breaks=breaks, owners=owners)


def _read(value: Any, shape: tuple[int, ...], argument: str) -> Array:
    """Return an array of finite numbers of this shape."""
    return finite_array(value, argument, f"finite numbers of shape {shape}", shape)


def _septics(s: Array, q: Array, d: Array) -> Array:
    """Return the coefficients (8, k − 1, n) of the curve through nodes, highest power of s − s_k first."""
    h = np.diff(s)[:, None]
    p = [q[:-1], h * d[:-1, 0], h**2 / 2.0 * d[:-1, 1], h**3 / 6.0 * d[:-1, 2]]
    rest = np.stack([
        (q[1:] - q[:-1]) - (p[1] + p[2] + p[3]), h * d[1:, 0] - (p[1] + 2.0 * p[2] + 3.0 * p[3]),
        h**2 * d[1:, 1] - (2.0 * p[2] + 6.0 * p[3]), h**3 * d[1:, 2] - 6.0 * p[3],
    ])  # fmt: skip
    u = np.concatenate([np.stack(p), np.einsum("ij,jkn->ikn", HIGHER, rest)])
    return np.ascontiguousarray((u / h[None] ** np.arange(8)[:, None, None])[::-1])


METHOD = JointCurve
