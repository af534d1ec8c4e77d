"""Robots by name, one TOML file each, and robots from files: TOML, URDF, JSON or Python."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Mapping
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from optik import se3
from optik.arm.limits import JointLimits
from optik.arm.robot import Robot
from optik.arm.tables import DHRow
from optik.errors import InvalidInput
from optik.plugins.files import is_path, split_links
from optik.plugins.used import file_of
from optik.registry import data_file, load_method, own_names
from optik.types import Array

DEGREE = pi / 180.0
ROBOTS = "optik.robots"
"""Group of the robots."""
URDF = (".urdf", ".xml")
"""Suffixes of URDF files."""


def load(name: str | os.PathLike[str], *, tip: str | None = None, base: str | None = None) -> Robot:
    """Load a robot by name, or from a file that is given as a path.

    Parameters
    ----------
    name : str or path
        A name from `optik.robots()`; or the path of a TOML file as those in ``optik/robots``, of a URDF, of a JSON file with
        what `Robot.to_dict` returns, or of a Python file whose ``METHOD`` is a robot or returns one (it is run). The links
        of a URDF can stand behind its path: ``"./arm.urdf#tip=tool0&base=base_link"``.
    tip, base : str, optional
        For a URDF, the links of `Robot.from_urdf`.

    Returns
    -------
    Robot
        The arm.

    Raises
    ------
    UnknownName
        No such robot; the nearest names are offered.
    InvalidInput
        No such file, one that holds no robot, or a link asked of what is no URDF.
    RobotModelError
        As `Robot.from_urdf`.
    """
    if is_path(name):
        path, links = split_links(os.fspath(name))
        return _from_file(path, {**_links(links), **{k: v for k, v in (("tip", tip), ("base", base)) if v is not None}})
    if tip is not None or base is not None:
        raise InvalidInput("tip" if tip is not None else "base", repr(tip or base), f"none: {name!r} is no URDF file")
    if name in own_names(ROBOTS):
        return robot_from_toml(data_file(ROBOTS, name, "robot"))
    return _robot_of(load_method(ROBOTS, name, "robot"), f"robot {name!r}")


def _from_file(path: str, links: dict[str, str]) -> Robot:
    suffix = Path(path).suffix.lower()
    if suffix in URDF:  # it says its robot's own name, so its file may be called as one of ours is
        return Robot.from_urdf(file_of(path, "robot"), **links)
    if links:
        raise InvalidInput(", ".join(links), ", ".join(links.values()), f"none: {path!r} is no URDF file")
    if suffix == ".py":
        return _robot_of(load_method(ROBOTS, path, "robot"), f"METHOD of {path}")
    file = data_file(ROBOTS, path, "robot")
    if suffix == ".json":
        try:
            return Robot.from_dict(json.loads(file.read_text(encoding="utf-8")))
        except (OSError, ValueError, RecursionError) as error:
            if isinstance(error, InvalidInput):
                raise
            raise InvalidInput(f"robot {path!r}", str(error)[:120], "JSON of Robot.to_dict()") from None
    if suffix != ".toml":
        raise InvalidInput("robot", repr(path), "a file that ends in .toml, .urdf, .json or .py")
    return robot_from_toml(file)


def _links(text: str) -> dict[str, str]:
    """Links behind a URDF's path, ``tip=tool0&base=base_link``."""
    links = dict(part.partition("=")[::2] for part in text.split("&")) if text else {}
    if not set(links) <= {"tip", "base"} or not all(links.values()):
        raise InvalidInput("robot", repr(text), "links of a URDF: tip=LINK, base=LINK or tip=LINK&base=LINK")
    return links


def _robot_of(value: Any, where: str) -> Robot:
    """Robot of a plug-in: a robot, what returns one, or the path of its file."""
    if isinstance(value, str | os.PathLike):
        return _from_file(os.fspath(value), {})
    robot = value() if callable(value) and not isinstance(value, Robot | type) else value
    if not isinstance(robot, Robot):
        raise InvalidInput(where, repr(robot)[:60], "a Robot, a function that returns one, or the path of its file")
    return robot


def robot_from_toml(file: Path) -> Robot:
    """Read a robot from a TOML file such as those in ``optik/robots``; the file's stem is its name.

    Parameters
    ----------
    file : Path
        The file.

    Returns
    -------
    Robot
        The arm.

    Raises
    ------
    InvalidInput
        No TOML, or a key that is missing.
    RobotModelError
        Rows that are no serial arm.
    """
    try:
        with file.open("rb") as opened:
            return _from_table(tomllib.load(opened), file.stem)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInput(f"robot {file.name}", str(error), "a TOML file") from None
    except KeyError as error:
        raise InvalidInput(
            f"robot {file.name}", f"no {error.args[0]}", "the keys of the robots in optik/robots"
        ) from None


def _from_table(data: Mapping[str, Any], name: str) -> Robot:
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
