"""Kinematics of any table or robot: products of link matrices, whose entries are power series where rates are asked for.

An arm is an `Arm` (its table) or a robot of the package (only its fixed transforms are read).
"""

from __future__ import annotations

from math import factorial
from typing import Any, NamedTuple

import numpy as np

from tests.oracles.arms import Arm
from tests.oracles.poses import error, rot_x, trans, vee

Array = Any


class Link(NamedTuple):
    """before · Rot(z, θ) · Trans(z, d) · after, where the joint's own value adds to θ, or to d where it slides."""

    before: Array
    theta: float
    d: float
    slides: bool
    after: Array


def chain(arm: Any) -> tuple[Array, list[Link], Array]:
    """What stands before all links, the links, and what stands after them."""
    if not isinstance(arm, Arm):
        links = [Link(T, 0.0, 0.0, bool(x), np.eye(4)) for T, x in zip(arm.fixed, arm.prismatic, strict=True)]
        return np.eye(4), links, arm.tool
    links = []
    for r in arm.rows:
        if arm.convention == "mdh":
            before, after = rot_x(r.alpha) @ trans(x=r.a), np.eye(4)
        else:
            before, after = np.eye(4), trans(x=r.a) @ rot_x(r.alpha)
        links.append(Link(before, r.theta, r.d, r.prismatic, after))
    return arm.base, links, arm.tool


# ---------------------------------------------------------------- power series: coefficients of t⁰, t¹ … first


def times(A: Array, B: Array) -> Array:
    """Cauchy product of two series of matrices (terms, ..., i, j), higher powers dropped."""
    return np.stack([sum(A[i] @ B[k - i] for i in range(k + 1)) for k in range(min(len(A), len(B)))])


def cos_sin(x: Array) -> tuple[Array, Array]:
    """Cosine and sine (terms, ...) of a series: c' = −s x', s' = c x', coefficient by coefficient."""
    c, s = [np.cos(x[0])], [np.sin(x[0])]
    for k in range(1, len(x)):
        c.append(-sum(j * x[j] * s[k - j] for j in range(1, k + 1)) / k)
        s.append(sum(j * x[j] * c[k - j] for j in range(1, k + 1)) / k)
    return np.stack(c), np.stack(s)


def link_series(one: Link, x: Array) -> Array:
    """Link matrix (terms, ..., 4, 4) where the joint's value is the series x (terms, ...)."""
    angle, height = np.zeros_like(x), np.zeros_like(x)
    (height if one.slides else angle)[:] = x
    angle[0] += one.theta
    height[0] += one.d
    c, s = cos_sin(angle)
    inner = np.zeros((*x.shape, 4, 4))
    inner[..., 0, 0], inner[..., 0, 1], inner[..., 1, 0], inner[..., 1, 1] = c, -s, s, c
    inner[..., 2, 3] = height
    inner[0, ..., 2, 2] = inner[0, ..., 3, 3] = 1.0
    return one.before @ inner @ one.after


def fk_series(arm: Any, q: Array) -> Array:
    """Tool pose as a series (terms, ..., 4, 4) of joints q (terms, ..., n)."""
    base, links, tool = chain(arm)
    T = np.zeros((*q.shape[:-1], 4, 4))
    T[0] = base
    for i, one in enumerate(links):
        T = times(T, link_series(one, q[..., i]))
    return T @ tool


# ---------------------------------------------------------------- poses, rates


def link(arm: Any, i: int, q: float) -> Array:
    """Link matrix i."""
    return link_series(chain(arm)[1][i], np.array([q]))[0]


def fk(arm: Any, q: Any) -> Array:
    """Tool poses (..., 4, 4) of configurations (..., n)."""
    return fk_series(arm, np.asarray(q, dtype=float)[None])[0]


def jacobian(arm: Any, q: Any) -> Array:
    """Geometric Jacobians (..., 6, n), rows (v, ω): the product of link matrices, one factor differentiated at a time."""
    q = np.asarray(q, dtype=float)
    base, links, tool = chain(arm)
    both = [link_series(one, np.stack([q[..., i], np.ones(q.shape[:-1])])) for i, one in enumerate(links)]
    before = [base]
    for A in both:
        before.append(before[-1] @ A[0])
    turned_back = np.swapaxes((before[-1] @ tool)[..., :3, :3], -1, -2)
    J = np.empty((*q.shape[:-1], 6, len(links)))
    after = tool
    for i in reversed(range(len(links))):
        D = before[i] @ both[i][1] @ after
        J[..., :3, i], J[..., 3:, i] = D[..., :3, 3], vee(D[..., :3, :3] @ turned_back)
        after = both[i][0] @ after
    return J


def smallest(arm: Any, q: Any) -> Array:
    """Smallest singular values (...) of the Jacobian."""
    return np.linalg.svd(jacobian(arm, q), compute_uv=False)[..., -1]


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
    for i, one in enumerate(links):
        if not one.slides:
            axis = (T @ one.before)[:-1, ..., :3, 2]
            for k in range(len(rate)):
                w[k] += sum(axis[m] * rate[k - m, ..., i, None] for m in range(k + 1))
        T = times(T, link_series(one, q[..., i]))
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
