"""Constraints of the time-optimal programme at grid points and in intervals, and a feasible initial guess; compiled."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from optik.arm.inertia import Load
from optik.compiled import compiled
from optik.dynamics import torques_batch
from optik.errors import NoSolution
from optik.kinematics import Chain
from optik.types import Array, Flags, Indices
from planners.certificate.bounds import instants
from planners.following.follow import JointPath
from planners.limits import MotionLimits, PathPoints, kind_of
from planners.limits.base import middle_and_half, sides
from planners.limits.kinds import torque_rate_rows, torque_rows
from planners.trajectory import Trajectory
from planners.trajectory.curve import evaluate_quintics, piece_at

# ---------------- time optimum under velocity and acceleration limits, and a smooth initial guess from it


@compiled
def _room(q1: Array, q2: Array, bound: tuple[Array, Array], x: float) -> tuple[float, float]:
    """Return the least and the greatest s̈ that the joints allow at x = ṡ²; least > greatest if none."""
    low, high = -1e300, 1e300
    for i in range(q1.shape[0]):
        down, up = bound[0][i], bound[1][i]
        if up == np.inf:
            continue
        if abs(q1[i]) * 1e12 < min(-down, up) and abs(q1[i]) < 1e-12:
            if not down <= q2[i] * x <= up:
                return 1.0, -1.0
            continue
        a, b = (down - q2[i] * x) / q1[i], (up - q2[i] * x) / q1[i]
        low, high = max(low, min(a, b)), min(high, max(a, b))
    return low, high


@compiled
def find_fastest(
    s: Array, q1: Array, q2: Array, speed: Array, bound: tuple[Array, Array], first: float, x: Array
) -> bool:
    """Compute the greatest x = ṡ² from a speed to rest, under bounds on q̈ and on ṡ; return whether the first speed is feasible.

    Shapes and units: s (k,) [m, rad], q1, q2 (k, n) [as q over powers of s], speed (k,) [m/s, rad/s], bound: the
    lower and the upper side (n,) [rad/s², m/s²], x (k,) [m²/s², rad²/s²].
    """
    k = s.shape[0]
    x[k - 1] = 0.0
    for i in range(k - 2, -1, -1):  # the greatest x from which x[i + 1] or less can be reached
        d = 2.0 * (s[i + 1] - s[i])
        top = min(speed[i] * speed[i], 1e300)
        low, high = 0.0, top
        for trial in range(60):
            y = high if trial == 0 else 0.5 * (low + high)
            least, most = _room(q1[i], q2[i], bound, y)
            good = least <= most and y + d * least <= x[i + 1] and y + d * most >= 0.0
            if good:
                low = y
                if trial == 0:
                    break
            else:
                high = y
            if high - low <= 1e-12 * high:
                break
        x[i] = low
    good = bool(first <= x[0] * 1.2)  # the grid is coarse: the programme itself will tell
    x[0] = min(first, x[0])
    for i in range(k - 1):
        d = 2.0 * (s[i + 1] - s[i])
        _, most = _room(q1[i], q2[i], bound, x[i])
        x[i + 1] = max(min(x[i + 1], x[i] + d * most), 0.0)
    return good


@compiled
def compute_times(s: Array, x: Array, t: Array) -> None:
    """Compute the times of grid points, with constant s̈ between them.

    Shapes and units: s (k,) [m, rad], x (k,) [m²/s², rad²/s²], t (k,) [s].
    """
    t[0] = 0.0
    for i in range(s.shape[0] - 1):
        v = sqrt(x[i]) + sqrt(x[i + 1])
        t[i + 1] = t[i] + 2.0 * (s[i + 1] - s[i]) / max(v, 1e-300)


@compiled
def filter_motion(t: Array, s: Array, v: Array, width: float, at: Array, out: Array) -> None:
    """Compute a motion smoothed by a box filter (moving mean in time), at given times.

    The motion is at rest before and after. Filtered ṡ(t) = (s(t) − s(t − w)) / w, so it ends where the motion ends.

    Shapes and units: t (k,) [s], s (k,) [m, rad], v (k,) [m/s, rad/s], width [s], at (m,) [s], out (3, m)
    [m, m/s, m/s², or rad].
    """
    whole = np.empty(t.shape[0])  # ∫ s dt to each knot, s quadratic between
    whole[0] = 0.0
    for i in range(t.shape[0] - 1):
        h = t[i + 1] - t[i]
        whole[i + 1] = whole[i] + h * s[i] + h * h * (2.0 * v[i] + v[i + 1]) / 6.0
    for m in range(at.shape[0]):
        area, place, speed = np.empty(2), np.empty(2), np.empty(2)
        for side in range(2):
            x = at[m] - side * width
            if x <= 0.0:
                area[side], place[side], speed[side] = s[0] * x, s[0], 0.0
            elif x >= t[-1]:
                area[side], place[side], speed[side] = whole[-1] + s[-1] * (x - t[-1]), s[-1], 0.0
            else:
                i = np.searchsorted(t, x, side="right") - 1
                u, h = x - t[i], t[i + 1] - t[i]
                a = (v[i + 1] - v[i]) / h
                area[side] = whole[i] + u * (s[i] + u * (0.5 * v[i] + u * a / 6.0))
                place[side] = s[i] + u * (v[i] + 0.5 * a * u)
                speed[side] = v[i] + a * u
        out[0, m] = (area[0] - area[1]) / width
        out[1, m] = (place[0] - place[1]) / width
        out[2, m] = (speed[0] - speed[1]) / width


# ---------------- rows of the time-optimal programme


def derivatives(joint_path: JointPath, s: Array) -> Array:
    """Return q, q', q'' and q''' at increasing path parameters, clamped to the path; at a node the right-hand values."""
    at = np.clip(s, joint_path.nodes[0], joint_path.nodes[-1])
    piece = piece_at(joint_path.nodes, at)
    return evaluate_quintics(joint_path.coefficients, piece, at - joint_path.nodes[piece])


def distances(joint_path: JointPath, s: Array, state: Array, tau: Array, ends: Array) -> Array:
    """Return the largest distances of the joints from q(s) in intervals, at quarters of their durations.

    The joints follow quintics in time through q, q̇ and q̈ at the grid points, from `ends` (3, K + 1, n) with q, q' and q'', and
    from ṡ and s̈ (K + 1, 2); s(t) is the quintic through the same states.
    """
    out = np.empty(tau.size)
    _distances(joint_path.nodes, joint_path.coefficients, s, state, tau, ends, out)
    return out


@compiled
def _piece(x: Array, s: float, k: int) -> int:
    """Return the piece that contains s, from piece k on."""
    while k < x.shape[0] - 2 and s >= x[k + 1]:
        k += 1
    return k


@compiled
def _between(h: float, move: float, v0: float, a0: float, v1: float, a1: float, u: float) -> float:
    """Return the displacement of the quintic in time at a fraction u of its duration h."""
    P, V, A = move - h * (v0 + 0.5 * h * a0), h * (v1 - v0 - h * a0), h * h * (a1 - a0)
    c3, c4, c5 = 10.0 * P - 4.0 * V + 0.5 * A, -15.0 * P + 7.0 * V - A, 6.0 * P - 3.0 * V + 0.5 * A
    return u * h * (v0 + 0.5 * u * h * a0) + u**3 * (c3 + u * (c4 + u * c5))


@compiled
def _distances(x: Array, c: Array, s: Array, state: Array, tau: Array, ends: Array, out: Array) -> None:
    k = 0
    for i in range(tau.shape[0]):
        h, v, a, w, b = tau[i], state[i, 0], state[i, 1], state[i + 1, 0], state[i + 1, 1]
        out[i] = 0.0
        k = _piece(x, s[i], k)
        for part in range(1, 4):
            place = min(max(s[i] + _between(h, s[i + 1] - s[i], v, a, w, b, 0.25 * part), x[0]), x[-1])
            p = _piece(x, place, 0 if place < x[k] else k)
            d = place - x[p]
            for j in range(c.shape[2]):
                q0, q1, r0, r1 = ends[0, i, j], ends[0, i + 1, j], ends[1, i, j], ends[1, i + 1, j]
                a0, a1 = r0 * a + ends[2, i, j] * v * v, r1 * b + ends[2, i + 1, j] * w * w
                q = q0 + _between(h, q1 - q0, r0 * v, a0, r1 * w, a1, 0.25 * part)
                on = c[5, p, j] + d * (
                    c[4, p, j] + d * (c[3, p, j] + d * (c[2, p, j] + d * (c[1, p, j] + d * c[0, p, j])))
                )
                out[i] = max(out[i], abs(q - on))


RESTING = 1e-9
"""Fraction of the largest q' below which a joint rests: its Coulomb friction may have either sign."""
BETWEEN_PLACES = np.array([0.21, 0.5, 0.79])
"""Fractions of an interval at which its torque is compared with the limits: between the grid points, which have rows."""
SWEPT_EVERY = 4
"""Spacing of the grid points of the sweeps that have computed rows; other rows are interpolated."""
NO_LIMIT = 1e30
"""Limit of a free value in the sweeps: finite, because they multiply it by durations that may be 0."""
NEAR = 0.8
"""Fraction of a torque limit at an end of an interval, above which torques inside it are computed."""
LEAST_ROOM = 1e-3
"""Least fraction of a torque limit above gravity with which a row is tightened: a smaller one leaves no room for a motion."""


