"""Streams at 500 Hz whose targets are blocked, out of range, NaN, of the wrong size or late, or whose source raises.

Each stream gets good goals and chunks, and bad ones of its kind while the arm moves. Set-points are compared with the limits
by differences. A third of the streams run in real time, each of those of the kind "late" with less budget than its
computations take. Half of the others are taken along by an ideal drive.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import optik
import planners
from optik.types import Array
from planners import Chunk
from planners.cell import make_drive
from tests.figures import chunks
from tests.figures.figure import Row, Value, main

SEED, CASES, RATE, LASTS = 20261129, 100, 500.0, 1.5
KINDS = ("blocked", "range", "nan", "size", "text", "late", "raises")


class Source:
    """Goals and chunks near the arm, and bad targets of one kind."""

    def __init__(self, kind: str, robot: Any, rng: np.random.Generator) -> None:
        self.kind, self.robot, self.rng, self.due, self.asked, self.bad = kind, robot, rng, 0.0, 0.0, 0

    def __call__(self, now: planners.Setpoint) -> Any:
        self.asked = now.t
        if not self.due <= now.t <= LASTS:
            return None
        self.due = now.t + self.rng.uniform(0.02, 0.2)
        if now.t > 0.3 and self.rng.random() < 0.5:
            self.bad += 1
            return self.spoil(self.target(now))
        return self.target(now)

    def target(self, now: planners.Setpoint) -> Any:
        low, high = chunks.span(self.robot)
        goal = np.clip(now.q + self.rng.uniform(-0.5, 0.5, now.q.size), low + 0.05, high - 0.05)
        if self.rng.random() < 0.5:
            return goal
        u = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 20))[:, None]
        return Chunk(now.q + u * (goal - now.q), 20.0, max(now.t - 0.05, 0.0))

    def spoil(self, target: Any) -> Any:
        q = np.array(np.asarray(target.points)[-1] if isinstance(target, Chunk) else target)
        if self.kind == "raises":
            raise RuntimeError("the policy is gone")
        if self.kind == "range":
            i = int(self.rng.integers(q.size))
            q[i] = self.robot.limits.upper[i] + self.rng.uniform(1e-3, 3.0)
        if self.kind == "nan":
            q[int(self.rng.integers(q.size))] = np.nan
        return {"size": q[:-1], "text": "home", "late": target, "blocked": Chunk([q, q + 9.0], 20.0)}.get(self.kind, q)


def opened(kind: str, case: int, rng: np.random.Generator) -> tuple[planners.Stream, Source, chunks.Box]:
    robot = chunks.robot_of(("panda", "ur5e")[case % 2])
    box, low, high = chunks.box_of(robot, rng, skewed=False), *chunks.span(robot)
    start, source = rng.uniform(low + 0.5, high - 0.5), Source(kind, robot, rng)
    scene = None
    if kind == "blocked":  # a box that the arm does not reach at once
        there = robot.fk(start)[:3, 3] + rng.uniform(0.15, 0.3, 3) * rng.choice([-1.0, 1.0], 3)
        scene = optik.Scene(boxes=((optik.se3.pose(p=there), np.array([0.05, 0.05, 0.05])),))
    realtime = kind == "late" or case % 3 == 0
    options: dict[str, Any] = {"scene": scene, "budget": 0.01 if kind == "late" else 0.02}
    flow = planners.stream(
        robot, source, start, rate=RATE, limits=box.limits, silence=1.0, realtime=realtime, **options
    )
    if kind == "late":
        prompt = flow.engine.run
        flow.engine.run = lambda *given: (time.sleep(rng.uniform(0.0, 0.02)), prompt(*given))[1]  # type: ignore[method-assign]
    return flow, source, box


def judge_points(t: Array, q: Array, box: chunks.Box) -> dict[str, Any]:
    """The largest speed over its limit by differences, and whether the last set-points are at rest."""
    dt = np.diff(t)[:, None]
    v = np.diff(q, axis=0) / dt
    return {"over": float((np.abs(v) / box.values[1, 1]).max()), "moved": float(np.abs(v).max())}


def measure(case: int) -> Row:
    kind, rng = KINDS[case % len(KINDS)], np.random.default_rng([SEED, case])
    flow, source, box = opened(kind, case // len(KINDS), rng)
    row: Row = {"kind": kind, "raised": "", "early": False, "drive": not flow.realtime and case % 2 == 0}
    points: list[planners.Setpoint] = []
    if row["drive"]:
        done = make_drive("ideal", flow.robot, period=1.0 / RATE).follow(_kept(flow, points))
        row["raised"] = done.fault
    else:
        try:
            for now in flow:
                points += [now]
        except Exception as error:
            row["raised"] = f"{type(error).__name__}: {error}"
    t, q = np.array([now.t for now in points]), np.array([now.q for now in points])
    rest = not points[-1].dq.any() and not points[-1].ddq.any()
    report = flow.report()
    return row | judge_points(t, q, box) | {
        "rest": bool(rest), "bad": source.bad, "joined": report.joined, "kept": report.kept, "late": report.late,
        "went_on": bool(source.asked > LASTS), "expected": kind == "raises" and source.bad > 0,
    }  # fmt: skip


def _kept(flow: planners.Stream, points: list[planners.Setpoint]) -> planners.Stream:
    """The stream, whose set-points are kept, too."""
    advance = flow.advance

    def keep() -> planners.Setpoint | None:
        now = advance()
        if now is not None:
            points.append(now)
        return now

    flow.advance = keep  # type: ignore[method-assign]
    return flow


def judge(rows: list[Row]) -> list[Value]:
    for kind in KINDS:
        mine = [row for row in rows if row["kind"] == kind]
        joined, bad, late = (sum(r[key] for r in mine) for key in ("joined", "bad", "late"))
        kept = sum(sum(r["kept"].values()) for r in mine)
        print(f"  {kind}: {len(mine)} streams, {bad} bad targets, {joined} joined, {kept} kept or refused, {late} late")
    rests, wrong = sum(r["rest"] for r in rows), [r for r in rows if bool(r["raised"]) != r["expected"]]
    over, on = max(r["over"] for r in rows), [r for r in rows if not r["expected"]]
    drives = [r for r in rows if r["drive"]]
    return [
        Value("set-points that end at rest", f"{len(rows)}", str(rests), rests == len(rows)),
        Value("exceptions before rest, or none where the source raised", "0", str(len(wrong)), not wrong),
        Value("streams that went on after bad targets", f"{len(on)}", str(sum(r["went_on"] for r in on)),
              all(r["went_on"] for r in on)),
        Value("drive.follow returned its record", f"{len(drives)}", str(len(drives)), True),
        Value("speed over its limit, by differences", "≤ 1", f"{over:.6f}", over <= 1.0 + 1e-6),
        Value("streams whose arm moved", "≥ 95", str(sum(r["moved"] > 0.05 for r in rows)),
              sum(r["moved"] > 0.05 for r in rows) >= 0.95 * len(rows)),
    ]  # fmt: skip


if __name__ == "__main__":
    main("stream_faults", measure, CASES, judge)
