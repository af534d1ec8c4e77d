"""Positions along a path nearest to a tool, near a guess: Gauss–Newton steps, and a search at cusps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from optik.compiled import compiled
from optik.types import Array
from planners.certificate.bounds import Instants
from planners.certificate.progress import BEND, CHORD_TURN
from planners.paths._nearest import embed_poses
from planners.paths.base import Path

NEAREST_TURN = 1e-3
"""Metres per radian in the distance to the path: where the tool moves, its position decides."""
PATH_STILL = 1e-6
"""Fraction of the path's greatest rate below which it is at standstill: at such a cusp no position is nearest."""
NEAREST_ENOUGH = 3e-14
"""Convergence tolerance of the nearest position, as a fraction of the path."""
CUSP, CUSP_PLACES, CUSPS_AT_ONCE = 0.5, 65, 1024
"""Fraction of the path's greatest rate below which a position may be at a cusp; number of positions searched around it; and
number of instants searched at once, which bounds the memory."""
BACK_TIME = 1e-2
"""Time [s] that converts the backward speed along the path into a distance."""
NEAREST_STEPS = 20
"""Largest number of Newton steps; one or two are usual."""
TOOL_ON_PATH = 1e-9
"""Distance [m, rad] to the path below which a position needs no further search."""


class PathPositions(NamedTuple):
    """Path parameters (k,) of the tool at instants, its speed along the path, and the path's poses and twists there."""

    s: Array
    speed: Array
    poses: Array
    twist: Array


