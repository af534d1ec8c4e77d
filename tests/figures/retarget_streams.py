"""Streams of chunks with latency and noise, jogging up to the ends of the ranges, and chunks under torque limits.

The kinds of cases alternate. Every motion that a stream joins is judged by `tests/figures/chunks.py`, and every set-point is
compared with the motion that should run. Torques are Pinocchio's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import planners
from optik.types import Array
from planners import MotionLimits
from planners.streams import Chunk, JogVelocity, RetargetStatus
from tests.figures import chunks
from tests.figures.chunks import Box, evaluate
from tests.figures.figure import Row, Value, main
from tests.figures.retarget import call, judge_motion, times
from tests.oracles.pinocchio import PinocchioDynamics

SEED, KINDS, JOGS_PER_CASE, PAIRS_PER_CASE = 20261128, ("stream", "jog", "torque"), 50, 50
ARMS = ("panda", "ur5e")
CASES = 40 * len(KINDS)
RATE, LENGTH, SPEED, SETTLED = 20.0, 10.0, 0.7, 1.5
"""Chunks per second, length of a task [s], fraction of the limits that it uses, and time from which its distance counts [s]."""
NOISE, BIAS, LATEST = 1e-3, 4e-3, 0.3
STARTS = 0.008
"""Latest start of the motion of a command: the stream's budget and a tick [s]."""
RATIO = 1.1
"""Asked: distance over that without noise and bias, and time to rest over Ruckig's."""


class Task:
    """An intended motion: sums of three sinusoids of each joint around a middle, at a fraction of the limits."""

    def __init__(self, robot: Any, box: Box, rng: np.random.Generator) -> None:
        low, high = chunks.span(robot)
        self.frequency, self.phase = rng.uniform(0.5, 4.0, (3, robot.n)), rng.uniform(0.0, 2.0 * np.pi, (3, robot.n))
        self.middle, self.size = 0.5 * (low + high), rng.uniform(0.3, 1.0, (3, robot.n))
        t = np.linspace(0.0, LENGTH, 4001)
        over = [np.abs(self(t, k) - (k == 0) * self.middle).max(axis=0) for k in range(4)]
        most = [0.45 * (high - low), *(SPEED * box.values[k, 1] for k in (1, 2, 3))]
        self.size /= np.max([o / m for o, m in zip(over, most, strict=True)], axis=0)

    def __call__(self, t: Any, order: int = 0) -> Array:
        angle = np.multiply.outer(t, self.frequency) + self.phase + 0.5 * order * np.pi
        return np.asarray((self.size * self.frequency**order * np.sin(angle)).sum(axis=-2) + (order == 0) * self.middle)


class Policy:
    """A source that observes the task at a fixed rate; each chunk comes late."""

    def __init__(self, task: Task, rng: np.random.Generator, wrong: float) -> None:
        self.waiting: list[tuple[float, Chunk]] = []
        ahead = np.arange(20) / RATE
        for observed in np.arange(0.0, LENGTH, 1.0 / RATE):
            points = task(observed + ahead)
            late, bias, noise = (
                rng.uniform(0.0, LATEST),
                rng.uniform(-1.0, 1.0, points.shape[1]),
                rng.normal(size=points.shape),
            )
            points = points + wrong * (BIAS * bias + NOISE * noise)
            self.waiting.append((observed + late, Chunk(points, RATE, observed)))
        self.waiting.sort(key=lambda each: each[0])

    def __call__(self, now: planners.streams.Setpoint) -> Chunk | None:
        return self.waiting.pop(0)[1] if self.waiting and self.waiting[0][0] <= now.t else None


def judge_stream(opened: planners.Stream, box: Box, each: Callable[[planners.streams.Setpoint], None]) -> Row:
    """Run a stream; compare all motions with the limits and with the ones before, and all set-points with the motion."""
    running, begin, joined = opened._running, 0.0, 0
    worst: dict[str, Array] = {
        "over": np.full(4, -np.inf),
        "begin": np.zeros(3),
        "inside": np.zeros(3),
        "end": np.zeros(3),
    }
    apart = 0.0
    for now in opened:
        if now.joined is not None:
            before = running.trajectory if hasattr(running, "trajectory") else running
            row = judge_motion(now.joined, before, now.joined.at, box)
            worst = {key: np.maximum(value, row[key]) for key, value in worst.items()}
            running, begin, joined = now.joined, begin + now.joined.at, joined + 1
        curve = running.trajectory if hasattr(running, "trajectory") else running
        state = (now.q, now.dq, now.ddq)
        apart = max(apart, *(float(np.abs(x - evaluate(curve, now.t - begin, k)).max()) for k, x in enumerate(state)))
        each(now)
    return {key: value.tolist() for key, value in worst.items()} | {"setpoints": apart, "joined": joined}