class Rows(NamedTuple):
    """Rows of the limits at K + 1 grid points and in the K intervals between, each value limited to [−1, 1].

    ``node`` (K + 1, m, 4) coefficients of s̈, ṡ², ṡ and 1; ``edge`` (K, 2, e, 6) those of s⃛, ṡ s̈, ṡ³, ṡ, s̈ and ṡ² at both ends
    of each interval; ``lower`` and ``upper`` (K, m − n) the limits [N·m, N] of the torque without Coulomb friction in each
    interval, those of every load side by side, and ``static`` (K + 1, m − n) the torque of gravity. Accelerations and jerks
    come first, of ``joints`` joints. Between them and torques and rates are the rows of `MotionLimits.extra`: ``others`` has
    the names and numbers of those in ``node`` and in ``edge``.
    """

    node: Array
    edge: Array
    lower: Array
    upper: Array
    static: Array
    joints: int
    others: tuple[dict[str, int], dict[str, int]]

    @property
    def loaded(self) -> bool:
        """Whether torques or their rates, or further values of second or third order, are limited."""
        return bool(self.edge.shape[2] > self.joints or self.static.size or self.others[0])


def extra_rows(limits: MotionLimits, at: PathPoints, order: int) -> dict[str, Array]:
    """Return the rows of the further limits of one order, with all columns."""
    names = [name for name in limits.extra or () if kind_of(name).order == order]
    return {name: _pad(limits.rows(name, at), 4 if order == 2 else 6) for name in names}


