"""Two arms carry a bar of 4 kg with torque limits of 0.55 of the rated ones, whichever share of it each of them bears.

Oracle: Pinocchio's inverse dynamics of each arm without a payload, with the share of the bar added to its last body, at both
ends of the interval of shares and at five values between.
Measured: 36 solved, 0 torques above (most 0.9999997); one duration 1.067 times that without the limits, where gravity alone
takes 0.94 of a limit and TOPP-RA without jerk needs 1.072; all heavy bars refused with joint and torque.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

import planners
from optik import Robot
from planners import MotionLimits
from tests.figures.figure import Row, Value, main
from tests.figures.groups_carry import BAR, draw, make_group

MASS, FRACTION, RATED = 4.0, (0.4, 0.6), 0.55 * np.array([150.0, 150.0, 150.0, 28.0, 28.0, 28.0])
INERTIA = MASS / 12.0 * np.diag([0.02, BAR**2, BAR**2]) + 1e-3 * np.eye(3)
GRAVITY, TOO_HEAVY, RATE, MOST, CARRIES = 9.80665, 25.0, 2000.0, 1.02, 36


def peak(arm: Robot, moved: Any, share: float) -> float:
    """The largest torque over its limit of an arm that bears a share of the bar, at `RATE`."""
    model = pin.buildModelFromXML(arm.to_urdf())
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY])
    frame = model.frames[model.getFrameId("tool")]
    inertias = model.inertias
    inertias[frame.parentJoint] += frame.placement.act(pin.Inertia(share * MASS, np.zeros(3), share * INERTIA))
    data, most = model.createData(), 0.0
    t = np.linspace(0.0, moved.duration, int(RATE * moved.duration) + 2)
    for q, v, a in zip(moved(t), moved(t, 1), moved(t, 2), strict=True):
        most = max(most, float((np.abs(pin.rnea(model, data, q, v, a)) / RATED).max()))
    return most


def measure(case: int) -> Row:
    rng, usual = np.random.default_rng([case, 583]), make_group("ur5e")
    group = usual.with_payload(MASS, inertia=INERTIA, fraction=FRACTION)
    both = {"tool": ("left", "right")}
    while not (first := planners.plan(usual, path := draw(rng), **both)):
        pass
    limits = {name: MotionLimits.of(robot, torque=RATED) for name, robot in group.members.items()}
    found = planners.plan(group, path, **both, limits=limits)
    row: Row = {"solved": bool(found), "free": first.duration}
    shares = np.linspace(*FRACTION, 7)
    if not found:
        return row | {"why": f"{found.failure.joint}: {found.failure.reason}"[:200]}
    each = {
        name: [peak(robot, found.members[name].trajectory, x) for x in shares] for name, robot in usual.members.items()
    }
    kinds = [found.certificate.extra[f"{name}.torque"].ratio for name in group.members]
    row |= {"T": found.duration, "seen": max(map(max, each.values())), "proved": float(np.nanmax(kinds))}
    row["before"] = max(
        peak(robot, first.members[name].trajectory, x) for name, robot in usual.members.items() for x in FRACTION
    )
    if found.duration > MOST * first.duration:
        slower = [
            planners.plan(one, path, **both, timing="toppra", allow="jerk", limits=given).duration
            for one, given in ((usual, None), (group, limits))
        ]
        row["toppra"] = slower[1] / slower[0]
    heavy = usual.with_payload(TOO_HEAVY, fraction=FRACTION)
    limits = {name: MotionLimits.of(robot, torque=RATED) for name, robot in heavy.members.items()}
    refused = planners.plan(heavy, path, **both, limits=limits)
    row["refused"] = "" if refused else f"{refused.failure.joint}: {refused.failure.reason}"
    return row


def judge(rows: list[Row]) -> list[Value]:
    done = [row for row in rows if row["solved"]]
    ratio = [row["T"] / row["free"] for row in done]
    over = [
        f"{row['T'] / row['free']:.3f} (TOPP-RA without jerk: {row['toppra']:.3f})" for row in done if "toppra" in row
    ]
    above, beyond = sum(row["seen"] > 1.0 for row in done), max(row["seen"] - row["proved"] for row in done)
    named = sum("joint" in row["refused"] and "N·m" in row["refused"] for row in done)
    active = sum(row["before"] > 1.0 for row in done)
    return [
        Value("solved", "all", f"{len(done)} of {len(rows)}, {active} exceed the limits without them", len(done) == len(rows)),
        Value(f"T at most {MOST} times that without torque limits", "all", f"all but {', '.join(over) or 'none'}", not over),
        Value("T over that without torque limits, median", "shown", f"{np.median(ratio):.6f}", True),
        Value("motions with a torque above its limit", "0", f"{above}, most {max(row['seen'] for row in done):.9f}", not above),
        Value("seen less proved", "≤ 0", f"{beyond:.2g}", beyond <= 1e-9),
        Value(f"a bar of {TOO_HEAVY:g} kg refused with joint and torque", "all", f"{named} of {len(done)}", named == len(done)),
    ]  # fmt: skip


if __name__ == "__main__":
    main("groups_torque", measure, CARRIES, judge)
