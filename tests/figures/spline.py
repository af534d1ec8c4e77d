"""Splines near random points: answers, deviations, derivatives, proved bounds, jerk beside the noise, plans and constant speed.

The oracle reads the plain data of a path: scipy's B-spline of its control points, and the rotation M(Q)/|Q|² by division of
power series. Deviations are those of a dense sample of it. The true speed is that of the tool by forward kinematics.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from functools import cache
from math import factorial
from typing import Any
from unittest.mock import patch

import numpy as np
import scipy

import optik
import planners
from optik.errors import InvalidInput
from optik.types import Array
from tests.figures.figure import Row, Value, main

SEED, COUNT, PLANS = 22, 600, 20
"""Every so many cases also plan along 5,000 noisy points."""
KINDS = (
    "two", "three", "walk", "loop", "straight", "curve", "noisy", "repeated", "waiting", "huge", "tiny", "zigzag", "reversal",
)  # fmt: skip
POINTS, NOISE, TURN_NOISE = 5000, 5e-5, 5e-4
"""Points of a plan, and standard deviations of their noise [m, rad]."""


def drawn(rng: np.random.Generator, kind: str) -> tuple[Array, float]:
    """Points (k, 3) of a kind [m], and the largest distance that noise moved them."""
    count = int(np.exp(rng.uniform(np.log(4), np.log(1500))))
    t = np.linspace(0.0, 1.0, count)
    waves = np.stack([np.sin(2.0 * np.pi * rng.uniform(0.1, 2.0) * t + k) for k in range(3)], axis=1)
    x = 0.2 * waves @ rng.normal(size=(3, 3)) + 0.3 * np.outer(t, rng.normal(size=3))
    noise = np.zeros((1, 3))
    if kind in ("two", "three"):
        x = rng.normal(size=({"two": 2, "three": 3}[kind], 3))
    elif kind == "walk":
        x = np.cumsum(rng.normal(size=(min(count, 200), 3)), axis=0) * 0.02
    elif kind == "loop":
        x = 0.2 * np.stack([np.cos(2.0 * np.pi * t), np.sin(2.0 * np.pi * t), 0.0 * t], axis=1)
        x[-1] = x[0]
    elif kind == "straight":
        x = np.outer(np.cumsum(rng.uniform(0.2, 1.0, count)), rng.normal(size=3)) + 1e-6 * rng.normal(size=x.shape)
    elif kind == "noisy":
        noise = 10.0 ** rng.uniform(-5.0, -4.0) * rng.normal(size=x.shape)
    elif kind == "repeated":
        x = np.repeat(x, rng.integers(1, 4, count), axis=0)
    elif kind == "waiting":
        x = np.concatenate([np.repeat(x[:1], 50, axis=0), x, np.repeat(x[-1:], 50, axis=0)])
        noise = 2e-5 * rng.normal(size=x.shape)
    elif kind in ("huge", "tiny"):
        x *= 10.0 ** (rng.uniform(1.0, 5.0) if kind == "huge" else rng.uniform(-4.0, -1.0))
    elif kind == "zigzag":
        x = np.stack([t, 0.02 * (np.arange(count) % 2), 0.0 * t], axis=1)
    elif kind == "reversal":
        x = np.concatenate([x, x[::-1]])
    return x + noise, float(np.linalg.norm(noise, axis=1).max(initial=0.0))


def turned(rng: np.random.Generator, points: Array) -> Array:
    """Poses at the points with a smooth turn over their length."""
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    u = way / way[-1]
    if len(points) < 4:
        u *= 0.5
    turns = (
        np.outer(u, rng.normal(size=3) * rng.uniform(0.0, 2.0)) + np.outer(np.sin(3.0 * u), rng.normal(size=3)) * 0.3
    )
    poses = np.tile(np.eye(4), (len(points), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = [optik.se3.exp_so3(w) for w in turns], points
    return poses


def derivatives(path: planners.Path, s: Array) -> tuple[Array, Array]:
    """Position (5, k, 3) and rotation (5, k, 3, 3) at s with four derivatives, from the plain data of a path."""
    data = path.to_dict()
    breaks = np.array(data["knots"])
    knots = np.concatenate([np.repeat(breaks[0], 5), breaks, np.repeat(breaks[-1], 5)])
    spline = scipy.interpolate.BSpline(knots, np.array(data["coefficients"]), 5)
    z = np.stack([spline(s, k) / factorial(k) if k else spline(s) for k in range(5)])
    q = z[..., 3:]

    def times(i: int, j: int) -> Array:
        return np.stack([sum(q[a, :, i] * q[k - a, :, j] for a in range(k + 1)) for k in range(5)])

    ww, xx, yy, zz = (times(i, i) for i in range(4))
    wx, wy, wz, xy, xz, yz = (2.0 * times(i, j) for i, j in ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)))
    M = np.array([
        [ww + xx - yy - zz, xy - wz, xz + wy], [xy + wz, ww - xx + yy - zz, yz - wx], [xz - wy, yz + wx, ww - xx - yy + zz]
    ])  # fmt: skip
    M, N = np.moveaxis(M, (0, 1), (2, 3)), (ww + xx + yy + zz)[..., None, None]
    R: list[Array] = []
    for k in range(5):
        R.append((M[k] - sum(N[j] * R[k - j] for j in range(1, k + 1))) / N[0])
    scale = np.array([float(factorial(k)) for k in range(5)])
    return z[..., :3] * scale[:, None, None], np.stack(R) * scale[:, None, None, None]


def excess(path: planners.Path, rng: np.random.Generator, count: int = 2000) -> tuple[float, float]:
    """Largest norm of a derivative over its bound at random places, and median over pieces of bound over largest norm."""
    breaks, bounds = path.breaks, path.piece_bounds()
    piece = np.concatenate([np.arange(breaks.size - 1), rng.integers(0, breaks.size - 1, count)])
    s = breaks[piece] + rng.random(piece.size) * np.diff(breaks)[piece]
    p, R = derivatives(path, s)
    norms = np.stack([np.linalg.norm(p, axis=2), np.linalg.norm(R, ord=2, axis=(2, 3))])[:, 1:].transpose(2, 0, 1)
    rounding = 1e-11 * np.abs(p).max() / np.diff(breaks)[piece, None, None] ** np.arange(1, 5)
    ratio = norms / (bounds[piece] + rounding + 1e-300)
    largest = np.zeros_like(bounds)
    np.maximum.at(largest, piece, norms)
    seen = largest[:, 0, 3] > 0.0
    return float(ratio.max()), float(np.median(bounds[seen, 0, 3] / largest[seen, 0, 3])) if seen.any() else 1.0


def distances(path: planners.Path, points: Array) -> Array:
    """Distances (k,) of points from the curve: of the nearest dense sample, and after steps of Newton's method from it."""
    dense = np.linspace(path.breaks[:-1], path.breaks[1:], 65).ravel()
    p = derivatives(path, dense)[0][0]
    found, near = scipy.spatial.cKDTree(p).query(points)
    s = dense[near]
    for _ in range(6):
        p, v, a = derivatives(path, s)[0][:3]
        found = np.minimum(found, np.linalg.norm(p - points, axis=1))
        slope = (v * v).sum(axis=1) + ((p - points) * a).sum(axis=1)
        s = np.clip(s - ((p - points) * v).sum(axis=1) / np.where(slope > 0.0, slope, np.inf), 0.0, path.end)
    return np.asarray(found)


