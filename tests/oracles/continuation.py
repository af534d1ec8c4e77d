"""Dense continuation of the joints along a path: whether any continuous motion inside the limits follows it to its end.

Where σ is the smallest singular value, the solution of a pose is unique within about σ/2 (Newton and Kantorovich, for arms
about a metre long). So every step is corrected by a small part of σ only, and is so short that σ, falling as it does, could
not come to 0 in it: none goes over to another branch. Where σ all but vanishes, the motion goes on only if the joints do so
smoothly: what the nodes before extrapolate to must be what Newton finds behind.
"""

from typing import Any, NamedTuple

import numpy as np

from tests.oracles.kinematics import chain
from tests.oracles.poses import vee

Array = Any

SHARE = 0.25
"""What a step may take from σ, and how much it may be corrected, as a share of σ."""
GENTLE = 0.01
"""How fast σ is taken to fall at least, per unit of joint motion."""
LONGEST = 0.03
"""…and at most this."""
ON_PATH = 1e-10
"""Error [m and rad] to which a configuration meets its pose."""
SINGULAR = 1e-4
"""Where σ is below, joints are followed only as far as they go on smoothly."""
LEAST = 1e-9
"""Shortest step, as a share of the path."""
SLACK = 1e-9
"""How far [rad or m] a joint may stand beyond its limit."""


class Continuation(NamedTuple):
    """How far a motion follows a path.

    ``why`` is empty where it comes to the end, else ``"limit"``, ``"singular"``, ``"jump"`` (the pose is met only by a
    leap of the joints) or ``"off"`` (it is not met). ``joint`` is the one at its limit, or −1. ``room`` is the least
    room to a limit on the way and ``sigma`` the least singular value, so that what hangs by a hair can be told apart.
    """

    why: str
    at: float
    joint: int
    room: float
    sigma: float
    s: Array
    q: Array

    @property
    def follows(self) -> bool:
        return not self.why


class _Arm:
    """Pose and Jacobian of one configuration, by the axes of its joints: fast enough to be asked ten thousand times."""

    def __init__(self, robot: Any) -> None:
        base, links, self._tool = chain(robot)
        self._before = [base @ links.before[0], *links.before[1:]]
        self._slides, self._theta, self._d, self._after = links.slides, links.theta, links.d, links.after
        self._inner = np.tile(np.eye(4), (len(links.d), 1, 1))
        self._plain = [bool((after == np.eye(4)).all()) for after in links.after]

    def __call__(self, q: Array) -> tuple[Array, Array]:
        A, slides = self._inner, self._slides
        angle = self._theta + np.where(slides, 0.0, q)
        c, s = np.cos(angle), np.sin(angle)
        A[:, 0, 0], A[:, 0, 1], A[:, 1, 0], A[:, 1, 1] = c, -s, s, c
        A[:, 2, 3] = self._d + np.where(slides, q, 0.0)
        T, frames = np.eye(4), np.empty((len(q), 4, 4))
        for i in range(len(q)):
            frames[i] = T = T @ self._before[i]
            T = T @ A[i]
            if not self._plain[i]:
                T = T @ self._after[i]
        T = T @ self._tool
        z, r = frames[:, :3, 2], T[:3, 3] - frames[:, :3, 3]
        moves = np.stack([z[:, 1] * r[:, 2] - z[:, 2] * r[:, 1], z[:, 2] * r[:, 0] - z[:, 0] * r[:, 2],
                          z[:, 0] * r[:, 1] - z[:, 1] * r[:, 0]], axis=1)  # fmt: skip
        J = np.concatenate([np.where(slides[:, None], z, moves), np.where(slides[:, None], 0.0, z)], axis=1)
        return T, J.T


class _Node(NamedTuple):
    s: float
    q: Array
    rate: Array
    sigma: float


def follow_densely(robot: Any, path: Any, q0: Array, *, most: int = 50_000) -> Continuation:
    """Follow a path from a configuration near its start.

    A redundant arm's free motion is chosen twice: none, and away from the limits; the one that comes farther counts, so
    that a refusal says nothing about other free motion.
    """
    ways = [_followed(robot, path, q0, gain, most) for gain in ((0.0, 1.0) if robot.n > 6 else (0.0,))]
    return max(ways, key=lambda way: (way.follows, way.at))


