"""Streams of a policy's chunks: our stream and simple rules, all judged alike by their set-points at 1 kHz."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Annotated, Any, NamedTuple

import numpy as np
import polars as pl
from scipy.interpolate import CubicSpline

from benchmarks.blocks.base import NUMBER, TEXT, WHOLE, Field, Kind, Session, Trials, fields_of
from benchmarks.blocks.block import Block, Column, Entry, largest, median
from benchmarks.blocks.timing.settings import LimitSet
from benchmarks.settings import LISTED, Count, RobotName, key, numbered, one_of
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.types import Array
from planners.limits import DERIVATIVES, MotionLimits
from planners.streams.chunk import Chunk
from planners.streams.stream import Setpoint, stream

RATE, LINEAR_RATE = 1000.0, 125.0
"""Set-points per second that are judged, and of the linear interpolation."""
LATEST, LEAST_PERIOD = 0.3, 0.05
"""Largest delay of a chunk, and the least time between two observations [s]."""
TOO_LATE = 0.01
"""Chunks that arrive so shortly before the end of a stream are left out [s]."""
NOISES, OUTLIERS = (0.0, 1e-3, 3e-3, 1e-2), 0.01
"""Standard deviations of the noise of a policy [rad, m], and the rate of targets with one wrong joint, by 0.02 to 0.1."""
RATIO_GRACE = 1.0 + 1e-6
"""Largest ratio to a limit that is rounding of the differences."""
AT_REST, MOVING, BRIEF = 1e-3, 0.05, 10
"""Speeds below which an arm rests and above which the policy moves [rad/s]; ticks of the shortest stop."""
LAGS = np.arange(-10, 80) / 100.0
"""Lags that are tried [s]: that of a rule has the least median distance."""
BEGIN = 1000
"""Ticks before the comparison with the policy."""

# ---------------------------------------------------------------- policies


class Policy(NamedTuple):
    """What a policy intends, where it begins, and its chunks with their times of arrival [s], the last at the end."""

    intend: Callable[[Array], Array]
    start: Array
    arrivals: list[float]
    chunks: list[Chunk]


def make_policy(robot: Robot, bounds: dict[str, Array], seconds: float, rng: np.random.Generator) -> Policy:
    """Return a random policy: strokes from rest within half of the limits; targets that come late, with noise and outliers."""
    low, high = np.maximum(robot.limits.lower, -2.5), np.minimum(robot.limits.upper, 2.5)
    free, (v, a) = np.isinf(robot.limits.upper), (bounds[name] for name in ("velocity", "acceleration"))
    omega = rng.uniform(0.8, 4.0, (2, robot.n))
    room = np.minimum(0.5 * v / omega, 0.5 * a / omega**2)
    size = (
        rng.choice([-1.0, 1.0], omega.shape) * rng.uniform(0.2, 0.5, omega.shape) * np.minimum(room, (high - low) / 8.0)
    )
    start = low + (high - low) * rng.uniform(0.4, 0.6, robot.n)

    def intend(t: Array) -> Array:
        t = np.maximum(np.asarray(t), 0.0)[..., None]
        turns = 0.2 * v * free * (t - 0.5 * np.sin(2.0 * t))  # a joint without limits goes on turning
        return np.asarray(start + turns + sum(size[k] * (1.0 - np.cos(omega[k] * t)) for k in (0, 1)))

    rate, noise, count = rng.uniform(10.0, 30.0), rng.choice(NOISES), int(rng.integers(16, 51))
    late, seen, arrivals, chunks = rng.uniform(0.0, LATEST), 0.0, [], []
    while seen < seconds:
        points = intend(seen + np.arange(count) / rate) + noise * rng.normal(size=(count, robot.n))
        wrong = rng.random(count) < OUTLIERS
        points[wrong, rng.integers(robot.n)] += rng.uniform(0.02, 0.1)
        points[:, free] = np.remainder(points[:, free] + np.pi, 2.0 * np.pi) - np.pi
        arrivals.append(seen + rng.uniform(0.5, 1.0) * late)
        chunks.append(Chunk(np.clip(points, robot.limits.lower, robot.limits.upper), rate, seen))
        seen = max(arrivals[-1], seen + LEAST_PERIOD)
    count = sum(arrival < seconds - TOO_LATE for arrival in arrivals)
    return Policy(intend, start, [*arrivals[:count], seconds], chunks[:count])


# ---------------------------------------------------------------- rules

Times = Array
"""Times of the set-points (k,) [s]."""


def follow_by_stream(align: str, policy: Policy, robot: Robot, limits: MotionLimits, t: Times) -> tuple[Array, int]:
    """Return the set-points of our stream with its other default settings, and the number of chunks that it joined."""
    waiting = list(zip(policy.arrivals, policy.chunks, strict=False))

    def source(now: Setpoint) -> Chunk | None:
        return waiting.pop(0)[1] if waiting and waiting[0][0] <= now.t + 1e-9 else None

    flow = stream(robot, source, policy.start, rate=RATE, limits=limits, align=align, realtime=False, silence=None)
    q = np.array([next(flow).q for _ in t])
    return q, flow.report().joined


def follow_by_rule(rule: str, policy: Policy, robot: Robot, limits: MotionLimits, t: Times) -> tuple[Array, int]:
    """Return the set-points of a rule, which always takes the newest chunk, and the number of chunks."""
    q, free = np.tile(policy.start, (len(t), 1)), np.isinf(robot.limits.upper)
    state = np.stack([policy.start, *np.zeros((2, robot.n))])
    for chunk, begin, end in zip(policy.chunks, policy.arrivals[:-1], policy.arrivals[1:], strict=True):
        here = np.flatnonzero((t >= begin - 1e-9) & (t < end - 1e-9))
        if here.size == 0:
            continue
        points = np.array(chunk.points)
        times = chunk.observed + np.arange(len(points)) / chunk.rate
        points[:, free] += 2.0 * np.pi * np.round((state[0] - points[0]) / (2.0 * np.pi))[free]
        points[:, free] = np.unwrap(points[:, free], axis=0)
        due = np.clip(np.searchsorted(times, t[here] + 1e-9) - 1, 0, len(times) - 1)
        if rule == HOLD:
            q[here] = points[due]
        elif rule == LINEAR:
            q[here] = np.stack([np.interp(t[here], times, joint) for joint in points.T], axis=1)
        elif rule == CHASE:
            for part in np.split(here, np.flatnonzero(np.diff(due)) + 1):
                q[part], state = _chase(state, points[due[part[0] - here[0]]], limits.bounds(robot.n), len(part))
        elif (later := times > t[here[0]] + 1e-3).any():
            knots, through = np.r_[t[here[0]], times[later]], np.vstack([state[:1], points[later]])
            curve = CubicSpline(knots, through, bc_type=((1, state[1]), (1, np.zeros(robot.n))))
            at = np.minimum(np.r_[t[here], end], knots[-1])
            q[here], state = curve(at)[:-1], np.stack([curve(at[-1], order) for order in range(3)])
        state[0] = q[here[-1]] if rule in (HOLD, LINEAR) else state[0]
        q[here[-1] + 1 :] = q[here[-1]]
    if rule == LINEAR:  # what a controller makes of set-points at a lower rate
        coarse = np.arange(0, len(t), round(RATE / LINEAR_RATE))
        q = np.stack([np.interp(t, t[coarse], joint) for joint in q[coarse].T], axis=1)
    return q, len(policy.chunks)


def _chase(state: Array, target: Array, bounds: dict[str, Array], ticks: int) -> tuple[Array, Array]:
    """Return set-points of Ruckig's motion to a target at rest, and the state (3, n) after them."""
    import ruckig

    n = len(target)
    problem, motion = ruckig.InputParameter(n), ruckig.Trajectory(n)
    problem.current_position, problem.current_velocity, problem.current_acceleration = state.tolist()
    problem.target_position = target.tolist()
    problem.max_velocity, problem.max_acceleration, problem.max_jerk = (bounds[name].tolist() for name in DERIVATIVES)
    ruckig.Ruckig(n).calculate(problem, motion)
    found = np.array([motion.at_time(k / RATE) for k in range(ticks + 1)])
    return found[:-1, 0], found[-1]


