"""Motions around the obstacles of MotionBenchMaker: found, proved, CPU seconds and durations; sampled by coal at 2 kHz.

The environment variable ``MBM`` names the folder of `tests.figures.search`. Peers in the same run: our search's polyline with a
stop at each vertex and with rounded corners, and those of OMPL and VAMP where they are installed, OMPL's by TOPP-RA too.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache
from itertools import pairwise
from time import process_time

import numpy as np

import optik
from benchmarks.blocks.motion import OF_OMPL, ROUNDED, find_polyline, time_rounded
from benchmarks.peers.base import Absent
from optik import Robot, Scene
from optik.errors import MissingDependency, OptikError
from optik.scene.contact import find_contact
from optik.types import Array
from planners import JointLine, MotionLimits, Plan, Trajectory, find_path, plan
from tests.figures.figure import Row, Value, main
from tests.figures.search import KINDS, NUMBERS, arm, problem
from tests.planners.contacts import COAL_ERROR, Oracle, instants

MODELS = ("panda_hand", "panda", "ur5")
"""Arms of `tests.figures.search`: our capsules, and VAMP's spheres."""
RATE, FINE_RATE, WITHIN, REPEATED = 2000.0, 20_000.0, 0.01, 20
"""Rates of sampling [Hz], all over and around the least distance; distances examined [m]; problems for each repeated one."""


@cache
def limits_of(name: str) -> MotionLimits:
    """Limits of velocity, acceleration and jerk; 2, 10 and 100 for the UR5, which states no acceleration."""
    own = MotionLimits.of(optik.load("panda_hand"))
    return MotionLimits(2.0, 10.0, 100.0) if name == "ur5" else MotionLimits(own.velocity, own.acceleration, own.jerk)


@cache
def warm(name: str) -> None:
    """Compile what the first problem needs."""
    scene, start, goal, _ = problem(name, "box", 2)
    plan(arm(name), goal, start, limits=limits_of(name), scene=scene, avoid=True)


def find_reason(name: str, scene: Scene, ends: tuple[Array, Array]) -> str:
    """Why the ends of a problem are not free, or nothing."""
    robot = arm(name)
    for which, q in zip(("start", "goal"), ends, strict=True):
        if not robot.limits.contains(q):
            return f"{which} outside the limits"
        if (near := find_contact(robot, scene, q)).room <= 0.0:
            excess = name == "panda_hand" and find_contact(arm("panda"), replace(scene, allow=()), q).room > 0.0
            return f"{which} in contact{' by capsule excess' if excess else ''}: {near.pair[0]}, {near.pair[1]}"
    return ""


def round_and_time(
    robot: Robot, limits: MotionLimits, scene: Scene, ends: tuple[Array, Array], method: str
) -> Plan | None:
    """The motion of a law along a search's polyline with rounded corners; None without the search's package or a path."""
    search, law = ROUNDED[method]
    try:
        found = find_polyline(robot, scene, ends, search)
    except (MissingDependency, Absent):
        return None
    return time_rounded(robot, limits, scene, found, law) if found else None


def sample(robot: Robot, limits: MotionLimits, scene: Scene, motion: Trajectory) -> Row:
    """The least distance by coal, infinite above `WITHIN`, and the largest ratio to a limit of the joints."""
    t = instants(motion, RATE)
    oracle, q = Oracle(robot, scene), motion(t)
    near = oracle.near(q, WITHIN, WITHIN)
    least = np.minimum(near.scene, near.own)
    around = t[least.argmin()] + np.arange(-10, 11) / FINE_RATE
    close = oracle.near(motion(np.clip(around, 0.0, motion.end)), WITHIN, WITHIN)
    bounds = limits.arrays(robot.n)
    kinds = enumerate(("velocity", "acceleration", "jerk"), 1)
    ratio = max(float((np.abs(motion(t, order)) / bounds[kind]).max()) for order, kind in kinds)
    inside = (q >= robot.limits.lower - 1e-9).all() and (q <= robot.limits.upper + 1e-9).all()
    return {"coal": float(min(least.min(), close.scene.min(), close.own.min())), "ratio": ratio, "inside": bool(inside)}


