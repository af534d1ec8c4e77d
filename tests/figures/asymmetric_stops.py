"""Stops with asymmetric acceleration limits: against an independent optimum, and with a wider side that no joint uses.

The oracle is a sequential linear programme (HiGHS) in time: for a duration T the jerk along the path is constant on equal
intervals, s, ds/dt and d²s/dt² are linear in it, and the least excess of the limits on velocity, acceleration and jerk of the
joints is found by linearising them about the last solution. T is the shortest duration without an excess, by bisection. A side
is unused where the stop's acceleration comes to at most 0.7 of it; it is then widened by a factor of 2.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.optimize import linprog

import optik
from optik.errors import OptikError
from optik.types import Array
from planners import MotionLimits, Plan, plan, replan
from planners.replan.state import build_moving_state
from tests.figures.figure import Row, Value, main
from tests.figures.moving import ARMS, path_on, span

COUNT, PER_PLAN = 500, 10
INTERVALS, PASSES, EXCESS, BISECTIONS, LOWEST = 40, 8, 1e-3, 7, 0.75
UNUSED, WIDER = 0.7, 2.0
DENSE = 4000


@lru_cache(maxsize=1)
def asymmetric_plan(number: int) -> Plan:
    """A valid plan with two different sides of every joint's acceleration."""
    for trial in range(100):
        rng = np.random.default_rng([14, number, trial])
        robot = optik.load(str(rng.choice(ARMS)))
        low, high = span(robot)
        q = low + (high - low) * rng.uniform(0.3, 0.7, robot.n)
        own = np.full(robot.n, 2.0) if robot.limits.velocity is None else robot.limits.velocity
        sides = 10.0 * 10.0 ** rng.uniform(-0.4, 0.6, (2, robot.n))
        limits = MotionLimits(np.minimum(2.0, own), (-sides[0], sides[1]), 100.0 * 10.0 ** rng.uniform(-0.3, 0.5))
        try:
            made = plan(robot, path_on(robot, q, number % 3, rng), q, limits=limits)
        except OptikError:
            continue
        if made:
            return made
    raise AssertionError("no plan")


