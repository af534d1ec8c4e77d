"""Random seams on tables with one and two axes, by four arms: as given, with the redundancy of the group, and on fixed tables.

Oracle: Pinocchio's trees of arm and table (residual to the seam at 400 instants), and the polynomials at 20 kHz for the limits.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

import optik
import planners
from optik import Group, JointLimits, Robot, se3
from planners import Arc, Line, Path, Spline
from tests.figures.figure import Row, Value, main
from tests.planners.chains import draw_seam

ARMS = {
    "ur10e": ((0.85, 0.0, 0.25), 1.0),
    "ur5e": ((0.6, 0.0, 0.15), 0.75),
    "kr6": ((0.6, 0.0, 0.2), 0.75),
    "irb120": ((0.42, 0.0, 0.15), 0.5),
}
TORCH = se3.pose(Rotation.from_euler("y", 40, degrees=True).as_matrix(), [0.05, 0.0, 0.3])
AXIS = np.array([[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])


def table(at: tuple[float, ...], axes: int) -> Robot:
    """A table that turns about z, and with two axes tilts about x before."""
    fixed, up = [se3.pose(p=at) @ AXIS, se3.inverse(AXIS)], se3.pose(p=[0.0, 0.0, 0.05])
    rows = [("tilt", 1.5707963, 1.5, 3.0, 30.0), ("turn", 12.566, 2.5, 5.0, 50.0)][2 - axes :]
    names, ends, *rates = zip(*rows, strict=True)
    limits = JointLimits(
        -np.array(ends), np.array(ends), **dict(zip(("velocity", "acceleration", "jerk"), rates, strict=True))
    )
    fixed = fixed if axes == 2 else [fixed[0] @ fixed[1]]
    return Robot("table", np.array(fixed), np.zeros(axes, bool), up, limits, names)


def make_group(name: str, axes: int) -> Group:
    arm, (at, _) = optik.load(name).with_tool(TORCH, add=True), ARMS[name]
    rates = {"acceleration": np.full(arm.n, 10.0), "jerk": np.full(arm.n, 100.0)}
    return Group(arm=arm.with_limits(velocity=np.minimum(2.0, arm.limits.velocity), **rates), table=table(at, axes))


def moved(path: Path, T: Any) -> Path:
    """The seam in the world, on a table that stands still."""
    if isinstance(path, Line):
        return Line(T @ path.pose(0.0), T @ path.pose(path.end))
    if isinstance(path, Arc):
        data = path.to_dict()
        centre, axis = T[:3, :3] @ np.array(data["centre"]) + T[:3, 3], T[:3, :3] @ np.array(data["axis"])
        return Arc.about(T @ path.pose(0.0), centre, axis, data["angle"], orientation="arc")
    return Spline(T @ path.pose(np.linspace(0.0, path.end, 25)))


def judge_plan(group: Group, found: Any, path: Path) -> tuple[float, float]:
    """The largest residual to the seam, and the largest ratio to a limit of a joint."""
    models = [pin.buildModelFromXML(robot.to_urdf()) for robot in group.members.values()]
    trees, poses = [(model, model.createData(), model.getFrameId("tool")) for model in models], []
    for q in found.trajectory(np.linspace(0.0, found.duration, 400)):
        each = []
        for (model, data, tool), joints in zip(trees, group.split(q).values(), strict=True):
            pin.framesForwardKinematics(model, data, np.ascontiguousarray(joints))
            each.append(data.oMf[tool].copy())
        poses.append((each[1].inverse() * each[0]).homogeneous)
    off = se3.error(np.array(poses), path.pose(path.nearest(np.array(poses))))
    t = np.arange(0.0, found.duration, 5e-5)
    most = max(
        float((np.abs(found.trajectory(t, k + 1)) / getattr(group.limits, name)).max())
        for k, name in enumerate(("velocity", "acceleration", "jerk"))
    )
    return float(np.linalg.norm(off[:, :3], axis=1).max()), most


def measure(case: int) -> Row:
    name, axes = list(ARMS)[case % 4], 2 - (case // 4) % 2
    group, path = make_group(name, axes), draw_seam(np.random.default_rng([case, 58]), ARMS[name][1])
    row: Row = {"arm": name, "axes": axes}
    fixed = []
    for k in range(8):
        still = np.zeros(axes)
        still[-1] = k * np.pi / 4
        found = planners.plan(group.members["arm"], moved(path, group.members["table"].fk(still)))
        fixed += [found.duration] if found else []
    row["fixed"] = min(fixed, default=None)
    for kind, one in (("given", path), ("elbow", planners.free(path, elbow=True))):
        began = time.process_time()
        found = planners.plan(group, one, tool="arm", frame="table")
        row[f"{kind}_cpu"], row[kind] = time.process_time() - began, found.duration if found else None
        if found:
            row[f"{kind}_off"], row[f"{kind}_most"] = judge_plan(group, found, path)
        else:
            row[f"{kind}_why"] = found.failure.reason[:150]
    return row


def judge(rows: list[Row]) -> list[Value]:
    out = []
    for kind in ("given", "elbow"):
        done = [row for row in rows if row[kind]]
        pairs = [row[kind] / row["fixed"] for row in done if row["fixed"]]
        off, most = (max(row[f"{kind}_{what}"] for row in done) for what in ("off", "most"))
        out.append(Value(f"{kind}: solved", "99 %", f"{len(done)} of {len(rows)}", len(done) >= 0.99 * len(rows)))
        out.append(
            Value(
                f"{kind}: residual [m], limits", "1e-8, 1", f"{off:.3g}, {most:.9f}", off <= 1e-8 and most <= 1.0 + 1e-9
            )
        )
        if kind == "given":
            out.append(
                Value(
                    "given: T over best of 8 fixed, median",
                    "1",
                    f"{np.median(pairs):.3f} of {len(pairs)}",
                    np.median(pairs) <= 1.0 + 1e-6,
                )
            )
        else:
            out.append(Value("elbow: T over best of 8 fixed, largest", "1.01", f"{max(pairs):.3f}", max(pairs) <= 1.01))
    ratio = np.median([row["elbow_cpu"] / row["given_cpu"] for row in rows if row["given"] and row["elbow"]])
    out.append(Value("elbow: CPU over that of the seam as given, median", "4", f"{ratio:.2f}", ratio <= 4.0))
    return out


if __name__ == "__main__":
    main("groups_seams", measure, 100, judge)
