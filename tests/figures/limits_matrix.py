"""Every limit of makers and goods with every way to a motion: laws, free shapes, obstacles, programs, stops, new targets.

A case is one motion of one limit that the box of joint limits solves and whose goods hold at rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

import optik
from optik import Scene
from optik.arm.robot import Robot
from optik.types import Array
from planners import JointLine, MotionLimits, Part, PointToPoint, Program, plan, replan, retarget
from planners.program import Dwell
from planners.streams import RetargetStatus
from tests.figures import limits, motors
from tests.figures.figure import Row, Value, main

MOTIONS = 10
LAWS = ("optimal", "ruckig", "smooth", "toppra", "constant_speed", "quintic")
MOTOR_LIMITS = ("motor_velocity", "motor_acceleration", "motor_jerk", "motor_torque", "motor_torque_rate")
MEMBERS = (*limits.COUNTS, *MOTOR_LIMITS)
NOT_BY_TOPPRA = ("motor_jerk", "motor_torque_rate")
BOX: dict[str, Any] = {"acceleration": 10.0, "jerk": 100.0, "torque": None, "torque_rate": None}


def case_of(case: int) -> tuple[str, int]:
    return MEMBERS[case // MOTIONS], case % MOTIONS


def draw(name: str, i: int) -> tuple[Robot, Any, Array, MotionLimits, MotionLimits] | None:
    """Arm, path, start, and the limits without and with the member."""
    if name in MOTOR_LIMITS:
        rng = np.random.default_rng([i, 11])
        plain = optik.load(("puma560", "panda")[i % 2]).with_payload(1.0)
        plain = plain.with_limits(velocity=2.5, acceleration=15.0, jerk=150.0, torque_rate=3000.0)
        robot = plain.with_motors(motors.matrix(motors.KINDS[i % 3], plain.n, rng))
        ends = robot.limits.sample(rng, 2)
        all_of, none = MotionLimits.of(robot), dict.fromkeys(MOTOR_LIMITS)
        box = MotionLimits.of(robot, torque=None, torque_rate=None, **none)
        given = MotionLimits.of(robot, torque=None, torque_rate=None, **{**none, name: (all_of.extra or {}).get(name)})
        return robot, JointLine(robot, *ends), ends[0], box, given
    found = limits.draw(
        name, 8 * (i // 4) + i % 4 if name in ("acceleration_by_velocity", "body_speed") and i < 4 else i
    )
    if found is None:
        return None
    robot, path, q = found
    velocity = np.full(robot.n, 2.0) if robot.limits.velocity is None else robot.limits.velocity
    box = MotionLimits.of(robot, **BOX | {"velocity": velocity, "velocity_by_position": None})
    given = MotionLimits.of(
        robot, **BOX | {"velocity": velocity, "velocity_by_position": None} | {name: limits.value_of(name, robot)}
    )
    return robot, path, q, box, given


def obstacle(robot: Robot, first: Array, last: Array, box: MotionLimits) -> Scene | None:
    """A small ball beside the place of the tool halfway, so that the box alone solves the motion around it."""
    middle = robot.fk(0.5 * (first + last))[:3, 3]
    rng = np.random.default_rng(len(robot.name))
    for step in rng.normal(size=(6, 3)):
        scene = Scene(spheres=[(middle + 0.1 * step / np.linalg.norm(step), 0.03)], margin=1e-3)
        if plan(robot, last, first, limits=box, scene=scene, avoid=True):
            return scene
    return None


def said(found: Any) -> str:
    return "" if found else f"{found.status}: {found.failure.reason}"[:160]


def again(name: str, found: Any) -> float:
    """The largest ratio of the member at 20 kHz by formulas of our own; 0 for torques of motors, which `motors` judges."""
    if not found or name in ("motor_torque", "motor_torque_rate"):
        return 0.0
    if name in MOTOR_LIMITS:
        motion, order = found.trajectory, 1 + MOTOR_LIMITS.index(name)
        own = scipy.interpolate.PPoly(motion.coefficients, motion.knots)(np.arange(0.0, motion.end, 5e-5), order)
        most = getattr(found.robot.motors.limits, name.removeprefix("motor_"))
        return float((np.abs(own @ np.linalg.inv(found.robot.motors.matrix).T) / most).max())
    value = limits.value_of(name, found.robot)
    return limits.dense(name, found.robot, value, found.trajectory)


def measure(case: int) -> Row:
    name, i = case_of(case)
    drawn = draw(name, i)
    if drawn is None:
        return {"name": name, "skipped": True}
    robot, path, q, box, given = drawn
    row: Row = {"name": name, "skipped": False, "arm": robot.name}

    def both(way: str, make: Any) -> Any:
        without, found = make(box), make(given)
        ratio = found.certificate.worst(name)[0] if found or way == "quintic" else 0.0
        row[way] = {
            "box": bool(without),
            "ok": bool(found),
            "why": said(found),
            "ratio": ratio,
            "own": again(name, found),
        }
        return found

    planned = {law: both(law, lambda x, law=law: plan(robot, path, q, limits=x, timing=law, allow=("jerk",)))
               for law in LAWS if law != "quintic"}  # fmt: skip
    both("quintic", lambda x: plan(robot, path, q, limits=x, timing="quintic", allow=("jerk", "limits")))
    first = planned["optimal"] or plan(robot, path, q, limits=box)
    if not first:
        return row
    ends = first.trajectory(0.0), first.trajectory(first.duration)
    shaped = both("free", lambda x: plan(robot, PointToPoint(robot, *ends), limits=x))
    row["gain"] = shaped.freedom.gain if shaped else None
    if robot.shapes is not None:
        scene = obstacle(robot, *ends, box)
    if robot.shapes is not None and scene is not None:
        both("avoid", lambda x: plan(robot, ends[1], ends[0], limits=x, scene=scene, avoid=True))
    back = JointLine(robot, ends[1], ends[0]) if isinstance(path, JointLine) else type(path)(path(path.end), path(0.0))
    both("program", lambda x: plan(robot, Program([Part(path), Dwell(0.1), Part(back)]), q, limits=x))
    own = planned["optimal"]
    if not own:
        return row
    rng = np.random.default_rng([case, 3])
    for at in rng.uniform(0.05, 0.95, 3) * own.duration:
        for way, other in (
            ("stop", replan(own, float(at), stop=True)),
            ("replan", replan(own, float(at), timing="optimal")),
        ):
            ratio = other.certificate.worst(name)[0] if other else 0.0
            row.setdefault(way, []).append(
                {"ok": bool(other), "why": said(other), "ratio": ratio, "own": again(name, other)}
            )
    at = float(rng.uniform(0.2, 0.5) * own.duration)
    goal = own.trajectory(at) + 0.3 * rng.uniform(-1.0, 1.0, robot.n)
    new = retarget(own, at, robot.limits.clip(goal))
    row["retarget"] = {
        "status": str(new.status), "why": new.reason,
        "ratio": float(np.nanmax(new.certificate.peaks[name].ratio)) if new else 0.0, "own": again(name, new) if new else 0.0,
        "kept": new.status is RetargetStatus.KEPT,
    }  # fmt: skip
    return row


def judge(rows: list[Row]) -> list[Value]:
    held = [row for row in rows if not row["skipped"] and "at rest" not in row["optimal"]["why"]]
    values = [Value("motions of each limit that the box solves and that hold", "10", _counts(held), True)]
    for way in (*LAWS, "free", "avoid", "program", "stop", "replan"):
        tried, ok, most, failed = 0, 0, 0.0, []
        for row in held:
            found = row.get(way, [])
            for one in found if isinstance(found, list) else [found]:
                if not one.get("box", True) or (way == "avoid" and "at rest" in one["why"]):
                    continue  # the way around the obstacle tilts the goods
                tried += 1
                enforced = way != "quintic" and not (way == "toppra" and row["name"] in NOT_BY_TOPPRA)
                good = one["ok"] or (way == "constant_speed" and "m/s" in one["why"])
                ok += good
                most = max(most, one["own"] if enforced else 0.0)
                failed += [] if good else [f"{row['name']} {row['case']}: {one['why']}"]
        values.append(Value(f"{way}: certified, largest ratio found", "all, ≤ 1",
                            f"{ok} of {tried}, {most:.7f} {failed or ''}", ok == tried and most <= 1.0 + 2e-6))  # fmt: skip
    gains = [row["gain"] for row in held if row["name"] == "body_speed" and row.get("gain") is not None]
    words = f"{np.median(gains):.1%} in the median, {max(gains):.1%} at most, of {len(gains)}"
    values.append(
        Value("body_speed: free shapes shorter than the line in joint space", "≥ 2 %", words, np.median(gains) >= 0.02)
    )
    new = [(row["name"], row["retarget"]) for row in held if "retarget" in row]
    joined = [one for _, one in new if not one["kept"]]
    unsaid = [(name, one["why"]) for name, one in new if one["kept"] and name not in one["why"]]
    most = max(one["own"] for one in joined)
    values.append(Value("retarget: judged, or kept with the limit's name", "all",
                        f"{len(joined)} joined ({most:.7f}), {len(new) - len(joined)} kept, unsaid: {unsaid}",
                        most <= 1.0 + 2e-6 and not unsaid))  # fmt: skip
    return values


def _counts(rows: list[Row]) -> str:
    return ", ".join(f"{name} {sum(row['name'] == name for row in rows)}" for name in MEMBERS)


if __name__ == "__main__":
    main("limits_matrix", measure, MOTIONS * len(MEMBERS), judge)
