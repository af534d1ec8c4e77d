"""Kinematics of any table or robot: products of link matrices, whose entries are power series where rates are asked for.

An arm is an `Arm` (its table) or a robot of the package (only its fixed transforms are read).
"""

from math import factorial
from typing import Any

import numpy as np

from tests.oracles.arms import Arm, Links
from tests.oracles.poses import error, vee

Array = Any


def chain(arm: Any) -> tuple[Array, Links, Array]:
    """What stands before all links, the links, and what stands after them."""
    if isinstance(arm, Arm):
        return arm.base, arm.links, arm.tool
    none = np.zeros(len(arm.fixed))
    return np.eye(4), Links(arm.fixed, none, none, arm.prismatic, np.tile(np.eye(4), (len(none), 1, 1))), arm.tool


# ---------------------------------------------------------------- power series: coefficients of t⁰, t¹ … first
def times(A: Array, B: Array) -> Array:
    """Cauchy product of two series of matrices (terms, ..., i, j), higher powers dropped."""
    if min(len(A), len(B)) == 1:
        return A[:1] @ B[:1]
    return np.stack([sum(A[i] @ B[k - i] for i in range(k + 1)) for k in range(min(len(A), len(B)))])


def cos_sin(x: Array) -> tuple[Array, Array]:
    """Cosine and sine (terms, ...) of a series: c' = −s x', s' = c x', coefficient by coefficient."""
    c, s = [np.cos(x[0])], [np.sin(x[0])]
    for k in range(1, len(x)):
        c.append(-sum(j * x[j] * s[k - j] for j in range(1, k + 1)) / k)
        s.append(sum(j * x[j] * c[k - j] for j in range(1, k + 1)) / k)
    return np.stack(c), np.stack(s)


def links_series(links: Links, x: Array) -> Array:
    """Link matrices (terms, ..., n, 4, 4) where the joints' values are the series x (terms, ..., n)."""
    angle, height = np.where(links.slides, 0.0, x), np.where(links.slides, x, 0.0)
    angle[0] += links.theta
    height[0] += links.d
    c, s = cos_sin(angle)
    inner = np.zeros((*x.shape, 4, 4))
    inner[..., 0, 0], inner[..., 0, 1], inner[..., 1, 0], inner[..., 1, 1] = c, -s, s, c
    inner[..., 2, 3] = height
    inner[0, ..., 2, 2] = inner[0, ..., 3, 3] = 1.0
    return links.before @ inner @ links.after


def fk_series(arm: Any, q: Array) -> Array:
    """Tool pose as a series (terms, ..., 4, 4) of joints q (terms, ..., n)."""
    base, links, tool = chain(arm)
    T = np.zeros((*q.shape[:-1], 4, 4))
    T[0] = base
    A = links_series(links, q)
    for i in range(q.shape[-1]):
        T = times(T, A[..., i, :, :])
    return T @ tool


# ---------------------------------------------------------------- poses, rates
def link(arm: Any, i: int, q: float) -> Array:
    """Link matrix i."""
    one = Links(*(of_all[i : i + 1] for of_all in chain(arm)[1]))
    return links_series(one, np.array([[q]]))[0, 0]


def fk(arm: Any, q: Any) -> Array:
    """Tool poses (..., 4, 4) of configurations (..., n)."""
    return fk_series(arm, np.asarray(q, dtype=float)[None])[0]


def jacobian(arm: Any, q: Any) -> Array:
    """Geometric Jacobians (..., 6, n), rows (v, ω): the product of link matrices, one factor differentiated at a time."""
    q = np.asarray(q, dtype=float)
    base, links, tool = chain(arm)
    n, A = q.shape[-1], np.moveaxis(links_series(links, np.stack([q, np.ones(q.shape)])), -3, 0)
    before, after = [base], [tool]
    for i in range(n):
        before.append(before[-1] @ A[i, 0])
        after.append(A[n - 1 - i, 0] @ after[-1])
    turned_back = np.swapaxes((before[-1] @ tool)[..., :3, :3], -1, -2)
    D = np.stack([before[i] @ A[i, 1] @ after[n - 1 - i] for i in range(n)], axis=-3)
    return np.swapaxes(
        np.concatenate([D[..., :3, 3], vee(D[..., :3, :3] @ turned_back[..., None, :, :])], axis=-1), -1, -2
    )