def build_rows(
    joint_path: JointPath, limits: MotionLimits, s: Array, along: Array, around: tuple[Array, Array]
) -> Rows:
    """Return the rows at path parameters s (K + 1,)."""
    after, before = around
    at = PathPoints(joint_path, s, (*along[:3], np.vstack([after, before[-1:]])))
    first = PathPoints(joint_path, s[:-1], (*along[:3, :-1], after))
    last = PathPoints(joint_path, s[1:], (*along[:3, 1:], before))
    bounds = limits.bounds(joint_path.robot.n)
    node = [_pad(limits.rows("acceleration", at), 4)] if np.isfinite(bounds["acceleration"]).any() else []
    edge = [np.stack([_pad(limits.rows("jerk", side), 6) for side in (first, last)], axis=1)]
    second, *ends = extra_rows(limits, at, 2), extra_rows(limits, first, 3), extra_rows(limits, last, 3)
    node += second.values()
    edge += [np.stack([ends[0][name], ends[1][name]], axis=1) for name in ends[0]]
    others = {name: x.shape[1] for name, x in second.items()}, {name: x.shape[1] for name, x in ends[0].items()}
    lower = upper = np.empty((s.size - 1, 0))
    static = np.empty((s.size, 0))
    if np.isfinite(bounds["torque"]).any():
        row, lower, upper = _torques(at, bounds["torque"])
        static = row[..., 3]
        node.append(_center(row, lower, upper, at))
    if np.isfinite(bounds["torque_rate"]).any():
        edge.append(_rates(at, before, bounds["torque_rate"]))
    nodes = np.concatenate(node, axis=1) if node else np.empty((s.size, 0, 4))
    return Rows(nodes, np.concatenate(edge, axis=2), lower, upper, static, joint_path.robot.n, others)


def _pad(given: Array, columns: int) -> Array:
    """Return rows (k, m, ·) with zeros for the missing monomials."""
    wide = np.zeros((*given.shape[:2], columns))
    wide[..., : given.shape[2]] = given
    return wide


