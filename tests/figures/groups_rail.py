"""Lines of an arm on a slide, `slide.with_arm(arm)`, all over its travel: planned, and equal to the same chain from a URDF.

Oracle: the arm's URDF with a sliding joint written before it, read by Pinocchio (poses of the motion) and by optik (its plan
from the same configuration).
Measured: 40 of 40 (5 without the slide), poses within 1.7e-15, joint paths within 7.9e-15.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import optik
import planners
from optik import JointLimits, Robot, se3
from planners import Line, MotionLimits
from tests.figures.figure import Row, Value, main
from tests.figures.groups_clock import limited

LINES, TRAVEL = 40, 1.2
"""Number of lines, and how far the slide moves to either side [m]."""
ARMS = ("ur5e", "ur10e", "panda", "kr6")
ALONG_Y = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
"""A frame whose z axis is the y axis before."""


def slide() -> Robot:
    """A slide along y, with its plate 0.1 m above it."""
    limits = JointLimits([-TRAVEL], [TRAVEL], velocity=[1.0], acceleration=[4.0], jerk=[40.0])
    plate = se3.inverse(ALONG_Y) @ se3.pose(p=[0.0, 0.0, 0.1])
    return Robot("slide", ALONG_Y[None], np.array([True]), plate, limits, ("slide",))


def urdf(arm: Robot) -> str:
    """The URDF of the same chain, its first joint written by hand."""
    text = arm.with_base(se3.pose(p=[0.0, 0.0, 0.1])).to_urdf()
    root = next(model.frames[1].name for model in [pin.buildModelFromXML(text)])
    joint = (
        f'<link name="floor"/><joint name="slide" type="prismatic"><parent link="floor"/><child link="{root}"/>'
        f'<axis xyz="0 1 0"/><limit lower="{-TRAVEL}" upper="{TRAVEL}" velocity="1" effort="0"/></joint></robot>'
    )
    return text.replace("</robot>", joint)


def measure(case: int) -> Row:
    rng, name = np.random.default_rng([case, 584]), ARMS[case % len(ARMS)]
    arm = limited(name)
    robot, text = slide().with_arm(arm), urdf(arm)
    model = pin.buildModelFromXML(text)
    other = Robot.from_urdf(text, tip="tool").with_limits(
        velocity=robot.limits.velocity, acceleration=robot.limits.acceleration, jerk=robot.limits.jerk
    )
    data, tool, line = model.createData(), model.getFrameId("tool"), None
    while line is None:
        q = np.append(rng.uniform(-1.0, 1.0), arm.limits.clip(rng.uniform(-2.0, 2.0, arm.n)))
        T, length = robot.fk(q), rng.uniform(0.5, 2.0) * rng.choice((-1.0, 1.0))
        goal = T.copy()
        goal[:3, 3] += [rng.uniform(-0.1, 0.1), length, rng.uniform(-0.1, 0.1)]
        joints = q + np.eye(robot.n)[0] * length  # the slide alone brings the tool near the goal
        if abs(joints[0]) < TRAVEL and optik.solve_ik(robot, goal, joints):
            line = Line(T, goal)
    limits = MotionLimits(robot.limits.velocity, robot.limits.acceleration, robot.limits.jerk)
    found = planners.plan(robot, line)
    row: Row = {"arm": name, "length": line.end, "solved": bool(found), "alone": bool(planners.plan(arm, line))}
    if not found:
        return row | {"why": str(found.failure)[:300]}
    first, same = (planners.plan(one, line, found.trajectory(0.0), limits=limits) for one in (robot, other))
    t, off = np.linspace(0.0, found.duration, 300), 0.0
    for q, T in zip(found.trajectory(t), robot.fk(found.trajectory(t)), strict=True):
        pin.framesForwardKinematics(model, data, q)
        off = max(off, float(np.abs(data.oMf[tool].homogeneous - T).max()))
    s = np.linspace(0.0, line.end, 200)
    row |= {
        "off": off,
        "T": found.duration,
        "between": abs(first.duration - same.duration),
        "again": bool(first) and bool(same),
    }
    return row | {"joints": float(np.abs(first.joint_path(s) - same.joint_path(s)).max())}


def judge(rows: list[Row]) -> list[Value]:
    done = [row for row in rows if row["solved"]]
    off, between, joints = (max(row[key] for row in done) for key in ("off", "between", "joints"))
    alone = sum(row["alone"] for row in rows)
    return [
        Value("solved", "all", f"{len(done)} of {len(rows)}, {alone} without the slide", len(done) == len(rows)),
        Value("poses less those of Pinocchio", "1e-12", f"{off:.2g}", off <= 1e-12),
        Value("joint paths from one start less those of the URDF", "1e-12", f"{joints:.2g}", joints <= 1e-12),
        Value("durations of these [s]", "shown", f"{between:.2g}", True),
    ]


if __name__ == "__main__":
    main("groups_rail", measure, LINES, judge)