def scan(rng: np.random.Generator, start: Array, count: int = POINTS) -> tuple[Array, Array]:
    """Poses (k, 4, 4) of a noisy scan from a start, and the true points (k, 3)."""
    t = np.linspace(0.0, 1.0, count)
    a, b, c, d = rng.uniform(0.02, 0.06), rng.uniform(4.0, 12.0), rng.uniform(0.01, 0.04), rng.uniform(3.0, 9.0)
    true = start[:3, 3] + np.stack([0.25 * t, a * np.sin(b * t), c * (np.cos(d * t) - 1.0)], axis=1)
    poses = np.tile(start, (count, 1, 1))
    poses[1:, :3, 3] = true[1:] + NOISE * rng.normal(size=(count - 1, 3))
    for i in range(1, count):
        turn = np.array([0.3 * t[i], 0.2 * np.sin(4.0 * t[i]), 0.0]) + TURN_NOISE * rng.normal(size=3)
        poses[i, :3, :3] = optik.se3.exp_so3(turn) @ start[:3, :3]
    return poses, true


@cache
def arm() -> tuple[Any, Array, planners.MotionLimits]:
    """UR5e with a start and limits, after a plan, so that no kernel is loaded while another is timed."""
    robot, q = optik.load("ur5e"), np.deg2rad([20.0, -80.0, 100.0, -110.0, -90.0, 30.0])
    limits = planners.MotionLimits(2.0, 10.0, 100.0)
    for law in ("optimal", "constant_speed"):
        planned(robot, scan(np.random.default_rng(1), robot.fk(q), 40)[0], q, limits, law)
    return robot, q, limits


