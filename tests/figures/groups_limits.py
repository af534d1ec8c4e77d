"""Limits of an arm beside a moving table: container, tray, grip, torques and v(q), each active.

Oracle: the arm's own columns of the motion, cut out here and certified alone. The arm stands on a tilted base. Every second
case with torques or v(q) follows a seam on the table.
Measured: ratios equal to the last bit, 100 of 100 valid, least ratio 0.971.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import PPoly

import planners
from optik import Group, Robot, se3
from optik.arm.limits import VelocityByPosition
from planners import MotionLimits
from planners.limits import Grip, OpenContainer, Tray
from planners.trajectory import Trajectory
from tests.figures.figure import Row, Value, main
from tests.figures.groups_clock import limited
from tests.figures.groups_seams import ARMS, TORCH, table
from tests.planners.chains import draw_seam

KINDS = ("open_container", "tray", "grip", "torque", "velocity_by_position")
ACTIVE, OF_KIND = 0.97, 20
"""Least ratio of a limit that is active; motions of each kind."""


def peak(certificate: Any, name: str) -> Any:
    """The ratios to a limit."""
    return (certificate.extra[name] if name in certificate.extra else getattr(certificate, name)).ratio


def upright(rng: np.random.Generator, arm: Robot, q: Any, kind: str) -> dict[str, Any]:
    """A limit on goods that stand at a configuration."""
    up = se3.inverse(arm.fk(q))[:3, :3] @ (0.0, 0.0, 1.0)
    axis: tuple[float, float, float] = tuple(up)
    if kind == "open_container":
        return {kind: OpenContainer(rng.uniform(0.2, 0.4), axis=axis)}
    if kind == "tray":
        return {kind: Tray(friction=rng.uniform(0.2, 0.4), slenderness=rng.uniform(1.0, 4.0), axis=axis)}
    across = np.cross(up, rng.normal(size=3))
    return {kind: Grip(0.5, rng.uniform(1.1, 1.4) * 9.81, 1.0, axis=tuple(across / np.linalg.norm(across)))}


def plan_one(rng: np.random.Generator, kind: str, seam: bool) -> tuple[Any, MotionLimits]:
    """The plan of a drawn arm and table with a limit, and the limits of the arm."""
    name = ("ur5e", "ur10e")[int(rng.integers(2))]
    base = se3.pose(se3.exp_so3(rng.uniform(-0.3, 0.3, 3)), rng.uniform(-0.05, 0.05, 3))
    arm = limited(name).with_base(base).with_payload(rng.uniform(0.5, 3.0), com=(0.0, 0.0, 0.05))
    group = Group(arm=arm.with_tool(TORCH, add=True) if seam else arm, table=table(ARMS[name][0], 2))
    arm, start = group.members["arm"], rng.uniform(-2.5, 2.5, arm.n)
    turned = rng.uniform(-0.15, 0.15, arm.n) + rng.choice((-1.0, 1.0)) * np.eye(arm.n)[0] * rng.uniform(0.5, 1.5)
    still, way = (start, np.zeros(2)), {"arm": start + turned, "table": rng.uniform((-1.0, -3.0), (1.0, 3.0))}
    asked: Any = (draw_seam(rng, ARMS[name][1]),) if seam else (way, dict(zip(("arm", "table"), still, strict=True)))
    words = {"tool": "arm", "frame": "table"} if seam else {}
    usual = planners.plan(group, *asked, **words)
    if not usual:
        return usual, MotionLimits()
    own = group.split(usual.trajectory(np.linspace(0.0, usual.duration, 100)))["arm"]
    if kind == "torque":
        weight = np.abs(arm.gravity_torques(own) / arm.limits.torque).max()
        most = 0.5 * (weight + np.nanmax(peak(usual.certificate, "arm.torque")))
        extra: dict[str, Any] = {kind: most * arm.limits.torque}
    elif kind == "velocity_by_position":
        room = np.minimum(own - arm.limits.lower, arm.limits.upper - own).min(axis=0)
        fast = np.abs(usual.trajectory(np.linspace(0.0, usual.duration, 100), 1))[:, group.columns("arm")].max(axis=0)
        extra = {kind: VelocityByPosition(np.full(arm.n, 0.01), (0.7 * fast + 0.05) ** 2 / (2.0 * room))}
    else:
        extra = upright(rng, arm, start + 0.5 * turned, kind)
    limits = MotionLimits.of(arm, **extra)
    return planners.plan(group, *asked, **words, limits={"arm": limits}), limits


def measure(case: int) -> Row:
    rng, kind, drawn = np.random.default_rng([case, 582]), KINDS[case % len(KINDS)], 0
    name, seam = f"arm.{kind}", case % len(KINDS) > 2 and case // len(KINDS) % 2 == 1
    row: Row = {"kind": kind, "seam": seam}
    while True:
        drawn += 1
        found, limits = plan_one(rng, kind, seam)
        if found and np.nanmax(peak(found.certificate, name)) > ACTIVE:
            break
    columns = found.group.columns("arm")
    cut = Trajectory(PPoly(found.trajectory.padded[:, :, columns], found.trajectory.knots))
    alone = planners.certify(found.group.members["arm"], None, cut, limits)
    ratios = [np.atleast_1d(peak(one, key)) for one, key in ((found.certificate, name), (alone, kind))]
    off = float(np.nanmax(np.abs(ratios[0] - ratios[1])))
    valid = alone.is_valid and all(motion.certificate.is_valid for motion in found.members.values())
    return row | {"drawn": drawn, "off": off, "most": float(np.nanmax(ratios[0])), "valid": bool(valid)}


def judge(rows: list[Row]) -> list[Value]:
    out = []
    for kind in KINDS:
        some = [row for row in rows if row["kind"] == kind]
        off, valid = max(row["off"] for row in some), sum(row["valid"] for row in some)
        words = f"{valid} of {len(some)}, least ratio {min(row['most'] for row in some):.4f}"
        out.append(Value(f"{kind}: ratio less that of the arm alone", "1e-9", f"{off:.2g}", off <= 1e-9))
        out.append(Value(f"{kind}: valid and active", "all", words, valid == len(some)))
    return out


if __name__ == "__main__":
    main("groups_limits", measure, OF_KIND * len(KINDS), judge)
