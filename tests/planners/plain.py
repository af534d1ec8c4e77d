"""Oracles of the planners' tests: slow, plain, and written from the tables and the textbooks, not from the package."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray
from scipy.interpolate import PPoly
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation, Slerp

import optik
from optik.ik import make_solver
from planners import JointPath, Line, Trajectory, follow

Array = NDArray[np.float64]

START = np.deg2rad([20.0, -35.0, 40.0, 25.0, 50.0, -30.0])
MOVE = np.array([-0.12, 0.0, 0.20])
END_DEG = np.array([52.74, -34.83, 37.15, 57.57, 53.29, -29.81])

# ---------------------------------------------------------------- arms, from their published tables


def rot_x(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def rot_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def shift(x: float, z: float) -> Array:
    T = np.eye(4)
    T[0, 3], T[2, 3] = x, z
    return T


# modified tables, (α_{i−1} in degrees, a_{i−1}, d_i): the paper's Table 1, corrected; and an arm whose third joint slides
PAPER6R = [(90, 0, 0), (-90, 0, 0), (0, 0.472, 0), (-90, 0.055, 0.470), (90, 0, 0), (-90, 0, 0.261)]
SLIDING = [(0, 0, 0.4), (-90, 0, 0.15), (90, 0, 0), (0, 0, 0), (-90, 0, 0), (90, 0, 0.2)]
# standard table, (a_i, α_i in degrees, d_i)
UR5E = [(0, 90, 0.1625), (-0.425, 0, 0), (-0.3922, 0, 0), (0, 90, 0.1333), (0, -90, 0.0997), (0, 0, 0.0996)]


@cache
def chain(arm: str) -> tuple[tuple[Array, ...], Array, tuple[bool, ...]]:
    """What stands before each joint, what stands after the last, and which joints slide."""
    if arm == "ur5e":
        links = [shift(a, 0.0) @ rot_x(np.deg2rad(alpha)) for a, alpha, _ in UR5E]
        heights = [shift(0.0, d) for _, _, d in UR5E]
        before = tuple(b @ h for b, h in zip([np.eye(4), *links[:-1]], heights, strict=True))
        return before, links[-1], (False,) * 6
    table = {"paper6r": PAPER6R, "sliding": SLIDING}[arm]
    before = tuple(rot_x(np.deg2rad(alpha)) @ shift(a, 0.0) @ shift(0.0, d) for alpha, a, d in table)
    return before, np.eye(4), tuple(arm == "sliding" and i == 2 for i in range(6))


def fk(q: Array, arm: str = "paper6r") -> Array:
    """Tool pose, link by link."""
    before, after, slides = chain(arm)
    T = np.eye(4)
    for link, x, slide in zip(before, q, slides, strict=True):
        T = T @ link @ (shift(0.0, x) if slide else rot_z(x))
    return T @ after


def twist_to(T: Array, target: Array) -> Array:
    """(p_t − p, rotation vector of R_t Rᵀ), by SciPy."""
    turn = Rotation.from_matrix(target[:3, :3] @ T[:3, :3].T).as_rotvec()
    return np.concatenate([target[:3, 3] - T[:3, 3], turn])


def distance(T: Array, target: Array) -> tuple[float, float]:
    """Distance [m] and angle [rad] between two poses."""
    e = twist_to(T, target)
    return float(np.linalg.norm(e[:3])), float(np.linalg.norm(e[3:]))


def jacobian(q: Array, arm: str = "paper6r") -> Array:
    """Geometric Jacobian by central differences of sixth order."""
    J = np.zeros((6, q.size))
    h = 1e-3
    for i in range(q.size):
        for k, weight in ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60)):
            step = np.zeros(q.size)
            step[i] = k * h
            J[:, i] += weight / h * twist_to(fk(q - step, arm), fk(q + step, arm))
    return J


def newton(target: Array, guess: Array, arm: str = "paper6r") -> Array:
    """Configuration near the guess whose tool pose is the target, to rounding, whatever the joint limits."""
    q = np.array(guess, dtype=float)
    for _ in range(60):
        e = twist_to(fk(q, arm), target)
        if np.abs(e).max() < 3e-15:
            break
        J = np.stack([twist_to(fk(q, arm), fk(q + 1e-7 * axis, arm)) / 1e-7 for axis in np.eye(q.size)], axis=1)
        step = np.linalg.solve(J, e)
        q += step * min(1.0, 0.2 / np.abs(step).max())
        if np.abs(step).max() < 1e-16:
            break
    assert np.abs(twist_to(fk(q, arm), target)).max() < 1e-12, "the oracle's Newton did not converge"
    return q


# ---------------------------------------------------------------- truncated power series: exact derivatives along a path

TERMS = 4


def _times(a: Array, b: Array) -> Array:
    """Product of matrices of power series: (TERMS, n, k) by (TERMS, k, m), higher powers dropped."""
    out = np.zeros((TERMS, a.shape[1], b.shape[2]))
    for i in range(TERMS):
        for j in range(TERMS - i):
            out[i + j] += a[i] @ b[j]
    return out


def _cos_sin(x: Array) -> tuple[Array, Array]:
    """Cosine and sine of a power series (TERMS,), from c' = −s x', s' = c x'."""
    c, s = np.zeros(TERMS), np.zeros(TERMS)
    c[0], s[0] = np.cos(x[0]), np.sin(x[0])
    for k in range(1, TERMS):
        c[k] = -sum(j * x[j] * s[k - j] for j in range(1, k + 1)) / k
        s[k] = sum(j * x[j] * c[k - j] for j in range(1, k + 1)) / k
    return c, s


def _constant(T: Array) -> Array:
    out = np.zeros((TERMS, 4, 4))
    out[0] = T
    return out


def fk_series(q: Array, arm: str) -> Array:
    """Tool pose as a power series (TERMS, 4, 4) of q as power series (TERMS, 6)."""
    before, after, slides = chain(arm)
    T = _constant(np.eye(4))
    for i, link in enumerate(before):
        motion = _constant(np.eye(4))
        if slides[i]:
            motion[:, 2, 3] = q[:, i]
        else:
            c, s = _cos_sin(q[:, i])
            motion[:, 0, 0] = motion[:, 1, 1] = c
            motion[:, 1, 0], motion[:, 0, 1] = s, -s
        T = _times(_times(T, _constant(link)), motion)
    return _times(T, _constant(after))


def pose_series(start: Array, goal: Array, s: float, end: float) -> Array:
    """Pose at s + ε on the line from start to goal as a power series in ε."""
    e = twist_to(start, goal) / end
    w = np.array([[0, -e[5], e[4]], [e[5], 0, -e[3]], [-e[4], e[3], 0]])
    out = np.zeros((TERMS, 4, 4))
    out[0] = np.eye(4)
    out[0, :3, 3] = start[:3, 3] + s * e[:3]
    out[1, :3, 3] = e[:3]
    power = Rotation.from_rotvec(s * e[3:]).as_matrix() @ start[:3, :3]
    for k in range(TERMS):
        out[k, :3, :3] = power
        power = w @ power / (k + 1)
    return out


def derivatives_along(start: Array, goal: Array, s: float, end: float, guess: Array, arm: str = "paper6r") -> Array:
    """q, q', q'', q''' (4, 6) of the configuration that follows the line, by Newton on power series; no differences."""
    target = pose_series(start, goal, s, end)
    at = np.eye(4)
    at[:3] = target[0][:3]
    q = np.zeros((TERMS, 6))
    q[0] = newton(at, guess, arm)
    J = jacobian(q[0], arm)
    for _ in range(12):
        T = fk_series(q, arm)
        transposed = np.swapaxes(T, 1, 2).copy()
        R = _times(target[:, :3, :3], transposed[:, :3, :3])
        e = np.empty((TERMS, 6))
        e[:, :3] = (target - T)[:, :3, 3]
        e[:, 3] = 0.5 * (R[:, 2, 1] - R[:, 1, 2])  # vanishes together with the rotation vector
        e[:, 4] = 0.5 * (R[:, 0, 2] - R[:, 2, 0])
        e[:, 5] = 0.5 * (R[:, 1, 0] - R[:, 0, 1])
        q += np.linalg.solve(J, e.T).T
    return q * np.array([1.0, 1.0, 2.0, 6.0])[:, None]


# ---------------------------------------------------------------- lines


def line_pose(start: Array, goal: Array, u: float) -> Array:
    """Pose at the part u of a line: position straight, rotation by SciPy's Slerp."""
    T = np.eye(4)
    T[:3, 3] = (1 - u) * start[:3, 3] + u * goal[:3, 3]
    T[:3, :3] = Slerp([0, 1], Rotation.from_matrix([start[:3, :3], goal[:3, :3]]))(u).as_matrix()
    return T


