"""Resolution of a whole path: sequences of configurations along it, among all that an arm and the path's freedoms have."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import NamedTuple

import numpy as np

from optik import se3
from optik.types import Array
from planners.following.failure import ASKED, FollowStatus, PlanFailure
from planners.following.resolve.graph import MOST_WORK, Graph, Sampler, Sequence
from planners.paths.base import Path

PER_METRE, PER_RADIAN, DENSE = 1.0 / 0.05, 1.0 / 0.15, 2000
"""Layers per metre and per radian of the tool's motion, and points at which it is measured."""
FEW, MANY = (24, 24), (48, 100)
"""Least and most intervals between layers, at first and where these have no answer."""
FEW_DRAWS, MANY_DRAWS = 40, 75
"""Random guesses of each layer, at first and later."""
EXPLAINING_DRAWS = 200
"""Random guesses by which a refusal is explained."""
FINEST = 1.0 / 2000.0
"""Least distance of layers, as a fraction of the path."""


class Resolution(NamedTuple):
    """How a whole path was resolved.

    Attributes
    ----------
    layers, nodes, inserted, rounds : int
        Positions along the path, configurations there, positions that were inserted, and rounds of the search.
    seconds : float
        Computing time [s].
    stuck : (2,) tuple of float, or None
        Positions between which no configuration continues [m, or rad].
    cuts : tuple of float
        Positions of reconfigurations [m, or rad].
    reason : str
        Why no configuration continues.
    reached : bool
        Whether configurations were found there.
    limited : bool
        Whether the search ended by its ``time_limit``: with a larger one, or on a faster computer, more may be found.
    """

    layers: int
    nodes: int
    inserted: int
    rounds: int
    seconds: float
    stuck: tuple[float, float] | None = None
    cuts: tuple[float, ...] = ()
    reason: str = ""
    reached: bool = False
    limited: bool = False

    def explain(self, before: PlanFailure) -> PlanFailure:
        """Return the failure of following one way, led by why no configuration goes on.

        A place where configurations were found is not called unreachable, and one where none was found no jump.
        """
        if not self.reason:
            return before
        status, reason = before.status, f"{self.reason}; {before.reason.replace(ASKED, '')}"
        if self.reached and status == FollowStatus.UNREACHABLE:
            status = FollowStatus.NO_PATH_FOUND
        elif not self.reached and status == FollowStatus.BRANCH_JUMP:
            status = FollowStatus.UNREACHABLE
        return replace(before, status=status, reason=reason)

    def __str__(self) -> str:
        at = f" at s = {', '.join(f'{s:.4g}' for s in self.cuts)}"
        count = "no reconfiguration" if not self.cuts else f"reconfigurations: {len(self.cuts)},{at}"
        count = count if self.stuck is None else f"none goes on at s = {self.stuck[1]:.4g}"
        what = "resolved" if self.stuck is None else "searched"
        count += ", ended by time_limit" if self.limited else ""
        return f"  {what}: {self.layers} layers, {self.nodes} configurations, {count}, {self.seconds:.2g} s"


def spread_layers(path: Path, least: int, most: int) -> Array:
    """Return positions of layers, equally far in the tool's motion."""
    s = np.linspace(0.0, path.end, DENSE)
    poses = path.pose(s)
    away = se3.error(poses[:-1], poses[1:])
    step = PER_METRE * np.linalg.norm(away[:, :3], axis=1) + PER_RADIAN * np.linalg.norm(away[:, 3:], axis=1) + 1e-9
    length = np.append(0.0, np.cumsum(step))
    count = int(np.clip(np.ceil(length[-1]), least, most))
    at = np.interp(np.linspace(0.0, length[-1], count + 1), length, s)
    at[-1] = path.end
    return np.asarray(at)


def resolve(
    sampler: Sampler, path: Path, near: Array | None, *, held: bool, many: bool, count: int = 1, cuts: int = 0
) -> tuple[list[list[Sequence]], Resolution]:
    """Return up to so many sequences along a path, the cheapest first, and how they were found; shorter ones if none goes on.

    The first configuration is preferred near a given one (n,), or is this one if it is held.
    """
    begun = perf_counter()
    s = spread_layers(path, *(MANY if many else FEW))
    graph = Graph(sampler, path, s, MANY_DRAWS if many else FEW_DRAWS, near, held=held)
    found, stuck = graph.find(count, cuts, FINEST * path.end if many else np.inf)
    nodes = sum(len(layer.q) for layer in graph.layers)
    at = tuple(float(part.s[0]) for part in found[0][1:]) if found and stuck is None else ()
    why = _explain(sampler, path, stuck) if stuck is not None and many else ("", False)
    took = perf_counter() - begun
    return found, Resolution(len(graph.layers), nodes, graph.inserted, graph.rounds, took, stuck, at, *why, sampler.met)


def _explain(sampler: Sampler, path: Path, stuck: tuple[float, float]) -> tuple[str, bool]:
    """Return why no configuration continues from one position to another, and whether there are some at the second one."""
    a, b = stuck
    if sampler.is_over:
        budget = f"its budget of {MOST_WORK:,} configurations"
        budget = "time_limit: a larger limit may find more" if sampler.met else budget
        return f"the search among all configurations was not finished within {budget}", True
    found = sampler.draw(path.pose(b)[None], EXPLAINING_DRAWS)[0]
    touching = found[sampler.rooms(found) <= 0.0]
    at = f"that were found at s = {b:.6g}"
    if not len(found):
        why = f"no configuration inside the limits was found at s = {b:.6g} from {EXPLAINING_DRAWS} random guesses"
    elif len(touching) == len(found):
        why = f"all {len(found)} configurations {at} are in contact, mostly {sampler.name_contact(touching)}"
    else:
        why = f"none of the {len(found) - len(touching)} configurations {at} continues one before it"
    where = f"no other configuration continues from s = {a:.6g} to s = {b:.6g} {path.unit}: " if a < b else ""
    return f"{where}{why}", bool(len(found))