def planned(robot: Any, poses: Array, q: Array, limits: planners.MotionLimits, law: str) -> tuple[planners.Plan, float]:
    """A plan along noisy poses, and its CPU time with the fit [s]."""
    begin = time.process_time()
    path = planners.Spline(poses, tolerance=(6.0 * NOISE, 8.0 * TURN_NOISE))
    plan = planners.plan(robot, path, q, limits=limits, timing=law)
    return plan, time.process_time() - begin


def uneven(plan: planners.Plan, robot: Any) -> float:
    """Largest relative change of the tool's true speed in the middle half of the distance, which no ramp reaches."""
    t = np.linspace(0.0, 1.0, 4001)[1:-1] * plan.trajectory.duration
    ahead, behind = (robot.fk(plan.trajectory(t + h))[:, :3, 3] for h in (1e-5, -1e-5))
    speed = np.linalg.norm(ahead - behind, axis=1)
    way = np.cumsum(speed) / speed.sum()
    middle = speed[(way > 0.25) & (way < 0.75)]
    return float(np.abs(middle / np.median(middle) - 1.0).max())


def plans(rng: np.random.Generator) -> Row:
    """Plans along 5,000 noisy points by two laws, and the jerk of the curve beside that of the true one."""
    robot, q, limits = arm()
    poses, true = scan(rng, robot.fk(q))
    row: Row = {}
    for law in ("optimal", "constant_speed"):
        plan, seconds = planned(robot, poses, q, limits, law)
        row |= {law: bool(plan), f"{law}_ms": 1e3 * seconds / POINTS}
    s = np.linspace(0.0, plan.path.end, 20_001)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(true, axis=0), axis=1)))
    jerk = scipy.interpolate.make_interp_spline(way[::10], true[::10], k=5)(np.linspace(0.05, 0.95, 2000) * way[-1], 3)
    third = np.linalg.norm(plan.path(s, 3)[:, :3], axis=1)
    row["jerk"] = float(third.max() / np.linalg.norm(jerk, axis=1).max())
    with patch.object(sys.modules[planners.Spline.__module__], "_smooth", lambda curve, *_: curve):
        rough = planners.Spline(poses, tolerance=(6.0 * NOISE, 8.0 * TURN_NOISE))
    row["saved"] = float(np.linalg.norm(rough(s / plan.path.end * rough.end, 3)[:, :3], axis=1).max() / third.max())
    return row | {
        "uneven": uneven(plan, robot),
        "off": float(distances(plan.path, true).max()),
        "pieces": plan.path.breaks.size,
    }


