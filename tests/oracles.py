"""Independent answers to compare with: slow, plain, written from the textbook, and never by calling optik."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from math import cos, factorial, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

Array = Any
REPOSITORY = Path(__file__).resolve().parent.parent


# ---------------------------------------------------------------- poses


def rot_x(angle: float) -> Array:
    return np.array([[1, 0, 0, 0], [0, cos(angle), -sin(angle), 0], [0, sin(angle), cos(angle), 0], [0, 0, 0, 1.0]])


def rot_z(angle: float) -> Array:
    return np.array([[cos(angle), -sin(angle), 0, 0], [sin(angle), cos(angle), 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def trans(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    return np.array([[1, 0, 0, x], [0, 1, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]])


def pose(rotvec: Iterable[float], position: Iterable[float]) -> Array:
    """Pose from a rotation vector and a position, SciPy's rotation."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(list(rotvec)).as_matrix()
    T[:3, 3] = list(position)
    return T


def error(T: Array, target: Array) -> Array:
    """(p_t − p, log(R_t Rᵀ)) in the base frame, with SciPy's logarithm."""
    turn = Rotation.from_matrix(target[:3, :3] @ T[:3, :3].T).as_rotvec()
    return np.concatenate([target[:3, 3] - T[:3, 3], turn])


def vee(W: Array) -> Array:
    """Vector of the skew part of W (..., 3, 3)."""
    return 0.5 * np.stack(
        [W[..., 2, 1] - W[..., 1, 2], W[..., 0, 2] - W[..., 2, 0], W[..., 1, 0] - W[..., 0, 1]], axis=-1
    )


# ---------------------------------------------------------------- arms from their tables


@dataclass(frozen=True)
class Row:
    """One row of a Denavit–Hartenberg table; metres and radians."""

    a: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    prismatic: bool = False


@dataclass(frozen=True)
class Arm:
    """A table, its convention, and what stands before and after it."""

    convention: str
    rows: tuple[Row, ...]
    base: Array = field(default_factory=lambda: np.eye(4))
    tool: Array = field(default_factory=lambda: np.eye(4))
    lower: Array = None
    upper: Array = None

    @property
    def n(self) -> int:
        return len(self.rows)


def table(name: str) -> Arm:
    """Read a robot's TOML file in optik/robots, by its own reader."""
    data = tomllib.loads((REPOSITORY / "optik" / "robots" / f"{name}.toml").read_text(encoding="utf-8"))
    rows = tuple(
        Row(
            a=j.get("a_mm", 0.0) / 1000.0,
            alpha=j.get("alpha_deg", 0.0) * pi / 180.0,
            d=j.get("d_mm", 0.0) / 1000.0,
            theta=j.get("theta_deg", 0.0) * pi / 180.0,
            prismatic=j.get("type", "revolute") == "prismatic",
        )
        for j in data["joints"]
    )
    unit = {"range_deg": pi / 180.0, "range_rad": 1.0, "range_mm": 0.001}
    ranges = np.array([next(np.array(j[k]) * unit[k] for k in unit if k in j) for j in data["joints"]])
    return Arm(data["convention"], rows, _placed(data, "base"), _placed(data, "tool"), ranges[:, 0], ranges[:, 1])


