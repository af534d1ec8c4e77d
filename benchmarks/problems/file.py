"""A user's own poses, from a CSV or NPZ file, with or without start configurations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.problems import base
from benchmarks.problems.base import REFERENCE_RESTARTS, ProblemSet, check_starts, name_with_kind, searched, start_of
from benchmarks.problems.tables import Poses, read_poses
from optik.arm.robot import Robot
from optik.types import Array

FREE_STARTS = ("random", "zero")
"""Kinds of starts that need no known solution."""


def file(
    robot: Robot, seed: int, *, path: str, starts: str | Sequence[str] | None = None,
    start_deg: ArrayLike | None = None, reference_restarts: int = REFERENCE_RESTARTS,
) -> ProblemSet:  # fmt: skip
    """Targets from a file: the poses of an application.

    A CSV file has a header and one row for each target: ``x_m, y_m, z_m`` [m], the rotation as ``qw, qx, qy, qz`` or as
    ``r11, r12 … r33`` [1], and perhaps the start as ``q1_rad … qn_rad`` (``q3_m`` for a prismatic joint) and ``group``.
    An NPZ file has ``targets`` (k, 4, 4) [1, m], and perhaps ``starts`` (k, n) [rad, m] and ``group`` (k,).
    Whether a target is reachable is decided by `lm` with restarts and all branches of `closed_form`.

    Parameters
    ----------
    robot : Robot
        The arm.
    seed : int
        Seed of random starts.
    path : str
        The file, ``.csv`` or ``.npz``; relative to the folder of the suite.
    starts : str or sequence of str, optional
        Starts for all targets in place of those in the file: random (the default where the file has none) or zero.
    start_deg : (n,) array, optional
        One start for all targets instead; prismatic joints in millimetres [deg, mm].
    reference_restarts : int
        Restarts of `lm` in the search for a known solution.

    Returns
    -------
    ProblemSet
        The problems in the order of the file.

    Raises
    ------
    InvalidInput
        A file that cannot be read, has no targets or a wrong value, which the message names with its row and column.
    """
    poses = read_poses(Path(path), robot)
    if poses.starts is not None and starts is None and start_deg is None:
        return searched(robot, poses.targets, poses.starts, poses.group, restarts=reference_restarts)
    kinds = check_starts(starts, start_deg, FREE_STARTS)
    first = np.concatenate([_starts(robot, seed, kind, poses, start_deg) for kind in kinds])
    targets = np.tile(poses.targets, (len(kinds), 1, 1))
    group: NDArray[np.str_] = np.array([name_with_kind(str(g), kind, kinds) for kind in kinds for g in poses.group])
    return searched(robot, targets, first, group, restarts=reference_restarts)


def _starts(robot: Robot, seed: int, kind: str, poses: Poses, start_deg: ArrayLike | None) -> Array:
    """Return the starts (k, n) of one kind."""
    k = len(poses.targets)
    if start_deg is not None:
        return np.tile(start_of(robot, start_deg), (k, 1))
    return base.start_configurations(
        robot.limits, base.random_stream(seed, "file", kind), np.zeros((k, robot.n)), kind, 1.0
    )


METHOD = file