def measure(case: int) -> Row:
    """One stop."""
    made = asymmetric_plan(case // PER_PLAN)
    t = float(np.random.default_rng([15, case]).uniform(0.02, 0.9)) * made.trajectory.duration
    usual, best = (replan(made, t, stop=True, time_limit=seconds) for seconds in (0.2, 5.0))
    if not usual or not best:
        return {"valid": False}
    lower, upper = made.limits.bounds(made.robot.n)["acceleration"]
    ddq = best.trajectory(np.linspace(0.0, best.trajectory.end, DENSE), 2)
    lower = np.where(ddq.min(axis=0) > UNUSED * lower, WIDER * lower, lower)
    upper = np.where(ddq.max(axis=0) < UNUSED * upper, WIDER * upper, upper)
    wide = MotionLimits(made.limits.velocity, (lower, upper), made.limits.jerk)
    other = replan(made, t, stop=True, time_limit=5.0, limits=wide)
    return {
        "valid": bool(other), "kind": str(usual.stop_kind), "duration": usual.trajectory.duration,
        "best": best.trajectory.duration, "wide": other.trajectory.duration, "oracle": shortest(made, t, usual),
    }  # fmt: skip


def shortest(made: Plan, t: float, found: Plan) -> float:
    """Shortest duration of a stop by the oracle [s]; infinite if it finds none of 1.02 times the found duration."""
    at = build_moving_state(made, made.trajectory, t).at
    state, n = np.array([at.s, at.speed, at.acceleration]), made.robot.n
    bounds = made.limits.bounds(n)
    V, J = bounds["velocity"], bounds["jerk"]
    limits = np.array([-V, V]), bounds["acceleration"], np.array([-J, J])
    low, high, jerk = LOWEST * found.trajectory.duration, 1.02 * found.trajectory.duration, None
    best = np.inf
    for k in range(BISECTIONS):
        T = high if k == 0 else 0.5 * (low + high)
        trial = solve(made, state, limits, T, None if jerk is None else jerk * (best / T) ** 2)
        if trial is not None:
            best, high, jerk = T, T, trial
        elif jerk is None:
            break
        else:
            low = T
    return float(best)


def solve(made: Plan, state: Array, limits: tuple[Array, ...], T: float, guess: Array | None) -> Array | None:
    """The jerk along the path of a stop of duration T within the limits, None if the oracle finds none."""
    h, N, end = T / INTERVALS, INTERVALS, made.joint_path.end
    step = np.array([[1.0, h, h * h / 2.0], [0.0, 1.0, h], [0.0, 0.0, 1.0]])
    free, forced = np.zeros((N + 1, 3)), np.zeros((N + 1, 3, N))
    free[0] = state
    for k in range(N):
        free[k + 1], forced[k + 1] = step @ free[k], step @ forced[k]
        forced[k + 1, :, k] += np.array([h**3 / 6.0, h * h / 2.0, h])
    jerk = guess
    if jerk is None:  # ds/dt falls as a cubic with the given acceleration
        v, a = state[1:]
        c = np.array([(a * T + 2.0 * v) / T**3, -(2.0 * a * T + 3.0 * v) / T**2, a, v])
        jerk = np.diff(np.polyval(np.polyder(c), np.linspace(0.0, T, N + 1))) / h
    still, none = np.zeros((2, N)), np.zeros((N, 1))
    for number in range(PASSES):
        rows, values, sides = linearise(made, free + forced @ jerk, forced, jerk, limits)
        rest = values - rows @ jerk
        A = np.vstack([
            np.hstack([rows, -sides[1][:, None]]), np.hstack([-rows, sides[0][:, None]]),
            np.hstack([-forced[1:, 1], none]), np.append(forced[-1, 0], 0.0)[None],
        ])  # fmt: skip
        b = np.concatenate([sides[1] - rest, rest - sides[0], free[1:, 1], [end - free[-1, 0]]])
        at_rest = np.hstack([forced[-1, 1:], still[:, :1]]) / h, -free[-1, 1:] / h
        room = (
            np.inf if number == 0 else 0.5**number * np.abs(jerk).max()
        )  # a trust region, so that the passes converge
        near = np.stack([np.append(jerk - room, 0.0), np.append(jerk + room, np.inf)], axis=1)
        found = linprog(np.append(np.zeros(N), 1.0), A, b, *at_rest, bounds=near, method="highs")
        if found.status != 0:
            return None
        jerk = found.x[:N]
        _, values, sides = linearise(made, free + forced @ jerk, forced, jerk, limits)
        over = float(np.maximum(values / sides[0], values / sides[1]).max()) - 1.0
        if over <= EXCESS:
            return np.asarray(jerk)
    return None


def linearise(
    made: Plan, motion: Array, forced: Array, jerk: Array, limits: tuple[Array, ...]
) -> tuple[Array, Array, tuple[Array, Array]]:
    """Derivatives over the jerks, values and limits: of velocities and accelerations at grid points, jerks at both sides."""
    N, end = jerk.size, made.joint_path.end
    s, v, a = motion.T[..., None]
    q = [made.joint_path(np.clip(s[:, 0], 0.0, end), order) for order in (1, 2, 3)]
    S, V, A = (forced[:, i][:, None] for i in range(3))
    each, rows, values = np.eye(N)[:, None], [], []
    q1, q2, q3 = (x[1:, :, None] for x in q)
    w, b = v[1:, :, None], a[1:, :, None]
    rows += [q1 * V[1:] + q2 * w * S[1:], q1 * A[1:] + 2.0 * q2 * w * V[1:] + (q2 * b + q3 * w**2) * S[1:]]
    values += [q[0][1:] * v[1:], q[0][1:] * a[1:] + q[1][1:] * v[1:] ** 2]
    for part in (slice(0, N), slice(1, N + 1)):
        q1, q2, q3 = (x[part][..., None] for x in q)
        w, b, j = v[part][..., None], a[part][..., None], jerk[:, None, None]
        rows.append(
            q1 * each
            + 3.0 * q2 * w * A[part]
            + 3.0 * (q2 * b + q3 * w**2) * V[part]
            + (q2 * j + 3.0 * q3 * w * b) * S[part]
        )
        values.append((q1 * j + 3.0 * q2 * w * b + q3 * w**3)[..., 0])
    kinds = (limits[0], limits[1], limits[2], limits[2])
    lower, upper = (np.concatenate([np.tile(kind[side], N) for kind in kinds]) for side in (0, 1))
    return np.concatenate([x.reshape(-1, N) for x in rows]), np.concatenate([x.ravel() for x in values]), (lower, upper)


def judge(rows: list[Row]) -> list[Value]:
    """The figures."""
    valid = [row for row in rows if row["valid"]]
    change = max((abs(row["wide"] / row["best"] - 1.0) for row in valid), default=np.nan)
    late = np.array([row["duration"] / row["oracle"] for row in valid])  # 0 where the oracle found no stop as short
    kinds = {kind: sum(row["kind"] == kind for row in valid) for kind in ("optimum", "sweep", "end")}
    none = int((late == 0.0).sum())
    median, p90 = (float(np.quantile(late, level)) for level in (0.5, 0.9))
    return [
        Value("stops valid", "all", f"{len(valid)} of {len(rows)}", len(valid) == len(rows)),
        Value("largest change by a wider unused side", "≤ 0.5 %", f"{100.0 * change:.3g} %", change <= 0.005),
        Value(
            "duration over the oracle's, median",
            "≤ 1.05",
            f"{median:.4g} of {late.size}, {none} without an oracle",
            median <= 1.05,
        ),
        Value("duration over the oracle's, nine in ten", "stated", f"≤ {p90:.4g}", True),
        Value("kinds", "stated", str(kinds), True),
    ]


if __name__ == "__main__":
    main("asymmetric_stops", measure, COUNT, judge)