CLOCKED, NEAREST, CHASE, LINEAR, SPLINE, HOLD = (
    "stream", "stream, nearest", "Ruckig to each target", "linear, 125 Hz", "cubic spline to rest", "hard replacement",
)  # fmt: skip
"""Labels: our stream by the clock of the chunks, as the rules are, and as by default; and the rules."""

ALIGNED = {CLOCKED: "clock", NEAREST: "nearest"}
"""How our streams enter a chunk."""

# ---------------------------------------------------------------- the judge


def judge_setpoints(q: Array, policy: Policy, robot: Robot, bounds: dict[str, Array], t: Times) -> dict[str, Any]:
    """Return what set-points (k, n) do to an arm, from their differences, and how far they are from what is intended."""
    padded = np.vstack([np.repeat(q[:1], 3, axis=0), q])  # the arm rests before
    ratios = [
        (np.abs(np.diff(padded, order, axis=0)[3 - order :]) * RATE**order / bounds[name]).max(axis=1)
        for order, name in enumerate(DERIVATIVES, 1)
    ]
    inside = ((q >= robot.limits.lower - 1e-9) & (q <= robot.limits.upper + 1e-9)).all(axis=1)
    velocity, meant = (np.diff(x, axis=0) * RATE for x in (q, policy.intend(t)))
    rests = (np.abs(velocity).max(axis=1) < AT_REST) & (np.abs(meant).max(axis=1) > MOVING)
    edges = np.flatnonzero(np.diff(np.r_[False, rests[BEGIN:], False]))
    late = [np.abs(q[BEGIN::10] - policy.intend(t[BEGIN::10] - lag)).max(axis=1) for lag in LAGS]
    best = int(np.argmin([np.median(one) for one in late]))
    return dict(zip(DERIVATIVES, map(float, np.max(ratios, axis=1)), strict=True)) | {
        "outside": int(((np.max(ratios, axis=0) > RATIO_GRACE) | ~inside).sum()),
        "discontinuities": int((ratios[1] > 10.0).sum()), "stops": int((edges[1::2] - edges[::2] >= BRIEF).sum()),
        "reversals": max(0, _reversals(velocity[BEGIN:]) - _reversals(meant[BEGIN:])),
        "lag": float(LAGS[best]), "distance": float(np.median(late[best])),
    }  # fmt: skip