def off_line(start: Array, goal: Array, T: Array) -> tuple[float, float]:
    """Distance from a pose to a line with a chord, and the angle to the line's rotation at the nearest place."""
    chord = goal[:3, 3] - start[:3, 3]
    u = float(np.clip((T[:3, 3] - start[:3, 3]) @ chord / (chord @ chord), 0.0, 1.0))
    return distance(T, line_pose(start, goal, u))


def moved(T: Array, move: Array, turn: Array | None = None) -> Array:
    """The pose moved and turned in the base frame."""
    out = T.copy()
    out[:3, 3] += move
    if turn is not None:
        out[:3, :3] = Rotation.from_rotvec(turn).as_matrix() @ out[:3, :3]
    return out


@cache
def paper6r() -> optik.Robot:
    return optik.load("paper6r")


@cache
def default_line() -> Line:
    start = paper6r().fk(START)
    return Line(start, moved(start, MOVE))


@cache
def default_joint_path(ik: str = "dls", samples: int = 151) -> JointPath:
    followed = follow(make_solver(paper6r(), ik), default_line(), START, samples=samples)
    assert followed.joint_path is not None and followed.stop is None
    return followed.joint_path


def followed_line(start: Array, goal: Array) -> JointPath:
    """The joint path of a line from the default start."""
    followed = follow(make_solver(paper6r(), "dls"), Line(start, goal), START)
    assert followed.joint_path is not None and followed.stop is None
    return followed.joint_path