def _followed(robot: Any, path: Any, q0: Array, gain: float, most: int) -> Continuation:
    arm, limits = _Arm(robot), (np.asarray(robot.limits.lower), np.asarray(robot.limits.upper))
    breaks = np.append(path.breaks[path.breaks > 0.0], path.end)
    q, off = _corrected(arm, path.pose(0.0), np.array(q0, dtype=float))
    node = _node(arm, path, 0.0, q, gain, limits)
    nodes, room, sigma = [node], _room(q, limits).min(), node.sigma
    size, slope = SHARE * node.sigma, 1.0

    def end(why: str, joint: int = -1) -> Continuation:
        s, q = np.array([x.s for x in nodes]), np.array([x.q for x in nodes])
        return Continuation(why, float(s[-1]), joint, float(room), float(sigma), s, q)

    if off > ON_PATH:
        return end("off")
    if room < -SLACK:
        return end("limit", int(_room(q, limits).argmin()))
    while node.s < path.end:
        if len(nodes) > most:
            return end("singular")
        before = node
        size = min(size, LONGEST, SHARE * max(node.sigma, SINGULAR) / max(slope, GENTLE))
        h = size / max(float(np.abs(node.rate).max()), 1e-12)
        target = min(node.s + h, float(breaks[np.searchsorted(breaks, node.s, side="right")]))
        h = target - node.s
        guess = node.q + h * node.rate
        q, off = _corrected(arm, path.pose(target), guess.copy())
        corrected = float(np.abs(q - guess).max())
        if off > ON_PATH or corrected > min(0.2 * size, SHARE * max(node.sigma, SINGULAR)):
            size = 0.4 * min(size, h * float(np.abs(node.rate).max()))
            if h > LEAST * path.end:
                continue
            if node.sigma > 10.0 * SINGULAR:
                return end("off" if off > ON_PATH else "jump")
            node = _across(arm, path, nodes, gain, limits)
            if node is None:
                return end("singular")
        else:
            node = _node(arm, path, target, q, gain, limits)
            if node.sigma < SINGULAR:
                node = _across(arm, path, nodes, gain, limits)
                if node is None:
                    sigma = min(sigma, SINGULAR)
                    return end("singular")
            moved = float(np.abs(node.q - before.q).max())
            slope = max(0.3 * slope, abs(node.sigma - before.sigma) / max(moved, 1e-12))
            size *= 1.6 if corrected < 0.05 * size else 1.0
        left = _room(node.q, limits)
        # between two nodes a joint bulges by no more than an eighth of h times the change of its rate
        bulge = 0.125 * (node.s - before.s) * np.abs(node.rate - before.rate) if node.sigma > SINGULAR else 0.0
        room, sigma = min(room, float((left - bulge).min())), min(sigma, node.sigma)
        if left.min() < -SLACK:
            return end("limit", int(left.argmin()))
        nodes.append(node)
    return end("")


def _corrected(arm: _Arm, target: Array, q: Array) -> tuple[Array, float]:
    """Newton's steps onto a pose, the shortest ones; and the error that is left."""
    off, e = np.inf, np.empty(6)
    for _ in range(6):
        T, J = arm(q)
        e[:3], e[3:] = target[:3, 3] - T[:3, 3], vee(target[:3, :3] @ T[:3, :3].T)  # vanishes with the rotation vector
        before, off = off, float(np.abs(e).max())
        if off < 1e-13 or off > 0.9 * before:
            break
        q = q + np.linalg.lstsq(J, e, rcond=1e-12)[0]
    return q, off


def _node(arm: _Arm, path: Any, s: float, q: Array, gain: float, limits: Any) -> _Node:
    _, J = arm(q)
    U, sigma, Vt = np.linalg.svd(J)
    keep = sigma > 1e-9
    inverse = np.where(keep, 1.0 / np.where(keep, sigma, 1.0), 0.0)
    rate = Vt[: len(sigma)].T @ (inverse * (U[:, : len(sigma)].T @ path.twist(s)))
    if gain:
        middle, half = 0.5 * (limits[0] + limits[1]), 0.5 * (limits[1] - limits[0])
        x = np.clip((q - middle) / half, -0.999, 0.999)
        away = -x / (1.0 - x**2) / half
        N = Vt[len(sigma) :]
        free = N.T @ (N @ away)
        rate = rate + free * gain * np.linalg.norm(rate) / max(float(np.linalg.norm(away)), 1e-9)
    return _Node(s, q, rate, float(sigma[-1]))


def _room(q: Array, limits: Any) -> Array:
    return np.minimum(q - limits[0], limits[1] - q)


def _across(arm: _Arm, path: Any, nodes: list[_Node], gain: float, limits: Any) -> _Node | None:
    """The node behind a singular place where the joints go on smoothly, or None.

    The parabola through the last rates leads over it; Newton's answer there, and its rate, must be those it says.
    """
    last = nodes[-1]
    speed = max(float(np.abs(last.rate).max()), 1e-12)
    earlier = next((x for x in reversed(nodes[:-1]) if (last.s - x.s) * speed > 0.002), nodes[0])
    bend = (last.rate - earlier.rate) / (last.s - earlier.s) if last.s > earlier.s else np.zeros_like(last.rate)
    for jump in (1e-4, 3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1):
        h = min(jump / speed, path.end - last.s)
        guess = last.q + h * last.rate + 0.5 * h * h * bend
        q, off = _corrected(arm, path.pose(last.s + h), guess.copy())
        node = _node(arm, path, last.s + h, q, gain, limits)
        smooth = np.abs(q - guess).max() < 0.02 * jump
        if off < ON_PATH and smooth and (node.sigma >= SINGULAR or last.s + h >= path.end):
            wanted = last.rate + h * bend
            if last.s + h >= path.end or np.abs(node.rate - wanted).max() < 0.1 * speed:
                return node
    return None