def measure(case: int) -> Row:
    """One set of points with a random tolerance."""
    rng = np.random.default_rng([SEED, case])
    kind = KINDS[case % len(KINDS)]
    points, noise = drawn(rng, kind)
    row: Row = {"kind": kind, "points": len(points)}
    exact = kind != "reversal" and noise == 0.0 and rng.random() < 0.4
    tolerance = (max(10.0 ** rng.uniform(-6.0, -3.0), 1.5 * noise), 10.0 ** rng.uniform(-4.0, -1.0))
    turns = kind not in ("waiting", "reversal") and rng.random() < 0.5
    given: Any = turned(rng, points) if turns else points
    begin = time.process_time()
    try:
        orientation = None if turns else np.eye(3)
        path = planners.Spline(given, orientation=orientation, tolerance=0 if exact else tolerance)
    except InvalidInput as error:
        row["refused"] = str(error)[:200]
    except Exception as error:
        row["error"] = f"{type(error).__name__}: {error}"[:200]
    else:
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        row["seconds"] = (time.process_time() - begin) / (0.1 + 3e-3 * len(points))
        row["far"] = float(distances(path, points).max() / (1e-9 * size + (0.0 if exact else tolerance[0])))
        row["told"] = float(path.deviation[0] / (1e-12 * size + (0.0 if exact else tolerance[0])))
        row["turned"] = float(path.deviation[1] / (1e-9 + (0.0 if exact else tolerance[1])))
        s = rng.random(200) * path.end
        p, R = derivatives(path, s)
        bounds, narrow = path.derivative_bounds()[0], np.diff(path.breaks).min()
        row["p"] = max(
            float(
                np.abs(path(s, k)[:, :3] - p[k]).max()
                / (1e-10 * bounds[k - 1] + 1e-12 * np.abs(p[0]).max() / narrow**k)
            )
            for k in (1, 2, 3)
        )
        row["R"] = float(np.abs(path(s)[:, :3, :3] - R[0]).max())
        row["excess"], row["loose"] = excess(path, rng)
        row["same"] = planners.paths.make_path(**path.to_dict()).to_dict() == path.to_dict()
    return row | (plans(rng) if case % PLANS == 0 else {})


def judge(rows: list[Row]) -> Sequence[Value]:
    """What was asked beside what was measured."""
    usual = [row for row in rows if row["kind"] != "reversal"]
    refused = [f"{row['case']} {row['kind']}" for row in usual if "refused" in row]
    errors = [row["error"] for row in rows if "error" in row]
    made, planned = [row for row in rows if "far" in row], [row for row in rows if "uneven" in row]
    saved = float(np.median([row["saved"] for row in planned]))
    same, certified = sum(row["same"] for row in made), sum(row["optimal"] + row["constant_speed"] for row in planned)

    def at_most(what: str, name: str, most: float, rows: list[Row], digits: int = 4) -> Value:
        found = max(row[name] for row in rows)
        return Value(what, f"at most {most:g}", f"{found:.{digits}g}", found <= most)

    return (
        Value(f"exceptions other than InvalidInput in {len(rows)} sets", "0", f"{len(errors)} {errors[:2]}", not errors),
        Value(f"refusals in {len(usual)} sets without reversals", "0", f"{len(refused)} {refused[:5]}", not refused),
        at_most("distance of a point from the curve over the tolerance (oracle)", "far", 1.0, made),
        at_most("`deviation` over the tolerance, distance", "told", 1.0, made),
        at_most("`deviation` over the tolerance, angle", "turned", 1.0, made),
        at_most("CPU time of a fit over 0.1 s + 3 ms a point", "seconds", 1.0, made),
        at_most("difference of derivatives from scipy's over 1e-10 of the largest and rounding", "p", 1.0, made),
        at_most("rotation against M(Q)/|Q|²", "R", 1e-14, made),
        at_most("norm of a derivative, k = 1…4, over its bound", "excess", 1.0, made, 8),
        at_most("bound on |p⁗| over the largest found, median of the pieces", "loose", 2.0, made),
        Value("plain data equal to the last bit", str(len(made)), str(same), same == len(made)),
        Value(
            f"certified plans of {len(planned)} scans of {POINTS} points, optimal and constant_speed",
            str(2 * len(planned)), str(certified), certified == 2 * len(planned),
        ),
        at_most("CPU time of fit and plan [ms a point], optimal", "optimal_ms", 3.0, planned),
        at_most("CPU time of fit and plan [ms a point], constant_speed", "constant_speed_ms", 3.0, planned),
        at_most("change of the true tool speed in the middle half of the distance, without ramps", "uneven", 1e-3, planned),
        at_most("largest |p‴| over that of the points without noise", "jerk", 1.5, planned),
        Value("largest |p‴| of fewest knots alone over that, median", "at least 1", f"{saved:.3g}", saved >= 1.0),
        at_most("distance of the points without noise from the curve [m]", "off", 6.0 * NOISE, planned),
    )  # fmt: skip


if __name__ == "__main__":
    main("spline", measure, COUNT, judge)