def stream(case: int, rng: np.random.Generator) -> Row:
    """One task twice: with noise and bias, and without."""
    name = ARMS[case % len(ARMS)]
    robot = chunks.robot_of(name)
    box = chunks.box_of(robot, rng, skewed=False)
    task, seed, row = Task(robot, box, rng), int(rng.integers(2**31)), {"kind": "stream", "arm": name}
    for wrong in (1.0, 0.0):
        policy = Policy(task, np.random.default_rng(seed), wrong)
        opened = planners.stream(robot, policy, task(0.0), realtime=False, limits=box.limits)
        seen: list[tuple[float, Array, float]] = []
        found = judge_stream(
            opened, box, lambda now, seen=seen: seen.append((now.t, now.q, float(np.abs(now.dq).max())))
        )
        t, q, speed = (np.array(x) for x in zip(*seen, strict=True))
        inside = (t > SETTLED) & (t < LENGTH)
        far = np.sqrt(np.mean((q - task(t))[inside] ** 2, axis=0)).max()
        moving = np.abs(task(t[inside], 1)).max(axis=1) > 0.05
        stops = int(((speed[inside] < 1e-4) & moving).sum())
        report = opened.report()
        found |= {"far": float(far), "stops": stops, "kept": report.kept, "cpu": [1e3 * x for x in report.cpu]}
        row["wrong" if wrong else "right"] = found
    return row


def jog(case: int, rng: np.random.Generator) -> Row:
    """Sequences of commands of 5 s, a third of them in one direction; then silence."""
    name = ARMS[case % len(ARMS)]
    robot = chunks.robot_of(name)
    box = chunks.box_of(robot, rng, skewed=bool(rng.random() < 0.3))
    rows = []
    for _ in range(JOGS_PER_CASE):
        low, high = chunks.span(robot)
        timeout, long = float(rng.uniform(0.05, 0.4)), bool(rng.random() < 0.34)
        source = JogVelocity(timeout=timeout)
        opened = planners.stream(
            robot, source, rng.uniform(low, high), realtime=False, rate=250.0, limits=box.limits, silence=1.0
        )
        rows.append(sequence(opened, source, box, rng, long))
    return {"kind": "jog", "arm": name, "rows": rows}


def sequence(opened: planners.Stream, source: JogVelocity, box: Box, rng: np.random.Generator, long: bool) -> Row:
    """One sequence of commands, and when the arm rests after the last one."""
    most = box.values[1, 1]
    steady, waits = rng.uniform(-1.5, 1.5, most.size) * most, commands(rng, long)
    last: dict[str, Any] = {"t": next(waits), "command": -1.0, "rest": -1.0, "allowed": 0.0, "stop": 0.0}

    def each(now: planners.streams.Setpoint) -> None:
        if last["command"] >= 0.0 and now.t <= last["command"] + source.timeout + 0.02:
            stop = chunks.fastest(np.array([now.q, now.dq, now.ddq]), np.zeros((3, most.size)), box, stop=True)
            last["stop"] = max(last["stop"], stop.duration)
            last["allowed"] = last["command"] + source.timeout + RATIO * last["stop"] + STARTS
        if np.abs(now.dq).max() > 1e-9 or np.abs(now.ddq).max() > 1e-9:
            last["rest"] = now.t
        if now.t >= last["t"]:
            source.set(steady if long else rng.uniform(-1.2, 1.2, most.size) * most)
            last.update(command=now.t, t=next(waits, np.inf), stop=0.0)

    row = judge_stream(opened, box, each)
    return row | {"late": last["rest"] - last["allowed"], "long": long, "kept": opened.report().kept}


def commands(rng: np.random.Generator, long: bool) -> Iterator[float]:
    """Instants of commands [s]."""
    t = 0.0
    while t < 5.0:
        yield t
        t += float(rng.uniform(0.02, 0.1) if long else rng.choice([0.02, 0.1, 0.6]) * rng.uniform(0.5, 1.5))


def torque(case: int, rng: np.random.Generator) -> Row:
    """Chunks of the panda with 3 kg, under its torque limits."""
    robot = chunks.robot_of("panda").with_payload(3.0)
    plain = chunks.box_of(robot, rng, skewed=False)
    limits = MotionLimits.of(robot, jerk=plain.values[3, 1], acceleration=plain.values[2, 1], torque_rate=None)
    box, model, rows = Box(plain.values, limits), PinocchioDynamics(robot), []
    made = chunks.random_plan(robot, box, rng)
    for _ in range(PAIRS_PER_CASE):
        at = float(rng.uniform(0.02, 0.98) * made.trajectory.duration)
        given = chunks.random_chunk(made.trajectory, at, box, rng, robot)
        found, ms = call(made, at, given.chunk, tolerance=given.tolerance)
        row = {"status": str(found.status), "reason": found.reason, "ms": ms}
        if found:
            row |= judge_motion(found, made.trajectory, at, box)
            t = np.arange(0.0, found.trajectory.duration, 1e-3)
            states = zip(*(evaluate(found.trajectory, t, k) for k in range(3)), strict=True)
            tau = np.abs([model.torques(*state) for state in states]).max(axis=0)
            row["torque"] = float((tau / robot.limits.torque).max())
            row["bound"] = float(found.certificate.peaks["torque"].ratio.max())
        rows.append(row)
    return {"kind": "torque", "rows": rows}