def _torques(at: PathPoints, bound: Array) -> tuple[Array, Array, Array]:
    """Return the rows of the torques of all loads (K + 1, m, 4), and their limits in the intervals less friction (K, m)."""
    loads, q1 = at.joint_path.robot.loads, at.q(1)
    low, high = sides(bound)
    back, forth = moves(q1)
    found, lower, upper = [], [], []
    for load in loads:
        found.append(torque_rows(at, load))
        lower.append(low - load.coulomb * np.where(back, -1.0, 1.0))  # it helps to brake a joint that only moves forth
        upper.append(high - load.coulomb * np.where(forth, 1.0, -1.0))
    return tuple(np.concatenate(x, axis=1) for x in (found, lower, upper))  # type: ignore[return-value]


def moves(q1: Array) -> tuple[Flags, Flags]:
    """Return whether a joint may move backwards, and forwards, in the intervals; both where it rests."""
    still = RESTING * np.abs(q1).max()
    back, forth = q1 < still, q1 > -still
    return back[:-1] | back[1:], forth[:-1] | forth[1:]


def _center(row: Array, lower: Array, upper: Array, at: PathPoints) -> Array:
    """Return the rows of torques (K + 1, m, 4), limited to [−1, 1] by the limits of both adjacent intervals."""
    low = np.maximum(np.vstack([lower[:1], lower]), np.vstack([lower, lower[-1:]]))
    high = np.minimum(np.vstack([upper[:1], upper]), np.vstack([upper, upper[-1:]]))
    middle, half = middle_and_half(low, high)
    centred = row.copy()
    centred[..., 3] -= middle
    centred /= np.where(half > 0.0, half, 1.0)[..., None]
    over = np.where(half > 0.0, np.abs(centred[..., 3]), np.inf)
    if over.max() >= 1.0:
        _refuse(over, row[..., 3], at)
    return centred


def _refuse(over: Array, static: Array, at: PathPoints) -> None:
    """Raise NoSolution for the position and the joint at which gravity and friction alone reach a torque limit."""
    k, i = np.unravel_index(int(over.argmax()), over.shape)
    robot, s = at.joint_path.robot, float(at.s[k])
    joint = robot.joint_names[i % robot.n]
    raise NoSolution(
        f"gravity needs a torque of {static[k, i]:.6g} at {joint} at s = {s:.6g}, with its Coulomb friction beyond the limit",
        s=s, joint=joint, advice="a lighter payload, another branch or path, or a higher torque limit",
    )  # fmt: skip


def _rates(at: PathPoints, before: Array, bound: Array) -> Array:
    """Return the rows of the torque rates of all loads at both ends of the intervals (K, 2, e, 6), with one-sided q'''."""
    last = at.q(3)[1:]
    jumps = np.flatnonzero((np.abs(before - last) > RESTING * np.abs(last).max()).any(axis=1))
    beside = PathPoints(at.joint_path, at.s[1:][jumps], (*(at.q(i)[1:][jumps] for i in range(3)), before[jumps]))
    out = []
    for load in at.joint_path.robot.loads:
        row = torque_rate_rows(at, load)
        ends = np.stack([row[:-1], row[1:]], axis=1)
        if jumps.size:
            ends[jumps, 1] = torque_rate_rows(beside, load)
        out.append(ends / bound[:, None])
    return np.concatenate(out, axis=2)


def dynamic_excess(value: Array, static: Array) -> Array:
    """Return the ratio of the dynamic part of a value to the range that its static part leaves of [−1, 1].

    A motion stretched by c has dynamic parts 1 / c² as large and the same static part.
    """
    with_sign = np.copysign(1.0, value) * static
    room = np.maximum(1.0 - with_sign, LEAST_ROOM)
    return np.asarray((np.abs(value) - with_sign) / room)


