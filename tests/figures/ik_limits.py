"""Solvable targets with joints exactly on a limit, singular and regular: how many `lm` loses, and whether an answer is false.

A case is one arm, one fraction of joints on a limit, and regular or singular targets, or a task. Targets are the oracle's
poses of random configurations inside the limits. Singular ones are found by Gauss–Newton steps on J v = 0, |v| = 1, that
move only the joints that are not on a limit; an arm without such configurations says so. Every target is solved from a
random start and from q + N(0, 1e-3). An answer is false if the oracle's error is above 1e-6 or a joint is outside.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

import optik
from optik.ik import LM
from optik.types import Array, Flags
from tests import oracles
from tests.figures.figure import Row, Value, main

TOLERANCE, SINGULAR, STEPS = 1e-6, 1e-9, 25
FRACTIONS = (0.3, 0.7)
TARGETS, TASK_TARGETS, PARTS = 100_000, 20_000, 20
"""Targets of one kind and arm, and in how many cases they are measured."""
KINDS = [
    *((fraction, kind, "pose") for fraction, kind in product(FRACTIONS, ("regular", "singular"))),
    *((fraction, "regular", task) for fraction, task in product(FRACTIONS, ("position", "axis_z"))),
]
CASES = [(*kind, name) for _ in range(PARTS) for kind in KINDS for name in optik.robots()]


def put_on_limits(robot: Any, rng: np.random.Generator, fraction: float, count: int) -> tuple[Array, Flags]:
    """Draw configurations (count, n) with a fraction of the joints on a limit, and which joints these are."""
    low, high = robot.limits.lower, robot.limits.upper
    q = rng.uniform(low, high, (count, robot.n))
    ends, held = np.where(rng.random(q.shape) < 0.5, low, high), rng.random(q.shape) < fraction
    return np.where(held, ends, q), held


def make_singular(robot: Any, q: Array, held: Flags) -> Array:
    """Move the other joints to configurations of lower rank; those that are not reached or are outside are dropped."""
    wide, n, first = robot.n >= 6, robot.n, q
    U, _, Vt = np.linalg.svd(robot.jacobian(q))
    v = U[:, :, -1] if wide else Vt[:, -1]

    def system(x: Array) -> Array:
        J = robot.jacobian(x)
        return np.swapaxes(J, 1, 2) if wide else J

    for _ in range(STEPS):
        A = system(q)
        value = np.concatenate([(A @ v[..., None])[..., 0], np.sum(v * v, axis=1)[:, None] - 1.0], axis=1)
        slope = np.zeros((len(q), value.shape[1], n + v.shape[1]))
        for j in range(n):
            step = 1e-6 * np.eye(n)[j]
            slope[:, :-1, j] = ((system(q + step) - system(q - step)) @ v[..., None])[..., 0] / 2e-6 * ~held[:, j, None]
        slope[:, :-1, n:], slope[:, -1, n:] = A, 2.0 * v
        square = slope @ np.swapaxes(slope, 1, 2) + 1e-14 * np.eye(value.shape[1])
        move = (np.swapaxes(slope, 1, 2) @ np.linalg.solve(square, value[..., None]))[..., 0]
        move *= np.minimum(1.0, 0.5 / np.maximum(np.abs(move).max(axis=1, keepdims=True), 1e-12))
        q, v = q - move[:, :n], v - move[:, n:]
    q = np.where(held, first, q)
    inside = ((q >= robot.limits.lower) & (q <= robot.limits.upper)).all(axis=1)
    good: Array = q[inside & (robot.singular_values(q)[:, -1] < SINGULAR)]
    return good


def draw(robot: Any, rng: np.random.Generator, fraction: float, kind: str, count: int) -> Array:
    """Draw at most `count` configurations of one kind: fewer where eight times as many draws yield no more."""
    parts: list[Array] = []
    for _ in range(8):
        q, held = put_on_limits(robot, rng, fraction, count)
        parts.append(make_singular(robot, q, held) if kind == "singular" else q)
        if sum(map(len, parts)) >= count:
            break
    return np.concatenate(parts)[:count]


def measure(case: int) -> Row:
    """Solve the targets of one case from both starts."""
    fraction, kind, task, name = CASES[case]
    robot, arm, rng = optik.load(name), oracles.table(name), np.random.default_rng((2121, case))
    count = (TARGETS if task == "pose" else TASK_TARGETS) // PARTS
    q = draw(robot, rng, fraction, kind, count)
    row: Row = {"arm": name, "fraction": fraction, "kind": kind, "task": task, "targets": len(q), "lost": 0, "false": 0}
    if not len(q):
        return row
    targets, solver = oracles.fk(arm, q), LM(robot, task=task)
    for start in (robot.limits.sample(rng, len(q)), robot.limits.clip(q + rng.normal(0.0, 1e-3, q.shape))):
        batch = solver.solve_batch(targets, start, threads=1)
        poses = oracles.fk(arm, batch.q)
        if task == "pose":
            p, r = oracles.off_by(poses, targets)
        else:
            pairs = zip(poses, targets, strict=True)
            p, r = np.array([oracles.task_off_by(a, b, solver.task.mask, solver.task.frame) for a, b in pairs]).T
        inside = ((batch.q >= arm.lower) & (batch.q <= arm.upper)).all(axis=1)
        good = (p <= TOLERANCE + 1e-12) & (r <= TOLERANCE + 1e-9) & inside
        row["lost"] += int((~batch.solved).sum())
        row["false"] += int((batch.solved & ~good).sum())
    return row


def judge(rows: list[Row]) -> list[Value]:
    """Compare the losses of each arm and kind with what the issue asks."""
    values, sums = [], {}
    for row in rows:
        key = row["task"] == "pose", row["arm"], row["fraction"], row["kind"], row["task"]
        total = sums.setdefault(key, [0, 0, 0])
        for i, word in enumerate(("targets", "lost", "false")):
            total[i] += row[word]
    for (pose, name, fraction, kind, task), (count, lost, _) in sorted(sums.items()):
        if count == 0:
            continue
        most = max(1, round(2 * count * (1e-5 if pose else 1e-4)))
        what = f"{name}, {task}, {fraction:.0%} on limits, {kind}: lost of {count} targets x 2 starts"
        asked = f"<= {most}" if optik.load(name).n >= 6 or not pose else "reported"
        values.append(Value(what, asked, str(lost), lost <= most or asked == "reported"))
    false = sum(total[2] for total in sums.values())
    values.append(Value("false answers", "0", str(false), false == 0))
    return values


if __name__ == "__main__":
    main("ik_limits", measure, len(CASES), judge, part=0.2)
