"""Chains of two mechanisms that face each other: the tool of the second one relative to that of the first, and seams on it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

import optik
from optik import JointLimits, se3
from optik.arm.robot import Robot
from optik.types import Array
from planners import Arc, Line, Path, Spline

VELOCITY, ACCELERATION, JERK = 2.0, 10.0, 100.0


def joined(first: Robot, second: Robot) -> Robot:
    """The chain from the first tool to the second one; its joints are minus those of the first, in reverse, then the second's.

    The inverse of F₀ R(q₀) F₁ R(q₁) … tool is tool⁻¹ … R(−q₁) F₁⁻¹ R(−q₀) F₀⁻¹.
    """
    back = [se3.inverse(first.tool), *(se3.inverse(F) for F in first.fixed[:0:-1])]
    between = se3.inverse(first.fixed[0]) @ second.fixed[0]
    lower = np.append(-first.limits.upper[::-1], second.limits.lower)
    upper = np.append(-first.limits.lower[::-1], second.limits.upper)
    n = len(lower)
    limits = JointLimits(
        lower, upper, velocity=np.full(n, VELOCITY), acceleration=np.full(n, ACCELERATION), jerk=np.full(n, JERK)
    )
    fixed = np.array([*back, between, *second.fixed[1:]])
    prismatic = np.append(first.prismatic[::-1], second.prismatic)
    names = tuple(f"{side}{i}" for side, arm in (("a", first), ("b", second)) for i in range(1, arm.n + 1))
    return Robot(f"{first.name}-{second.name}", fixed, prismatic, second.tool, limits, names)


def mounted(name: str, gap: float) -> tuple[Robot, Robot]:
    """An arm that holds a piece, and one with a torch, which face each other."""
    piece, torch = np.eye(4), np.eye(4)
    piece[2, 3] = 0.1
    torch[:3, :3], torch[:3, 3] = Rotation.from_euler("y", 40, degrees=True).as_matrix(), (0.05, 0.0, 0.2)
    base = np.eye(4)
    base[:3, :3], base[0, 3] = Rotation.from_euler("z", np.pi).as_matrix(), gap
    arm = optik.load(name)
    return arm.with_tool(piece, add=True), arm.with_tool(torch, add=True).with_base(base)


def two_arms(name: str = "ur5e", gap: float = 0.8) -> Robot:
    """The chain of both arms, 12 joints."""
    return joined(*mounted(name, gap))


def draw_seam(rng: np.random.Generator, size: float) -> Path:
    """A seam on the piece, as a line, a circle or a wave around its axis; the torch looks onto it from outside and above."""
    kind, centre = rng.integers(3), size * np.append(rng.uniform(-0.1, 0.1, 2), rng.uniform(0.0, 0.1))
    begin, sense = rng.uniform(0.0, 2.0 * np.pi), rng.choice((-1.0, 1.0))
    up = np.array([0.0, 0.0, 1.0])
    if kind == 0:
        along = np.array([np.cos(begin), np.sin(begin), 0.0])
        ends = [centre + d * size * rng.uniform(0.1, 0.2) * along for d in (-1.0, 1.0)]
        normal = np.cross(up, along) + up
        return Line(*(_look(p, normal, along) for p in ends))
    radius, height = size * rng.uniform(0.06, 0.16), size * rng.uniform(0.02, 0.05)
    angles = begin + sense * np.linspace(0.0, 2.0 * np.pi * rng.uniform(0.7, 1.0), 25)
    out = np.stack([np.cos(angles), np.sin(angles), np.zeros(25)], axis=1)
    poses = []
    for x, angle in zip(out, angles, strict=True):
        place = centre + radius * x + (kind == 2) * height * np.cos(2.0 * angle) * up
        poses.append(_look(place, x + up, np.cross(up, x)))
    if kind == 1:
        return Arc.about(poses[0], centre, [0.0, 0.0, 1.0], float(angles[-1] - angles[0]), orientation="arc")
    return Spline(np.array(poses))


def _look(place: Array, normal: Array, along: Array) -> Array:
    z = -normal / np.linalg.norm(normal)
    x = along - (along @ z) * z
    x /= np.linalg.norm(x)
    return se3.pose(np.column_stack([x, np.cross(z, x), z]), place)