def torque_excess(
    joint_path: JointPath, limits: MotionLimits, rows: Rows, motion: Trajectory, values: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return the ratios of torques and torque rates to their limits inside the pieces of a motion.

    They are computed only in pieces with a value near its limit at an end, because values differ little inside a piece.
    """
    robot, bounds = joint_path.robot, limits.bounds(joint_path.robot.n)
    K, m, every = motion.knots.size - 1, rows.lower.shape[1], rows.node.shape[1]
    rated = bool(np.isfinite(bounds["torque_rate"]).any())
    if not m and not rated:
        return np.empty((K, 0)), np.empty((K, 0))
    loads = robot.loads
    torque, rate = np.zeros((K, m)), np.zeros((K, len(loads) * robot.n if rated else 0))
    place = np.abs(values[0][:, every - m : every]).max(axis=1, initial=0.0)
    near = np.maximum(np.maximum(place[:-1], place[1:]), np.abs(values[1][:-1]).max(axis=1, initial=0.0))
    some = np.flatnonzero(near > NEAR)
    if not some.size:
        return torque, rate
    states = states_within(motion, some, BETWEEN_PLACES)
    torques = np.concatenate([_torques_of(robot.chain, load, states) for load in loads], axis=2)
    torques = torques.reshape(BETWEEN_PLACES.size, some.size, 2, -1)
    if m:
        middle, half = middle_and_half(rows.lower[some], rows.upper[some])
        share = BETWEEN_PLACES[:, None, None]
        static = (1.0 - share) * rows.static[some] + share * rows.static[some + 1]
        torque[some] = dynamic_excess((torques[:, :, 0] - middle) / half, (static - middle) / half).max(axis=0)
    if rated:
        rate[some] = (np.abs(torques[:, :, 1]) / np.tile(bounds["torque_rate"], len(loads))).max(axis=0)
    return torque, rate


def states_within(motion: Trajectory, pieces: Indices, shares: Array) -> Array:
    """Return q, q̇, q̈ and q⃛ of a motion inside its pieces."""
    h = np.diff(motion.knots)[pieces]
    states = np.empty((shares.size * h.size, 6, motion.n))
    instants(motion.padded, np.tile(pieces, shares.size), (shares[:, None] * h).ravel(), states)
    return np.ascontiguousarray(states[:, :4])


def _torques_of(chain: Chain, load: Load, states: Array) -> Array:
    """Return the torques of a load without Coulomb friction, and their rates (k, 2, n), at states (k, 4, n)."""
    out = np.empty((states.shape[0], 2, states.shape[2]))
    torques_batch(chain, load.bodies, load.viscous, states, out)
    return out


def swept_rows(
    joint_path: JointPath, limits: MotionLimits, s: Array, along: Array
) -> tuple[Array, Array, Array, Array]:
    """Return torques and torque rates as additional joints, for the sweeps of the initial guess.

    A torque is a joint with q' = p and q'' = c over what gravity leaves of the limit, whose acceleration is limited to 1; a
    torque rate one with q' = p, 3 q'' = d and q''' = c' over the limit, whose jerk is limited to 1.
    """
    bounds = limits.bounds(joint_path.robot.n)
    none = np.empty((s.size, 0))
    if limits.torque is None and limits.torque_rate is None and not limits.extra:
        return none, none, none, np.empty((2, 0))
    first, second, third, most = [none], [none], [none], [np.empty((2, 0))]
    every = np.unique(np.append(np.arange(0, s.size, SWEPT_EVERY), s.size - 1))
    at = PathPoints(joint_path, s[every], tuple(np.ascontiguousarray(x[every]) for x in along))
    second_order = [*extra_rows(limits, at, 2).values()]
    if np.isfinite(bounds["torque"]).any():
        row, lower, upper = _torques(at, bounds["torque"])
        second_order.append(_center(row, lower, upper, at))
    for row in second_order:
        room = np.maximum(1.0 - np.abs(row[..., 3]), LEAST_ROOM)
        first, second, third = [*first, row[..., 0] / room], [*second, row[..., 1] / room], [*third, 0.0 * room]
        most.append(np.vstack([np.ones(room.shape[1]), np.full(room.shape[1], NO_LIMIT)]))
    third_order = [*extra_rows(limits, at, 3).values()]
    if np.isfinite(bounds["torque_rate"]).any():
        third_order += [torque_rate_rows(at, x) / bounds["torque_rate"][:, None] for x in joint_path.robot.loads]
    for row in third_order:
        first, second, third = [*first, row[..., 0]], [*second, row[..., 1] / 3.0], [*third, row[..., 2]]
        most.append(np.vstack([np.full(row.shape[1], NO_LIMIT), np.ones(row.shape[1])]))
    if len(most) == 1:
        return none, none, none, most[0]
    columns = (np.concatenate(x[1:], axis=1) for x in (first, second, third))
    before = np.minimum(np.arange(s.size) // SWEPT_EVERY, every.size - 2)
    share = ((s - s[every][before]) / (s[every][before + 1] - s[every][before]))[:, None]
    q1, q2, q3 = ((1.0 - share) * x[before] + share * x[before + 1] for x in columns)
    return q1, q2, q3, np.concatenate(most, axis=1)
