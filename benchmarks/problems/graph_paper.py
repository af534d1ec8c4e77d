"""Graph paper: targets on planes around the tool's position at one fixed start, at the start's orientation."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.problems.base import ProblemSet, start_of
from optik.arm.robot import Robot
from optik.check import check_number
from optik.errors import InvalidInput
from optik.ik.dls import DLS

AXES = {"X": 0, "Y": 1, "Z": 2}


def graph_paper(
    robot: Robot,
    seed: int,
    *,
    start_deg: ArrayLike,
    normals: Sequence[str] = ("Y", "Z"),
    offsets_m: Sequence[float] = (0.0,),
    half_size_m: float = 0.5,
    spacing_m: float = 0.05,
    reference_restarts: int = 15,
) -> ProblemSet:
    """Targets on sheets of graph paper, as the paper measures its arm.

    Whether a target has a solution is found by a reference solve with restarts, the same for every method compared.

    Parameters
    ----------
    robot : Robot
        The arm.
    seed : int
        Not used: nothing is drawn.
    start_deg : (n,) array
        The one start configuration [degrees].
    normals : sequence of str
        Base axes (X, Y, Z) that the sheets stand perpendicular to.
    offsets_m : sequence of float
        Distances of the sheets from the tool's position at the start, along the normal [m].
    half_size_m, spacing_m : float
        Half the side of a sheet, and the distance between its points [m].
    reference_restarts : int
        Starts after the first that the reference solve may take.
    """
    check_number(half_size_m, "half_size_m", "metres above 0", above=0.0)
    check_number(spacing_m, "spacing_m", "metres above 0", above=0.0)
    q0 = start_of(robot, start_deg)
    T0 = robot.fk(q0)
    steps = round(half_size_m / spacing_m)
    whole, shifted = np.arange(-steps, steps + 1) * spacing_m, (np.arange(-steps, steps) + 0.5) * spacing_m
    targets, group = [], []
    for i, normal in enumerate(normals):
        if normal not in AXES:
            raise InvalidInput("normals", repr(normal), "X, Y or Z")
        across = [axis for axis in AXES if axis != normal]
        # half a step aside along the normals of earlier sheets, so that no point lies on two of them
        u_ticks, v_ticks = (shifted if axis in normals[:i] else whole for axis in across)
        for offset in offsets_m:
            name = f"{across[0]}–{across[1]} at {normal.lower()} {1e3 * offset:+.0f} mm"
            for u, v in product(u_ticks, v_ticks):
                T = T0.copy()
                T[[AXES[across[0]], AXES[across[1]], AXES[normal]], 3] += (u, v, offset)
                targets.append(T)
                group.append(name)
    reference: Any = DLS(robot, max_iterations=40, max_restarts=reference_restarts)
    answers = [reference.solve(T, q0) for T in targets]
    known = np.array([bool(a) for a in answers])
    sigma = np.where(known, robot.singular_values([a.q for a in answers])[:, -1], np.nan)
    k = len(targets)
    return ProblemSet(np.array(targets), np.tile(q0, (k, 1)), np.array(group), known, sigma, np.full(k, np.nan))


METHOD = graph_paper
