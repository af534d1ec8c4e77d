"""The robots that come with optik, by name: one TOML file each."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from math import pi
from typing import Any

import numpy as np

from optik import se3
from optik.arm.limits import JointLimits
from optik.arm.robot import Robot
from optik.arm.tables import DHRow
from optik.registry import data_file
from optik.types import Array

DEGREE = pi / 180.0


def load(name: str) -> Robot:
    """Load a robot that comes with optik, by name.

    Raises
    ------
    UnknownName
        No such robot; the nearest names are offered.
    """
    with data_file("optik.robots", name, "robot").open("rb") as file:
        data = tomllib.load(file)
    joints = data["joints"]
    rows = [_row(joint) for joint in joints]
    ranges = np.array([_range(joint) for joint in joints])
    dynamic = {
        k: np.broadcast_to(np.asarray(v, float), (len(rows),)) for k, v in data.get("dynamic_limits", {}).items()
    }
    if all("speed_deg" in j or "speed_mm" in j for j in joints):
        dynamic["velocity"] = np.array(
            [j["speed_mm"] / 1000.0 if "speed_mm" in j else j["speed_deg"] * DEGREE for j in joints]
        )
    build = {"mdh": Robot.from_mdh, "dh": Robot.from_dh}[data["convention"]]
    return build(
        rows,
        JointLimits(ranges[:, 0], ranges[:, 1], **dynamic),
        name=name,
        base=_placed(data.get("base", {})),
        tool=_placed(data.get("tool", {})),
        gravity=data.get("gravity", (0.0, 0.0, -1.0)),
        source=data["source"],
    )


def _row(joint: Mapping[str, Any]) -> DHRow:
    return DHRow(
        a=joint.get("a_mm", 0.0) / 1000.0,
        alpha=joint.get("alpha_deg", 0.0) * DEGREE,
        d=joint.get("d_mm", 0.0) / 1000.0,
        theta=joint.get("theta_deg", 0.0) * DEGREE,
        prismatic=joint.get("type") == "prismatic",
    )


def _range(joint: Mapping[str, Any]) -> Array:
    """Position limits (2,) [rad or m], written in degrees, radians or millimetres."""
    for unit, scale in (("range_deg", DEGREE), ("range_rad", 1.0), ("range_mm", 1e-3)):
        if unit in joint:
            return np.array(joint[unit]) * scale
    raise KeyError("range_deg, range_rad or range_mm")


def _placed(pose: Mapping[str, Any]) -> Array:
    xyz = np.array(pose.get("xyz_mm", (0.0, 0.0, 0.0))) / 1000.0
    return se3.from_xyz_rpy(xyz, pose.get("rpy_deg", (0.0, 0.0, 0.0)))