def measure(case: int) -> Row:
    kind = KINDS[case % len(KINDS)]
    run: dict[str, Callable[[int, np.random.Generator], Row]] = {"stream": stream, "jog": jog, "torque": torque}
    return run[kind](case // len(KINDS), np.random.default_rng([SEED, case]))


# ------------------------------------------------------------ the figures


def clean(rows: list[Row], what: str) -> list[Value]:
    """Continuity, limits, and set-points that are the motion's."""
    jump = max(max(max(r[k]) for k in ("begin", "inside", "end")) for r in rows)
    over = np.max([r["over"] for r in rows], axis=0)
    out = [
        Value(f"{what}, discontinuity of q, q̇, q̈", "≤ 1e-12", f"{jump:.2g} of {len(rows)}", jump <= 1e-12),
        Value(f"{what}, excess over limits on q … q⃛", "≤ 1e-9", ", ".join(f"{x:.2g}" for x in over),
              bool((over <= 1e-9).all())),
    ]  # fmt: skip
    if "setpoints" in rows[0]:
        apart = max(r["setpoints"] for r in rows)
        out.append(Value(f"{what}, set-points beside the motion", "≤ 1e-9", f"{apart:.2g}", apart <= 1e-9))
    return out


def judge_streams(name: str, rows: list[Row]) -> list[Value]:
    wrong, right = ([row[key] for row in rows] for key in ("wrong", "right"))
    excess = [w["far"] - RATIO * r["far"] for w, r in zip(wrong, right, strict=True)]
    stops, kept = sum(w["stops"] for w in wrong), sum(sum(w["kept"].values()) for w in wrong)
    far = [float(np.median([x["far"] for x in each])) for each in (wrong, right)]
    return [
        Value(f"{name}, stream, stops while the task moves", "0", f"{stops} in {len(rows)} runs, {kept} chunks kept",
              not stops),
        *clean(wrong, f"{name}, streams"),
        Value(f"{name}, stream, RMS distance over {RATIO} x that without noise and bias [rad]", f"≤ {BIAS}",
              f"{max(excess):.4f}; median {far[0]:.4f}, without {far[1]:.4f}", max(excess) <= BIAS),
    ]  # fmt: skip


def judge(rows: list[Row]) -> list[Value]:
    out: list[Value] = []
    for name in ARMS:
        if mine := [row for row in rows if row["kind"] == "stream" and row["arm"] == name]:
            out += judge_streams(name, mine)
        if jogs := [one for row in rows if row["kind"] == "jog" and row["arm"] == name for one in row["rows"]]:
            late, kept = max(one["late"] for one in jogs), sum(sum(one["kept"].values()) for one in jogs)
            out += clean(jogs, f"{name}, jogging")
            out.append(Value(f"{name}, jogging, rest after time-out + {RATIO} x Ruckig's stop [s]", "≤ 0",
                             f"{late:.4f} of {len(jogs)}", late <= 0.0))  # fmt: skip
            out.append(Value(f"{name}, jogging, commands not joined", "0", str(kept), not kept))
            for words in sorted({words for one in jogs for words in one["kept"]})[:5]:
                print(f"  {name}, jog kept: {words}")
    loaded = [one for row in rows if row["kind"] == "torque" for one in row["rows"]]
    if loaded:
        out += judge_torque(loaded)
    return out


def judge_torque(rows: list[Row]) -> list[Value]:
    joined = [row for row in rows if row["status"] == RetargetStatus.JOINED]
    share, most, bound = len(joined) / len(rows), max(r["torque"] for r in joined), max(r["bound"] for r in joined)
    for reason in sorted({row["reason"][:15] for row in rows if row["status"] == RetargetStatus.KEPT}):
        print(f"  kept: {reason} …")
    return [
        Value("panda with 3 kg, joined", "≥ 97 %", f"{share:.1%} of {len(rows)}", share >= 0.97),
        Value("panda with 3 kg, torque over its limit, by Pinocchio", "≤ 1", f"{most:.4f}", most <= 1.0),
        Value("panda with 3 kg, torque over its limit, bound", "≤ 1", f"{bound:.4f}", bound <= 1.0 + 1e-9),
        *clean(joined, "panda with 3 kg"),
        times([row["ms"] for row in rows], "panda with 3 kg", (5.0,)),
    ]


if __name__ == "__main__":
    main("retarget_streams", measure, CASES, judge, part=0.2)