@cache
def random_joint_paths(count: int, seed: int = 5) -> tuple[JointPath, ...]:
    """Regular lines of the paper's arm: drawn at random, kept where the arm stays well away from singularities."""
    robot, rng, kept = paper6r(), np.random.default_rng(seed), []
    solver = make_solver(robot, "dls")
    middle, half = 0.5 * (robot.limits.lower + robot.limits.upper), 0.5 * (robot.limits.upper - robot.limits.lower)
    while len(kept) < count:
        q = middle + 0.7 * half * rng.uniform(-1.0, 1.0, 6)
        start = robot.fk(q)
        move = rng.normal(size=3)
        turn = None if len(kept) % 2 else 0.5 * rng.normal(size=3)
        goal = moved(start, move / np.linalg.norm(move) * rng.uniform(0.03, 0.35), turn)
        joint_path = follow(solver, Line(start, goal), q)
        if joint_path and joint_path.joint_path.singular_values.min() > 0.03:
            kept.append(joint_path.joint_path)
    return tuple(kept)


def random_pose(rng: np.random.Generator) -> Array:
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    T[:3, 3] = rng.uniform(-1.0, 1.0, 3)
    return T


# ---------------------------------------------------------------- piecewise polynomials, by hand


def piece(trajectory: Trajectory, k: int, j: int, order: int = 0) -> Array:
    """Coefficients of one joint on one piece, lowest power first, in the time since the piece's first knot."""
    c = trajectory.coefficients[::-1, k, j]
    return polynomial.polyder(c, order) if order else c


def value(trajectory: Trajectory, t: float, order: int, k: int | None = None) -> Array:
    """Value of a derivative at t (n,), by the piece k, or by the piece that holds t."""
    x = trajectory.knots
    k = int(np.clip(np.searchsorted(x, t, side="right") - 1, 0, len(x) - 2)) if k is None else k
    return np.array([polynomial.polyval(t - x[k], piece(trajectory, k, j, order)) for j in range(trajectory.n)])


