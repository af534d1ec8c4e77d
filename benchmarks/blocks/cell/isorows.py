"""Rows of cycles of ISO 9283, and the figures that are computed from them."""

from __future__ import annotations

import numpy as np
import polars as pl

from optik import se3
from optik.types import Array
from planners.cell.iso9283 import PathFigures, PoseFigures, path_figures, pose_figures

POSE_TEST, PATH_TEST = "pose", "path"
"""The two tests of the rows."""


def figures_of(rows: pl.DataFrame) -> list[PoseFigures | PathFigures]:
    """Figures of one entry: those of each pose, then those of the path."""
    done = rows.filter(pl.col("reached_x").is_not_null()).sort("cycle", "point")
    noise = bool(done["noise"].any())
    found: list[PoseFigures | PathFigures] = []
    for _, part in done.filter(pl.col("test") == POSE_TEST).group_by("point", maintain_order=True):
        found.append(pose_figures(_command(part), _reached(part), noise=noise))
    path = done.filter(pl.col("test") == PATH_TEST)
    if not path.is_empty():
        command = path.filter(pl.col("cycle") == path["cycle"][0]).select("x", "y", "z").to_numpy()
        met = path.select("reached_x", "reached_y", "reached_z").to_numpy().reshape(-1, len(command), 3)
        found.append(path_figures(command, met, noise=noise))
    return found


def _command(part: pl.DataFrame) -> Array:
    """The commanded pose of some rows, which is the same for all; its orientation is the frame of their rotations."""
    T = np.eye(4)
    T[:3, 3] = part.select("x", "y", "z").row(0)
    return T


def _reached(part: pl.DataFrame) -> Array:
    """The reached poses, their orientations relative to the commanded one, in the base frame."""
    poses = np.repeat(np.eye(4)[None], len(part), axis=0)
    poses[:, :3, 3] = part.select("reached_x", "reached_y", "reached_z").to_numpy()
    poses[:, :3, :3] = se3.exp_so3(part.select("turn_x", "turn_y", "turn_z").to_numpy())
    return poses
