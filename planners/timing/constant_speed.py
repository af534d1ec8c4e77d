"""Constant tool speed between two ramps: the whole path but its ends at one speed, of the tool itself."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from optik.check import check_number
from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners.curve import composed, passed_at
from planners.fit import fitted, stretch
from planners.following.follow import JointPath
from planners.hermite import quintic, through
from planners.limits import ALL_LIMITS, MotionLimits, PathPoints
from planners.timing._sectional.ramps import (
    LEAST_FLAT,
    SHORTEST_PHASE,
    Ramp,
    Table,
    Worst,
    fine_enough,
    law_of,
    parts,
    phases_of,
    ratio_of,
    states,
    worst,
)
from planners.timing.base import TimeLaw, refit, speed_bound
from planners.timing.smooth import least_duration
from planners.trajectory import Trajectory

DISTANCE_CELLS, DISTANCE_PER_PIECE, STEEP = 1024, 16, 0.1
"""Least number of intervals of the path and of each of its pieces, and the largest change of ln |v| over one: the resolution of
the spline s(x)."""
RAMP_SHAPES = [(r, f) for r in (0.49, 0.35, 0.2, 0.1, 0.05) for f in (0.49, 0.35, 0.2, 0.1, 0.05)] + [
    (x, 1.0 - LEAST_FLAT - x) for x in (0.15, 0.25, 0.35, 0.65, 0.75, 0.85)
]
"""Shares of a ramp in which its acceleration rises and falls."""
CRAWL = 1e-3
"""Share of the speed that half of the path allows, below which a corner is not passed unless a speed is given: a motion
of a second would take a quarter of an hour."""
LIMIT_SHARES = (0.999, 0.99, 0.97, 0.9)
"""Shares of the limits that ramps are made for, in turn, until the exact extrema agree."""


class ConstantSpeed(TimeLaw):
    """One speed of the tool, |v|, from the end of one ramp to the start of the other; |ω| where the tool only turns.

    The ramps are limited in jerk and as short as the limits allow where they lie; they take at most the share `ramp` of
    the distance each. The speed is one number, kept exactly: nothing slows this motion as a whole.

    Parameters
    ----------
    speed : float, optional
        Tool speed [m/s; rad/s for a pure rotation]; by default the greatest that the limits allow everywhere, which the
        sharpest corner decides: no motion where a corner allows less than a thousandth of what half of the path does. A
        given speed may be arbitrarily low.
    ramp : float
        Largest share of the distance for each of the two ramps, up to a half.
    """

    name: ClassVar[str] = "constant_speed"
    keeps: ClassVar[tuple[str, ...]] = ALL_LIMITS

    def __init__(self, *, speed: float | None = None, ramp: float = 0.25) -> None:
        self.speed = None if speed is None else check_number(speed, "speed", "a tool speed above 0, or None", above=0.0)
        self.ramp = check_number(ramp, "ramp", "a share above 0, at most 0.5", above=0.0)
        if ramp > 0.5:
            raise InvalidInput("ramp", ramp, "a share above 0, at most 0.5")

    def run(self, joint_path: JointPath, limits: MotionLimits) -> Trajectory:
        """Time the joint path.

        Parameters
        ----------
        joint_path : JointPath
            q(s).
        limits : MotionLimits
            Limits of the motion.

        Returns
        -------
        Trajectory
            From rest to rest.

        Raises
        ------
        InvalidInput
            Velocity, acceleration or jerk limits are missing.
        NoSolution
            The speed breaks a limit (with s, the joint and the greatest speed that would work), none was given and a corner
            would slow the whole motion a thousandfold, the tool's point stands still somewhere on the path, or no limit bounds
            a joint that moves.
        """
        self.need(limits, joint_path.robot)
        duration = least_duration(joint_path, limits)
        distance = _distance(joint_path, limits)
        slow = _widest(distance.table, self.ramp, min(SHORTEST_PHASE, 0.01 * duration))
        built = _built(joint_path, limits, distance, slow)
        # widest ramps, scaled in time: the greatest speed of all, as a uniform scaling changes speeds alike
        fastest = fitted(joint_path.robot, built, limits, self.promises(limits), joint_path.path)
        factor = fastest.duration / built.duration
        greatest = slow[0].v1 / factor
        if self.speed is None:
            _check_corners(joint_path, limits, distance, slow, greatest)
        speed = greatest * (1.0 - 1e-9) if self.speed is None else self.speed
        if speed > greatest:
            found = _worst(joint_path, limits, distance, slow, speed)
            raise NoSolution(
                f"a tool speed of {speed:.6g} is {speed / greatest:.6g} times too fast: "
                f"the limit on {found.limit} is passed at s = {found.s:.6g}",
                s=found.s, joint=found.joint, advice=f"a speed of at most {_down(greatest):.6g}",
            )  # fmt: skip
        for room in LIMIT_SHARES:
            ramps = _shortest(distance.table, speed, self.ramp, room, min(SHORTEST_PHASE, 0.01 * duration))
            if ramps is not None:
                trajectory = _built(joint_path, limits, distance, ramps)
                if stretch(joint_path.robot, trajectory, limits, self.promises(limits), joint_path.path) <= 1.0:
                    return trajectory
        return fastest.slowed(greatest / speed)


def _check_corners(
    joint_path: JointPath, limits: MotionLimits, distance: _Distance, slow: list[Ramp], greatest: float
) -> None:
    """Raise NoSolution for a default speed that one corner makes a thousandth of what half of the path allows."""
    size = np.abs(distance.table.parts).max(axis=2)
    slowness = np.maximum(distance.table.slowness, np.maximum(np.sqrt(size[:, 1]), np.cbrt(size[:, 4])))
    if slowness.max() <= np.median(slowness) / CRAWL:
        return
    found = _worst(joint_path, limits, distance, slow, 2.0 * greatest)
    usual = 1.0 / float(np.median(slowness))
    raise NoSolution(
        f"a constant speed would be {greatest:.3g} at most: {found.joint or 'the tool'} is at its limit on {found.limit} at "
        f"s = {found.s:.6g}, a corner where half of the path allows {usual:.3g} and more",
        s=found.s, joint=found.joint,
        advice=f"a larger blend there, a law that slows down for it, or speed={_down(greatest):.6g} to have that",
    )  # fmt: skip


class _Distance(NamedTuple):
    """The path over the distance x that the tool travels (or turns): x at knots, s(x), and the limits on a grid of x."""

    s_of_x: PPoly
    table: Table
    uniform: bool


def _distance(joint_path: JointPath, limits: MotionLimits) -> _Distance:
    """Count the path in the tool's own distance; s itself is that, but for a factor, on straight lines.

    With c = dx/ds the tool's speed at ṡ = 1: s' = 1 / c, s'' = −c' / c³, s''' = (3 c'² − c c'') / c⁵.

    Returns
    -------
    _Distance
        The path over that distance.

    Raises
    ------
    NoSolution
        The tool's point stands still somewhere.
    """
    path, end = joint_path.path, joint_path.end
    s = path.places(DISTANCE_CELLS, DISTANCE_PER_PIECE)
    turning = path.turns_only or np.linalg.norm(path.twist(s)[:, :3], axis=1).max() <= 1e-9
    while True:
        c, c1, c2 = _rates(joint_path, s, turning)
        if c.min() <= 1e-6 * c.max():
            raise NoSolution(
                f"the tool's point stands still at s = {s[c.argmin()]:.6g}: no speed of it is constant along this path",
                s=float(s[c.argmin()]), advice="another law, with tool_speed= or rotation_speed= as limits",
            )  # fmt: skip
        steep = np.abs(np.diff(np.log(c))) > STEEP
        if not steep.any():
            break
        s = np.sort(np.append(s, 0.5 * (s[:-1] + s[1:])[steep]))
    uniform = bool(np.ptp(c) <= 1e-9 * c.max())
    if uniform:
        mean = float(c.mean())
        s_of_x = PPoly(np.array([[1.0 / mean], [0.0]]), np.array([0.0, end * mean]), extrapolate=True)
    else:
        nodes, weights = np.polynomial.legendre.leggauss(5)
        inner = (s[:-1, None] + np.diff(s)[:, None] * (0.5 + 0.5 * nodes)).ravel()
        pieces = (_rates(joint_path, inner, turning)[0].reshape(-1, 5) * weights).sum(axis=1) * 0.5 * np.diff(s)
        x = np.concatenate([[0.0], np.cumsum(pieces)])
        s_of_x = through(x, s[:, None], 1.0 / c[:, None], (-c1 / c**3)[:, None])
        s_of_x = PPoly(s_of_x.c[..., 0], x, extrapolate=True)
    grid = np.linspace(0.0, s_of_x.x[-1], fine_enough(path) + 1)
    at = np.clip(s_of_x(grid), 0.0, end)
    if not uniform:
        c, c1, c2 = _rates(joint_path, at, turning)
    rates = [y[:, None] for y in (1.0 / c, -c1 / c**3, (3.0 * c1**2 - c * c2) / c**5)]
    q, *derivatives = (joint_path(at, order) for order in range(4))
    along = parts(limits, PathPoints(joint_path, at, (q, *composed(derivatives, rates))))
    return _Distance(s_of_x, Table(grid, 1.0 / (speed_bound(joint_path, limits, at) * c), along), uniform)


def _rates(joint_path: JointPath, s: Array, turning: bool) -> tuple[Array, Array, Array]:
    """The tool's |v| or |ω| per unit of s (k,), and its first and second derivative in s."""
    part = slice(3, 6) if turning else slice(0, 3)
    v, v1, v2 = (joint_path.path.twist(s, order)[:, part] for order in (1, 2, 3))
    c = np.linalg.norm(v, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        c1 = (v * v1).sum(axis=1) / c
        return c, c1, ((v1 * v1).sum(axis=1) + (v * v2).sum(axis=1) - c1 * c1) / c


def _ramp(what: Table, last: bool, length: float, speed: float, shape: tuple[float, float]) -> Ramp:
    end = float(what.s[-1])
    return Ramp(end - length, speed, end, 0.0, *shape) if last else Ramp(0.0, 0.0, length, speed, *shape)


def _cruise(what: Table, start: float, end: float) -> float:
    """Factor by which a constant speed of 1 from start to end is too fast."""
    inside = (what.s >= start - what.s[1]) & (what.s <= end + what.s[1])
    size = np.abs(what.parts[inside]).max(axis=(0, 2))
    return float(max(what.slowness[inside].max(), np.sqrt(size[1]), np.cbrt(size[4])))


def _quick(ramp: Ramp, slow: float, shortest: float) -> bool:
    """Whether the acceleration rises or falls in less than the shortest time, after slowing the motion."""
    duration = 2.0 * (ramp.s1 - ramp.s0) / (ramp.v0 + ramp.v1)
    return min(ramp.rise, ramp.fall) * duration * slow < shortest


def _widest(what: Table, share: float, shortest: float) -> list[Ramp]:
    """Ramps to the greatest speed of all: of the lengths and shapes that need the least slowing from speed 1."""
    end = float(what.s[-1])
    chosen = []
    for last in (False, True):
        found = [
            (ratio_of(what, ramp), ramp)
            for length in end * share * np.array([1.0, 0.9, 0.75])
            for shape in RAMP_SHAPES
            for ramp in [_ramp(what, last, length, 1.0, shape)]
        ]
        found = [(ratio, ramp) for ratio, ramp in found if not _quick(ramp, ratio, shortest)] or found
        chosen.append(found)
    cruising = _cruise(what, share * end, (1.0 - share) * end)
    first, second = (min(found, key=lambda each: max(each[0], cruising)) for found in chosen)
    slow = max(first[0], second[0], _cruise(what, first[1].s1, second[1].s0))
    return [first[1]._replace(v1=1.0 / slow), second[1]._replace(v0=1.0 / slow)]


def _shortest(what: Table, speed: float, share: float, room: float, shortest: float) -> list[Ramp] | None:
    """The shortest ramps to a speed that keep that share of the limits; None where the longest ones do not."""
    end, out = float(what.s[-1]), []
    for last in (False, True):
        best: Ramp | None = None
        for shape in RAMP_SHAPES:
            low, high = 0.0, share * end if best is None else (best.s1 - best.s0) * (1.0 - 1e-4)
            if not _good(what, _ramp(what, last, high, speed, shape), room, shortest):
                continue
            for _ in range(12):
                middle = 0.5 * (low + high)
                if _good(what, _ramp(what, last, middle, speed, shape), room, shortest):
                    high = middle
                else:
                    low = middle
            best = _ramp(what, last, high, speed, shape)
        if best is None:
            return None
        out.append(best)
    return out if _cruise(what, out[0].s1, out[1].s0) * speed <= 1.0 + 1e-3 else None


def _good(what: Table, ramp: Ramp, room: float, shortest: float) -> bool:
    return not _quick(ramp, 1.0, shortest) and ratio_of(what, ramp) <= room


def _law(distance: _Distance, ramps: list[Ramp]) -> PPoly:
    """s(t): ramp, constant speed, ramp of the travelled distance, taken to s."""
    first, second = ramps
    chain = [first, second]
    if second.s0 > first.s1:
        chain.insert(1, Ramp(first.s1, first.v1, second.s0, second.v0, 0.49, 0.49))
    x_law = law_of(chain, [phases_of(ramp) for ramp in chain])
    if distance.uniform:
        return PPoly(x_law.c * distance.s_of_x.c[0, 0], x_law.x, extrapolate=True)
    low = passed_at(x_law, distance.s_of_x.x[1:-1:4], float(x_law.x[-1]))
    apart = 1e-3 * x_law.x[-1]
    low = low[np.abs(low[:, None] - x_law.x).min(axis=1) > apart]
    t = np.sort(np.concatenate([x_law.x, low]))
    x, v, a = (x_law(t, order) for order in (0, 1, 2))
    s, *derivatives = (distance.s_of_x(x, order) for order in (0, 1, 2))
    state = tuple(y[:, None] for y in (s, *composed(derivatives, (v, a))))
    law = quintic(t, tuple(y[:-1] for y in state), tuple(y[1:] for y in state))
    return PPoly(law.c[..., 0], t, extrapolate=True)


def _built(joint_path: JointPath, limits: MotionLimits, distance: _Distance, ramps: list[Ramp]) -> Trajectory:
    return refit(joint_path, _law(distance, ramps), limits.arrays(joint_path.robot.n)["jerk"])


def _worst(joint_path: JointPath, limits: MotionLimits, distance: _Distance, ramps: list[Ramp], speed: float) -> Worst:
    """Where the motion with the widest ramps would break a limit at this speed."""
    first, second = ramps
    return worst(
        joint_path, limits, *states(_law(distance, [first._replace(v1=speed), second._replace(v0=speed)]), 200)
    )


def _down(x: float) -> float:
    """Round down to six digits."""
    unit = 10.0 ** (np.floor(np.log10(x)) - 5.0)
    return float(np.floor(x / unit * (1.0 - 1e-9)) * unit)


METHOD = ConstantSpeed