def _placed(data: Any, which: str) -> Array:
    """A base or tool pose of a robot's file, its rotation by SciPy: x, then y, then z, about axes that stand still."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", data.get(which, {}).get("rpy_deg", (0, 0, 0)), degrees=True).as_matrix()
    T[:3, 3] = np.array(data.get(which, {}).get("xyz_mm", (0, 0, 0))) / 1000.0
    return T


def link(arm: Arm, i: int, q: float) -> Array:
    """Link matrix i: Craig's modified convention, or the standard one, with the joint's own value in it."""
    r = arm.rows[i]
    theta, d = (r.theta, r.d + q) if r.prismatic else (r.theta + q, r.d)
    if arm.convention == "mdh":
        return rot_x(r.alpha) @ trans(x=r.a) @ rot_z(theta) @ trans(z=d)
    return rot_z(theta) @ trans(z=d) @ trans(x=r.a) @ rot_x(r.alpha)


def fk(arm: Arm, q: Sequence[float]) -> Array:
    """Tool pose: the product of the link matrices."""
    T = arm.base
    for i in range(arm.n):
        T = T @ link(arm, i, q[i])
    return T @ arm.tool


def jacobian(arm: Arm, q: Sequence[float]) -> Array:
    """Geometric Jacobian, rows (v, ω), by differentiating the product of link matrices factor by factor."""
    T = fk(arm, q)
    J = np.empty((6, arm.n))
    for i in range(arm.n):
        D = arm.base
        for j in range(arm.n):
            D = D @ (_link_derivative(arm, j, q[j]) if i == j else link(arm, j, q[j]))
        D = D @ arm.tool
        J[:3, i] = D[:3, 3]
        J[3:, i] = vee(D[:3, :3] @ T[:3, :3].T)
    return J


def _link_derivative(arm: Arm, i: int, q: float) -> Array:
    """dA_i/dq: sin and cos differentiated entry by entry."""
    r = arm.rows[i]
    theta, d = (r.theta, r.d + q) if r.prismatic else (r.theta + q, r.d)
    turn = np.array([[-sin(theta), -cos(theta), 0, 0], [cos(theta), -sin(theta), 0, 0], [0, 0, 0, 0], [0, 0, 0, 0.0]])
    slide = np.zeros((4, 4))
    slide[2, 3] = 1.0
    inner = rot_z(theta) @ slide if r.prismatic else turn @ trans(z=d)
    if arm.convention == "mdh":
        return rot_x(r.alpha) @ trans(x=r.a) @ inner
    return inner @ trans(x=r.a) @ rot_x(r.alpha)


def tool_motion(arm: Arm, q: Array, dq: Array) -> Array:
    """Twist of the tool and its first two derivatives (3, 6), from truncated power series of the link matrices.

    q(t) = q + dq_0 t + dq_1 t²/2 + dq_2 t³/6. A series is a list of its coefficients of t⁰ … t³. The tool's twist is
    (ṗ, vee(Ṙ Rᵀ)), itself a series; nothing of a recursion over links is in it.
    """
    T = [arm.base, *(np.zeros((4, 4)) for _ in range(3))]
    for i in range(arm.n):
        T = _times(T, _link_series(arm, i, [q[i], dq[0, i], dq[1, i] / 2.0, dq[2, i] / 6.0]))
    T = [c @ arm.tool for c in T]
    R = [c[:3, :3] for c in T]
    rate = _times([(k + 1) * R[k + 1] for k in range(3)], [c.T for c in R[:3]])
    twist = [np.concatenate([(k + 1) * T[k + 1][:3, 3], vee(rate[k])]) for k in range(3)]
    return np.array([factorial(k) * twist[k] for k in range(3)])


def _times(A: list[Array], B: list[Array]) -> list[Array]:
    """Cauchy product of two series of matrices."""
    return [sum(A[i] @ B[k - i] for i in range(k + 1)) for k in range(len(A))]


def _link_series(arm: Arm, i: int, x: list[float]) -> list[Array]:
    r = arm.rows[i]
    if r.prismatic:
        inner = [rot_z(r.theta) @ trans(z=r.d + x[0])]
        for k in (1, 2, 3):
            slide = np.zeros((4, 4))
            slide[2, 3] = x[k]
            inner.append(slide)  # Rot(z) leaves the z axis where it is
    else:
        s, c = [sin(r.theta + x[0])], [cos(r.theta + x[0])]
        for k in (1, 2, 3):  # ṡ = c ẋ and ċ = −s ẋ, coefficient by coefficient
            s.append(sum(j * x[j] * c[k - j] for j in range(1, k + 1)) / k)
            c.append(-sum(j * x[j] * s[k - j] for j in range(1, k + 1)) / k)
        inner = []
        for k in range(4):
            turn = np.array([[c[k], -s[k], 0, 0], [s[k], c[k], 0, 0], [0, 0, 0, 0], [0, 0, 0, 0.0]])
            if k == 0:
                turn[2, 2] = turn[3, 3] = 1.0
            inner.append(turn @ trans(z=r.d))
            if k > 0:
                inner[k][2:, :] = 0.0
    before = rot_x(r.alpha) @ trans(x=r.a) if arm.convention == "mdh" else np.eye(4)
    after = np.eye(4) if arm.convention == "mdh" else trans(x=r.a) @ rot_x(r.alpha)
    return [before @ c @ after for c in inner]


# ---------------------------------------------------------------- the paper's iteration


@dataclass(frozen=True)
class Iteration:
    """Every iterate of a damped least-squares run, and the error at each."""

    q: Array
    errors: Array
    solved: bool


def damped_least_squares(
    arm: Arm,
    target: Array,
    start: Array,
    *,
    damping: float,
    step: float = 1.0,
    iterations: int = 100,
    tolerance: float = 1e-6,
) -> Iteration:
    """Eq. 8–13 of the paper, eq. 9 corrected, clamped to the limits; a plain matrix inverse where the paper has one."""
    q = np.array(start, dtype=float)
    visited, errors = [q], [error(fk(arm, q), target)]
    while len(visited) <= iterations:
        e = errors[-1]
        if np.linalg.norm(e[:3]) <= tolerance and np.linalg.norm(e[3:]) <= tolerance:
            break
        J = jacobian(arm, q)
        dq = J.T @ np.linalg.inv(J @ J.T + damping**2 * np.eye(6)) @ e
        q = np.clip(q + step * dq, arm.lower, arm.upper)
        visited.append(q)
        errors.append(error(fk(arm, q), target))
    e = errors[-1]
    solved = bool(np.linalg.norm(e[:3]) <= tolerance and np.linalg.norm(e[3:]) <= tolerance)
    return Iteration(np.array(visited), np.array(errors), solved)


# ---------------------------------------------------------------- other libraries


def urdf(arm: Arm) -> str:
    """The table as URDF text. Each row is its moving joint and one fixed joint, so no angles need be combined."""
    lines = ['<robot name="table">', '  <link name="link0"/>']
    before = "link0"
    for i, r in enumerate(arm.rows):
        kind = "prismatic" if r.prismatic else "revolute"
        limit = '<axis xyz="0 0 1"/><limit lower="-7" upper="7" effort="1" velocity="1"/>'
        moving = (f"joint{i + 1}", kind, f"0 0 {r.d!r}", f"0 0 {r.theta!r}", limit)
        fixed = (f"link{i + 1}_offset", "fixed", f"{r.a!r} 0 0", f"{r.alpha!r} 0 0", "")
        for name, type_, xyz, rpy, rest in (fixed, moving) if arm.convention == "mdh" else (moving, fixed):
            after = f"after_{name}"
            lines.append(f'  <link name="{after}"/>')
            lines.append(
                f'  <joint name="{name}" type="{type_}"><parent link="{before}"/><child link="{after}"/>'
                f'<origin xyz="{xyz}" rpy="{rpy}"/>{rest}</joint>'
            )
            before = after
    lines += [
        '  <link name="tool"/>',
        f'  <joint name="flange" type="fixed"><parent link="{before}"/><child link="tool"/></joint>',
        "</robot>",
    ]
    return "\n".join(lines)


class Pinocchio:
    """Another library's kinematics of the same table."""

    def __init__(self, arm: Arm) -> None:
        import pinocchio

        self._pin = pinocchio
        self._model = pinocchio.buildModelFromXML(urdf(arm))
        self._data = self._model.createData()
        self._tool = self._model.getFrameId("tool")

    def fk(self, q: Array) -> Array:
        self._pin.framesForwardKinematics(self._model, self._data, q)
        return self._data.oMf[self._tool].homogeneous.copy()

    def jacobian(self, q: Array) -> Array:
        """Rows (v, ω) at the tool point along the base's axes."""
        axes = self._pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return self._pin.computeFrameJacobian(self._model, self._data, q, self._tool, axes).copy().reshape(6, -1)