def smallest(arm: Any, q: Any) -> Array:
    """Smallest singular values (...) of the Jacobian."""
    return np.linalg.svd(jacobian(arm, q), compute_uv=False)[..., -1]


def speeds(arm: Any, motion: Any, t: Array) -> Array:
    """Speeds (k, 2) of the tool's point and of its turning at instants t (k,) of a motion of the joints."""
    twists = np.einsum("kij,kj->ki", jacobian(arm, motion(t)), motion(t, 1))
    return np.asarray(np.linalg.norm(twists.reshape(-1, 2, 3), axis=2))


def tool_motion(arm: Any, q: Array, dq: Array) -> Array:
    """Twist (ṗ, vee(Ṙ Rᵀ)) of the tool and its derivatives (k, ..., 6) from those of the joints, dq (k, ..., n)."""
    scale = np.array([factorial(i) for i in range(len(dq) + 1)])
    q = np.stack([q, *dq])
    T = fk_series(arm, q / scale.reshape(-1, *[1] * (q.ndim - 1)))
    rates = np.stack([k * T[k] for k in range(1, len(T))])
    turn = times(rates[..., :3, :3], np.swapaxes(T[:-1, ..., :3, :3], -1, -2))
    twist = np.concatenate([rates[..., :3, 3], vee(turn)], axis=-1)
    return twist * scale[:-1].reshape(-1, *[1] * (twist.ndim - 1))


def turning_series(arm: Any, q: Array) -> Array:
    """ω of the tool as a series (terms − 1, ..., 3) of joints q (terms, ..., n): their axes, carried by those before."""
    base, links, _ = chain(arm)
    T = np.zeros((*q.shape[:-1], 4, 4))
    T[0] = base
    rate = np.stack([k * q[k] for k in range(1, len(q))])
    w = np.zeros((*rate.shape[:-1], 3))
    A = links_series(links, q)
    for i in range(q.shape[-1]):
        if not links.slides[i]:
            axis = (T @ links.before[i])[:-1, ..., :3, 2]
            for k in range(len(rate)):
                w[k] += sum(axis[m] * rate[k - m, ..., i, None] for m in range(k + 1))
        T = times(T, A[..., i, :, :])
    return w


# ---------------------------------------------------------------- configurations that meet a pose
def newton(arm: Any, target: Array, guess: Array, steps: int = 60) -> tuple[Array, float]:
    """Configuration near a guess (n,) that meets a pose, limits aside, by damped Newton steps; and how far off it stays.

    The damping is the error's own square, so the last steps are Newton's.
    """
    q = np.array(guess, dtype=float)
    e = error(fk(arm, q), target)
    for _ in range(steps):
        if np.abs(e).max() < 3e-15:
            break
        J = jacobian(arm, q)
        step = J.T @ np.linalg.lstsq(J @ J.T + min(0.1, float(e @ e)) * np.eye(6), e, rcond=None)[0]
        step *= min(1.0, 0.2 / np.abs(step).max())
        after = error(fk(arm, q + step), target)
        if np.abs(step).max() < 1e-16 or (np.abs(e).max() < 1e-13 and np.abs(after).max() >= np.abs(e).max()):
            break
        q, e = q + step, after
    return q, float(np.abs(e).max())


def met(arm: Any, target: Array, guess: Array) -> Array:
    """Configuration (n,) near a guess whose tool pose is the target, to rounding, whatever the joint limits."""
    q, off = newton(arm, target, guess)
    assert off < 1e-12, "the oracle's Newton did not converge"
    return q


def cold(robot: Any, target: Array, rng: np.random.Generator, starts: int = 30) -> Array | None:
    """A configuration inside a robot's limits that meets a pose, from random starts; None where none is found."""
    low, high = np.maximum(robot.limits.lower, -7.0), np.minimum(robot.limits.upper, 7.0)
    for _ in range(starts):
        q, off = newton(robot, target, rng.uniform(low, high), 200)
        turn = 2.0 * np.pi * ~robot.prismatic
        q = q - turn * np.round((q - 0.5 * (low + high)) / (2.0 * np.pi))
        if off < 1e-9 and (q >= low - 1e-9).all() and (q <= high + 1e-9).all():
            return q
    return None
