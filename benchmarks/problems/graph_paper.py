"""Graph paper: targets on planar grids around the tool position of one fixed start, with the orientation of the start."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.problems.base import REFERENCE_RESTARTS, ProblemSet, searched, start_of
from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput
from optik.types import Array

BASE_AXES = {"X": 0, "Y": 1, "Z": 2}
"""Base axes by name."""


def graph_paper(
    robot: Robot, seed: int, *, start_deg: ArrayLike, normals: Sequence[str] = ("Y", "Z"),
    offsets_m: Sequence[float] = (0.0,), half_size_m: float = 0.5, spacing_m: float = 0.05,
    reference_restarts: int = REFERENCE_RESTARTS,
) -> ProblemSet:  # fmt: skip
    """Targets on planar grids through the workspace, as in the experiments of the paper.

    `searched` decides which targets have a known solution: `lm` with restarts and all branches of `closed_form`.

    Parameters
    ----------
    robot : Robot
        The arm.
    seed : int
        Not used: nothing is random.
    start_deg : (n,) array
        Start configuration of all problems; prismatic joints in millimetres [deg, mm].
    normals : sequence of str
        Normals of the planes, out of the base axes X, Y, Z.
    offsets_m : sequence of float
        Distances of the planes from the tool position at the start, along the normal [m].
    half_size_m, spacing_m : float
        Half the side of a grid, and the distance between its points [m].
    reference_restarts : int
        Restarts of `lm` in the search for a known solution.

    Returns
    -------
    ProblemSet
        The problems, grouped by plane.

    Raises
    ------
    InvalidInput
        A start outside the limits, a size or spacing that is not positive, or a normal that is not a base axis.
    """
    for normal in normals:
        if normal not in BASE_AXES:
            raise InvalidInput("normals", repr(normal), "X, Y or Z")
    check_number(half_size_m, "half_size_m", "metres above 0", above=0.0)
    check_number(spacing_m, "spacing_m", "metres above 0", above=0.0)
    q0 = start_of(robot, start_deg)
    targets, group = _grids(robot.fk(q0), normals, offsets_m, half_size_m, spacing_m)
    starts = np.tile(q0, (len(targets), 1))
    return searched(robot, np.array(targets), starts, np.array(group), restarts=reference_restarts)


def _grids(
    T0: Array, normals: Sequence[str], offsets_m: Sequence[float], half_size_m: float, spacing_m: float
) -> tuple[list[Array], list[str]]:
    """Return the target poses (4, 4) of all grid points around the pose T0, and the plane of each."""
    steps = round(half_size_m / spacing_m)
    whole, shifted = np.arange(-steps, steps + 1) * spacing_m, (np.arange(-steps, steps) + 0.5) * spacing_m
    targets, group = [], []
    for i, normal in enumerate(normals):
        across = [axis for axis in BASE_AXES if axis != normal]
        # offset by half a step along the normals of earlier planes, so that no point lies on two planes
        u_ticks, v_ticks = (shifted if axis in normals[:i] else whole for axis in across)
        for offset in offsets_m:
            name = f"{across[0]}–{across[1]} at {normal.lower()} {1e3 * offset:+.0f} mm"
            for u, v in product(u_ticks, v_ticks):
                T = T0.copy()
                T[[BASE_AXES[across[0]], BASE_AXES[across[1]], BASE_AXES[normal]], 3] += (u, v, offset)
                targets.append(T)
                group.append(name)
    return targets, group


METHOD = graph_paper