# ---------------------------------------------------------------- random arms and configurations


def random_arm(rng: np.random.Generator, n: int = 6, *, prismatic: bool = False, convention: str = "mdh") -> Arm:
    """An arm with nothing special about it: no right angles, no zeros; one of its joints slides where asked."""
    rows = [Row(*rng.uniform([-0.5, -pi, -0.5, -pi], [0.5, pi, 0.5, pi]).tolist()) for _ in range(n)]
    if prismatic:
        i = int(rng.integers(n))
        rows[i] = replace(rows[i], prismatic=True)
    base = pose(rng.uniform(-1.5, 1.5, 3), rng.uniform(-1, 1, 3))
    tool = pose(rng.uniform(-1.5, 1.5, 3), rng.uniform(-0.3, 0.3, 3))
    return Arm(convention, tuple(rows), base, tool, np.full(n, -3.0), np.full(n, 3.0))


def configurations(arm: Arm, count: int, seed: int) -> Array:
    """Configurations (count, n) uniform inside the limits."""
    return np.random.default_rng(seed).uniform(arm.lower, arm.upper, (count, arm.n))


# ---------------------------------------------------------------- many at once, and parts of a pose


def fk_many(arm: Arm, q: Array) -> Array:
    """Tool poses (N, 4, 4) of configurations (N, n): Craig's and Spong's link matrices written out, NumPy's product."""
    T = np.broadcast_to(arm.base, (len(q), 4, 4))
    for i, r in enumerate(arm.rows):
        theta, d = (r.theta + 0.0 * q[:, i], r.d + q[:, i]) if r.prismatic else (r.theta + q[:, i], r.d + 0.0 * q[:, i])
        c, s, ca, sa, zero = np.cos(theta), np.sin(theta), cos(r.alpha), sin(r.alpha), 0.0 * theta
        if arm.convention == "mdh":
            rows = [
                [c, -s, zero, zero + r.a],
                [s * ca, c * ca, zero - sa, -sa * d],
                [s * sa, c * sa, zero + ca, ca * d],
            ]
        else:
            rows = [[c, -s * ca, s * sa, r.a * c], [s, c * ca, -c * sa, r.a * s], [zero, zero + sa, zero + ca, d]]
        rows.append([zero, zero, zero, zero + 1.0])
        T = T @ np.moveaxis(np.array(rows), 2, 0)
    return T @ arm.tool