def measure(case: int) -> Row:
    """One problem of one arm."""
    name, kind, number = MODELS[case % 3], KINDS[case // 3 % len(KINDS)], 1 + case // (3 * len(KINDS))
    warm(name)
    scene, *both, _ = problem(name, kind, number)
    ends = both[0], both[1]
    row: Row = {"model": name, "kind": kind, "number": number, "ends": find_reason(name, scene, ends)}
    if row["ends"]:
        return row
    try:
        return row | measure_free(arm(name), limits_of(name), scene, ends, again=number % REPEATED == 1)
    except OptikError as error:
        return row | {"status": type(error).__name__, "reason": str(error)[:200]}


def measure_free(robot: Robot, limits: MotionLimits, scene: Scene, ends: tuple[Array, Array], *, again: bool) -> Row:
    """The methods on a problem whose ends are free."""
    begin = process_time()
    found = find_path(robot, *ends, scene=scene)
    row: Row = {"found": bool(found), "search": process_time() - begin, "length": found.length if found else None}
    begin = process_time()
    made = plan(robot, ends[1], ends[0], limits=limits, scene=scene, avoid=True)
    row |= {"seconds": process_time() - begin, "status": str(made.status)}
    row["reason"] = "" if made.failure is None else made.failure.reason[:160]
    row["rounds"] = None if made.search is None else [made.search.rounds, made.search.paths]
    if found:
        moves = [plan(robot, JointLine(robot, a, b), a, limits=limits) for a, b in pairwise(found.vertices)]
        row |= {"stops": sum(one.trajectory.duration for one in moves), "edges": len(moves)}
    for method in ROUNDED:
        other = round_and_time(robot, limits, scene, ends, method)
        if other is not None:
            row[method] = other.trajectory.duration if other else None
    if made:
        assert made.certificate.clearance is not None
        row |= {"T": made.trajectory.duration, "proved": made.certificate.clearance.proved}
        row |= sample(robot, limits, scene, made.trajectory)
        if again:
            repeated = plan(robot, ends[1], ends[0], limits=limits, scene=scene, avoid=True)
            row["equal"] = bool(np.array_equal(made.trajectory.padded, repeated.trajectory.padded))
    return row


def judge_model(name: str, rows: list[Row]) -> list[Value]:
    """The figures of one arm; a motion of a peer that is not valid by our certificate counts as none."""
    free = [row for row in rows if not row["ends"]]
    solved = [row for row in free if "T" in row]
    print(
        f"  {name}: {len(free)} of {len(rows)} with free ends; {dict(Counter(row['ends'] for row in rows if row['ends']))}"
    )
    for row in free:
        if "T" not in row:
            print(f"    {row['kind']} {row['number']}: {row['status']}: {row['reason']}")
    for kind in KINDS:
        mine = [row for row in solved if row["kind"] == kind]
        count = sum(row["kind"] == kind for row in free)
        if mine:
            s, T, stops = (np.array([row[key] for row in mine]) for key in ("seconds", "T", "stops"))
            words = f"{np.median(s):.2f} s CPU, motion {np.median(T):.2f} s, {np.median(T / stops):.3f} of stops"
            print(f"    {kind}: {len(mine)} of {count} proved; medians {words}")
    search, seconds = ([row.get(key, np.inf) for row in free] for key in ("search", "seconds"))
    bent = [row["T"] / row["stops"] for row in solved if row["edges"] > 1]
    found, share = np.mean([row.get("found", False) for row in free]), len(solved) / len(free)
    middle, late = np.median(seconds), np.quantile(seconds, 0.95)
    values = [
        Value(f"{name}: path found", "≥ 99 %", f"{100 * found:.1f} % of {len(free)}", bool(found >= 0.99)),
        Value(f"{name}: its CPU", "median ≤ 0.05 s", f"{np.median(search):.3f} s", bool(np.median(search) <= 0.05)),
        Value(f"{name}: motion proved", "≥ 95 %", f"{100 * share:.1f} %", share >= 0.95),
        Value(f"{name}: its CPU", "median ≤ 1 s, p95 ≤ 8 s", f"{middle:.2f}, {late:.2f} s", middle <= 1 and late <= 8),
        Value(
            f"{name}: over stops, bent",
            "median ≤ 0.75",
            f"{np.median(bent):.3f} of {len(bent)}",
            np.median(bent) <= 0.75,
        ),
    ]
    for method in ROUNDED:
        over = np.array([row["T"] / row[method] for row in solved if row.get(method)])
        if over.size:
            most, shown = np.mean(over <= 1.0 + 1e-6), method not in ("own, rounded", OF_OMPL)
            words = f"median {np.median(over):.3f}, {100 * most:.0f} % of {over.size}"
            asked = "shown" if shown else "≤ 1 on 95 %"
            values.append(Value(f"{name}: over {method}", asked, words, shown or bool(most >= 0.95)))
    wrong = sum(not row["proved"] or row["coal"] < -COAL_ERROR for row in solved)
    over_limits = sum(row["ratio"] > 1.0 + 1e-8 or not row["inside"] for row in solved)
    equal = [row["equal"] for row in solved if "equal" in row]
    return [
        *values,
        Value(
            f"{name}: motions with a contact, over a limit", "0, 0", f"{wrong}, {over_limits}", not wrong + over_limits
        ),
        Value(f"{name}: repeated motions equal to the last bit", "all", f"{sum(equal)} of {len(equal)}", all(equal)),
    ]


def judge(rows: list[Row]) -> list[Value]:
    """The figures of each arm."""
    each = ((name, [row for row in rows if row["model"] == name]) for name in MODELS)
    return [value for name, some in each if any(not row["ends"] for row in some) for value in judge_model(name, some)]


if __name__ == "__main__":
    main("motionbench", measure, len(MODELS) * len(KINDS) * NUMBERS, judge, part=0.2)
