"""Where the repository is, and its robots' tables by a reader of their own."""

import tomllib
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.oracles.arms import Arm, Row

REPOSITORY = Path(__file__).resolve().parents[2]


def table(name: str) -> Arm:
    """Read a robot's TOML file in optik/robots."""
    data = tomllib.loads((REPOSITORY / "optik" / "robots" / f"{name}.toml").read_text(encoding="utf-8"))
    rows = tuple(
        Row(
            a=j.get("a_mm", 0.0) / 1000.0,
            alpha=j.get("alpha_deg", 0.0) * pi / 180.0,
            d=j.get("d_mm", 0.0) / 1000.0,
            theta=j.get("theta_deg", 0.0) * pi / 180.0,
            prismatic=j.get("type", "revolute") == "prismatic",
        )
        for j in data["joints"]
    )
    unit = {"range_deg": pi / 180.0, "range_rad": 1.0, "range_mm": 0.001}
    ranges = np.array([next(np.array(j[k]) * unit[k] for k in unit if k in j) for j in data["joints"]])
    return Arm(data["convention"], rows, _placed(data, "base"), _placed(data, "tool"), ranges[:, 0], ranges[:, 1])


def _placed(data: Any, which: str) -> NDArray[np.float64]:
    """A base or tool pose of a robot's file, its rotation by SciPy: x, then y, then z, about axes that stand still."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", data.get(which, {}).get("rpy_deg", (0, 0, 0)), degrees=True).as_matrix()
    T[:3, 3] = np.array(data.get(which, {}).get("xyz_mm", (0, 0, 0))) / 1000.0
    return T