def off_by(T: Array, targets: Array) -> tuple[Array, Array]:
    """Distances and angles (N,) between poses (N, 4, 4), SciPy's angle."""
    turn = Rotation.from_matrix(targets[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2)).magnitude()
    return np.linalg.norm(targets[:, :3, 3] - T[:, :3, 3], axis=1), turn


def task_off_by(T: Array, target: Array, mask: Sequence[int], frame: str) -> tuple[float, float]:
    """How far T is from what a mask asks of the target: length and angle of the components that count.

    A lone free rotation leaves the angle between the tool's axis and the target's (in the base's frame: between the
    base axis as carried along by R R_tᵀ and itself).
    """
    R, R_t = T[:3, :3], target[:3, :3]
    axes = R_t if frame == "target" else np.eye(3)
    p = axes.T @ (target[:3, 3] - T[:3, 3])
    free = [k for k in range(3) if not mask[3 + k]]
    if len(free) == 1:
        moved, wanted = (R, R_t) if frame == "target" else (R @ R_t.T, np.eye(3))
        a, b = moved[:, free[0]], wanted[:, free[0]]
        angle = float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
    else:
        turn = Rotation.from_matrix(R_t.T @ R if frame == "target" else R @ R_t.T).as_rotvec()
        angle = float(np.linalg.norm(turn * np.array(mask[3:])))
    return float(np.linalg.norm(p * np.array(mask[:3]))), angle