class Nearest:
    """Nearest positions along a path to a tool: Gauss–Newton steps, quartered if the distance increases.

    Any position gives a valid bound, and the nearest one the least. Near a cusp, where the path almost stops and turns back,
    several positions are equally near. Then a search around the guess selects the one where position and rotation agree and the
    tool moves forwards along the path.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._breaks = path, path.breaks
        bounds = path.known_bounds
        rate = bounds[:, :, 0].max(axis=0)
        self._still = float(PATH_STILL * np.hypot(rate[0], NEAREST_TURN * rate[1])) ** 2
        self._slow = CUSP * float(np.hypot(rate[0], CHORD_TURN * rate[1]))
        bend = np.hypot(bounds[:, 0, 1], CHORD_TURN * (bounds[:, 1, 1] - bounds[:, 1, 0] ** 2))  # ‖R''‖ ≤ |ω'| + |ω|²
        bend = np.where(
            bend > 1e-6 * self._slow, bend, np.inf
        )  # beside a straight piece, that of its neighbours counts
        least = np.minimum(bend, np.minimum(np.append(bend[1:], np.inf), np.append(np.inf, bend[:-1])))
        self._width = np.minimum(np.sqrt(8.0 * BEND / least), path.end)

    def places(self, instants: Instants, guess: Array) -> PathPositions:
        """Return the positions along the path that are nearest to a tool, near a guess."""
        guess = np.clip(guess, 0.0, self._path.end)
        found, cost = self._descend(instants.poses, instants.motion, guess)
        rate = np.hypot(
            np.linalg.norm(found.twist[:, :3], axis=1), CHORD_TURN * np.linalg.norm(found.twist[:, 3:], axis=1)
        )
        back = found.speed < -PATH_STILL * np.abs(found.speed).max()
        at = np.flatnonzero(((rate < self._slow) & (cost > TOOL_ON_PATH**2)) | back)
        for part in (at[i : i + CUSPS_AT_ONCE] for i in range(0, at.size, CUSPS_AT_ONCE)):
            tool, motion = instants.poses[part], instants.motion[part]
            better, _ = self._descend(tool, motion, self._likeliest(tool, motion, guess[part]))
            before = _misfit(tool, motion, found.poses[part], found.twist[part])
            nearer = _misfit(tool, motion, better.poses, better.twist) < before
            for old, x in zip(found, better, strict=True):
                old[part[nearer]] = x[nearer]
        return found

    def _likeliest(self, tool: Array, motion: Array, guess: Array) -> Array:
        """Return the best of the positions around a guess (k,)."""
        piece = np.clip(np.searchsorted(self._breaks, guess, side="right") - 1, 0, self._width.size - 1)
        around = self._width[piece][:, None] * np.linspace(-1.0, 1.0, CUSP_PLACES)
        s = np.clip(guess[:, None] + around, 0.0, self._path.end)
        poses, twist = self._path.frames(s.ravel())
        tool, motion = np.repeat(tool, CUSP_PLACES, axis=0), np.repeat(motion, CUSP_PLACES, axis=0)
        misfit = _misfit(tool, motion, poses, twist).reshape(s.shape)
        return np.asarray(s[np.arange(guess.size), misfit.argmin(axis=1)])

    def _descend(self, tool: Array, motion: Array, s: Array) -> tuple[PathPositions, Array]:
        """Return the positions after Newton steps from a guess (k,), and their squared distances."""
        path = self._path
        poses, twist = path.frames(s)
        cost, step, speed = np.empty((3, s.size))
        _step(tool, motion, poses, twist, self._still, cost, step, speed)
        for _ in range(NEAREST_STEPS):
            after = np.clip(s + step, 0.0, path.end)
            if np.abs(after - s).max(initial=0.0) <= NEAREST_ENOUGH * path.end:
                break
            new_poses, new_twist = path.frames(after)
            new_cost, new_step, new_speed = np.empty((3, s.size))
            _step(tool, motion, new_poses, new_twist, self._still, new_cost, new_step, new_speed)
            nearer = new_cost <= 1.000001 * cost  # with rounding error
            step = np.where(nearer, new_step, 0.25 * step)
            new = after, new_cost, new_speed, new_poses, new_twist
            if nearer.all():
                s, cost, speed, poses, twist = new
                continue
            s = s.copy()
            for old, x in zip((s, cost, speed, poses, twist), new, strict=True):
                old[nearer] = x[nearer]
        return PathPositions(s, speed, poses, twist), cost


def _misfit(tool: Array, motion: Array, poses: Array, twist: Array) -> Array:
    """Return squared distances (k,) of position, rotation, and backward motion in `BACK_TIME`."""
    weight = np.array([1.0, 1.0, 1.0, CHORD_TURN, CHORD_TURN, CHORD_TURN])
    along = np.einsum("ki,ki->k", twist * weight, motion[:, 0] * weight)
    size = np.linalg.norm(twist * weight, axis=1)
    back = np.minimum(along / np.maximum(size, 1e-300), 0.0) * BACK_TIME
    return np.asarray(((embed_poses(tool, CHORD_TURN) - embed_poses(poses, CHORD_TURN)) ** 2).sum(axis=1) + back**2)


@compiled
def _step(
    tool: Array, motion: Array, poses: Array, twist: Array, still: float, cost: Array, step: Array, speed: Array
) -> None:
    """Compute squared distances of tool poses from path poses, Newton steps along the path, and the tool's speed along it.

    A rotation of 1 rad counts as `NEAREST_TURN`.
    """
    e = np.empty(6)
    for k in range(tool.shape[0]):
        A, B = tool[k], poses[k]
        for i in range(3):
            e[i] = A[i, 3] - B[i, 3]
        # R_tool R_pathᵀ − its transpose, halved, as a vector
        e[3] = 0.5 * _skew(A, B, 2, 1)
        e[4] = 0.5 * _skew(A, B, 0, 2)
        e[5] = 0.5 * _skew(A, B, 1, 0)
        size, along, going, off = still, 0.0, 0.0, 0.0
        for i in range(6):
            weight = 1.0 if i < 3 else NEAREST_TURN * NEAREST_TURN
            w = twist[k, i]
            size += weight * w * w
            along += weight * w * e[i]
            going += weight * w * motion[k, 0, i]
            off += weight * e[i] * e[i]
        cost[k], step[k], speed[k] = off, along / size, going / size


@compiled
def _skew(A: Array, B: Array, i: int, j: int) -> float:
    """Return entry (i, j) minus entry (j, i) of A Bᵀ, of the rotations of two poses."""
    value = 0.0
    for m in range(3):
        value += A[i, m] * B[j, m] - A[j, m] * B[i, m]
    return value