def brute_extrema(trajectory: Trajectory, order: int, points: int = 200_000) -> tuple[Array, Array, Array, Array]:
    """Least and greatest value of each joint and when: dense sampling piece by piece, refined by SciPy's bounded search."""
    x, n = trajectory.knots, trajectory.n
    per_piece = max(points // (len(x) - 1), 3)
    best = np.full((2, n), np.inf)
    when = np.zeros((2, n))
    for k in range(len(x) - 1):
        h = x[k + 1] - x[k]
        u = np.linspace(0.0, h, per_piece)
        for j in range(n):
            c = piece(trajectory, k, j, order)
            dense = polynomial.polyval(u, c)
            for row, sign in enumerate((1.0, -1.0)):
                i = int(np.argmin(sign * dense))
                found, at = sign * dense[i], u[i]
                low, high = u[max(i - 1, 0)], u[min(i + 1, per_piece - 1)]
                fine: Any = minimize_scalar(
                    lambda w, c=c, sign=sign: sign * polynomial.polyval(w, c),
                    bounds=(low, high), method="bounded", options={"xatol": 1e-14 * h},
                )  # fmt: skip
                if fine.fun < found:
                    found, at = fine.fun, fine.x
                if found < best[row, j]:
                    best[row, j], when[row, j] = found, x[k] + at
    return best[0], -best[1], when[0], when[1]


def random_trajectory(rng: np.random.Generator, pieces: int = 3, n: int = 2, smooth: int = 0) -> Trajectory:
    """Random pieces that meet in so many orders: 0 for none, 2 for position and velocity, 3 for acceleration too."""
    x = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 1.0, pieces))])
    c = rng.normal(size=(6, pieces, n)) * np.array([3.0, 2.0, 1.0, 1.0, 1.0, 1.0])[:, None, None]
    for k in range(1, pieces):
        h = x[k] - x[k - 1]
        for j in range(n):
            left = c[::-1, k - 1, j]
            for order in range(smooth):
                scale = (1.0, 1.0, 2.0)[order]
                c[5 - order, k, j] = polynomial.polyval(h, polynomial.polyder(left, order)) / scale
    return Trajectory(PPoly(c, x))


def difference(f: Callable[[Array], Array], t: Array, h: float) -> Array:
    """First derivative by central differences of eighth order."""
    weights = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
    return np.asarray(sum(w / h * (f(t + k * h) - f(t - k * h)) for k, w in weights))


def s_curve(end: float, jerk: float, ramp: float, hold: float = 0.0) -> PPoly:
    """s(t) from rest to rest in eight phases or fewer: jerk +, 0, −, 0, −, 0, +, scaled so that it ends at `end`."""
    phases = [(jerk, ramp), (0.0, hold), (-jerk, ramp), (0.0, 0.3), (-jerk, ramp), (0.0, hold), (jerk, ramp)]
    phases = [(j, h) for j, h in phases if h > 0.0]
    t, s, v, a, rows = [0.0], 0.0, 0.0, 0.0, []
    for j, h in phases:
        rows.append([j / 6, a / 2, v, s])
        s, v, a = s + v * h + a * h * h / 2 + j * h**3 / 6, v + a * h + j * h * h / 2, a + j * h
        t.append(t[-1] + h)
    return PPoly(np.array(rows).T * (end / s), np.array(t))


# ---------------------------------------------------------------- the best of uniform bounds


def double_s(length: float, v: Array, a: Array, j: Array) -> Array:
    """Duration from rest to rest under bounds on speed, acceleration and jerk (Biagiotti and Melchiorri, §3.4)."""
    ramp = np.where(v * j >= a * a, v / a + a / j, 2.0 * np.sqrt(v / j))
    cruising = length / v + ramp
    with np.errstate(invalid="ignore"):
        peak = 0.5 * a * (np.sqrt((a / j) ** 2 + 4.0 * length / a) - a / j)
        trapezoid = 2.0 * (peak / a + a / j)
    wedge = 4.0 * np.cbrt(length / (2.0 * j))
    short = np.where(peak >= a * a / j, trapezoid, wedge)
    return np.asarray(np.where(length >= v * ramp, cruising, short))


def best_uniform(joint_path: JointPath, velocity: float, acceleration: float, jerk: float) -> float:
    """Duration of the best motion whose bounds on ṡ, s̈, s⃛ are the same all along the path: a fine grid, no wit."""
    s = np.linspace(0.0, joint_path.end, 151)
    q1, q2, q3 = (np.abs(joint_path(s, order)).reshape(-1, 1) for order in (1, 2, 3))
    best = np.inf
    shares = np.geomspace(1e-3, 1.0, 200)
    fastest = min(velocity / q1.max(), np.sqrt(acceleration / q2.max()), np.cbrt(jerk / q3.max()))
    for v in fastest * np.geomspace(1e-3, 1.0, 150):
        a = shares * ((acceleration - q2 * v * v) / q1).min()
        j = ((jerk - 3.0 * q2 * v * a - q3 * v**3) / q1).min(axis=0)
        good = (a > 0.0) & (j > 0.0)
        if good.any():
            best = min(best, float(double_s(joint_path.end, np.full(good.sum(), v), a[good], j[good]).min()))
    return best