def _reversals(velocity: Array) -> int:
    """Return how often joints reverse; speeds at which the policy rests do not count."""
    signs = (np.sign(v[np.abs(v) > MOVING]) for v in velocity.T)
    return sum(int((s[1:] != s[:-1]).sum()) for s in signs)


# ---------------------------------------------------------------- the kind


def _total(name: str, words: str) -> Column:
    return Column(
        name, words, "", "" if name == "setpoints" else "less", "count", of=lambda rows: int(rows[name].sum())
    )


class ChunkBlock(Block):
    """Streams of random policies on one arm, by our stream and by simple rules."""

    noun = "block of chunks"
    measures = (
        _total("setpoints", "set-points"), _total("outside", "outside the limits"),
        _total("discontinuities", "discontinuities"),
        Column("joined", "chunks joined", "%", "more", of=lambda rows: 100.0 * rows["joined"].sum() / rows["chunks"].sum()),
        *(Column(name, f"largest {name} / limit", "", "less", of=largest(name)) for name in DERIVATIVES),
        _total("stops", "stops"), _total("reversals", "further reversals"),
        Column("lag", "median lag", "ms", "less", of=median("lag", 1e3)),
        Column("distance", "median distance", "mrad", "less", of=median("distance", 1e3)),
        Column("ms", "CPU time per chunk", "ms", "less", of=median("ms")),
    )  # fmt: skip

    robot: RobotName = key("The arm.")
    count: Count = key("Number of policies.")
    seconds: Annotated[float, numbered("seconds, at least 2", least=2.0)] = key("Duration of each stream.", 10.0, "s")
    limits: LimitSet = key("Limits of the joints, as in `[[timing]]`.")
    rules: Annotated[tuple[Annotated[str, one_of(NEAREST, CHASE, LINEAR, SPLINE, HOLD)], ...], LISTED] = key(
        "Rules that are compared with `stream`, and `stream, nearest`.", (NEAREST, CHASE, LINEAR, SPLINE, HOLD)
    )

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Our stream, then the rules."""
        return tuple(
            Entry(name, name, {}, role="ours" if name in ALIGNED else "law") for name in (CLOCKED, *self.rules)
        )


FIELDS = {
    "method": TEXT, "problem": WHOLE, **fields_of(WHOLE, "setpoints chunks"),
    "outside": Field(pl.Int64, None, "set-points outside the limits", "", "less"),
    **fields_of(WHOLE, "joined discontinuities stops reversals"), **fields_of(NUMBER, "velocity acceleration jerk lag"),
    "distance": Field(pl.Float64, None, "median distance", "mrad", "less", 1e3),
    "ms": Field(pl.Float64, None, "CPU time per chunk", "ms", "less", clock="cpu"),
}  # fmt: skip
"""Fields of the rows, one for each stream and rule."""


class _Chunks(Kind):
    """Streams of chunks."""

    name = "chunks"
    title = "Streams of a policy's chunks"
    block = ChunkBlock
    fields = FIELDS
    order = 66

    def prepare(self, block: ChunkBlock, seed: int) -> None:
        """Check the limits on the arm."""
        block.limits.of(load(block.robot))

    def count(self, block: ChunkBlock, session: Session) -> int:
        return block.count

    def solve(self, trials: Trials) -> Iterator[dict[str, Any]]:
        """Follow some policies by our stream and each rule."""
        block, robot = trials.block, load(trials.block.robot)
        limits = block.limits.of(robot)
        bounds, t = limits.bounds(robot.n), np.arange(round(block.seconds * RATE)) / RATE
        for number in trials.numbers:
            policy = make_policy(robot, bounds, block.seconds, np.random.default_rng((trials.seed, number)))
            for label in trials.labels:
                begin, follow = time.thread_time(), follow_by_stream if label in ALIGNED else follow_by_rule
                q, joined = follow(ALIGNED.get(label, label), policy, robot, limits, t)
                ms, chunks = 1e3 * (time.thread_time() - begin), len(policy.chunks)
                about = {"method": label, "problem": number, "setpoints": len(t), "chunks": chunks, "joined": joined}
                yield about | judge_setpoints(q, policy, robot, bounds, t) | {"ms": ms / chunks}


METHOD = _Chunks
