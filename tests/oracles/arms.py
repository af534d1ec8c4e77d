"""Arms: tables as they were published, and drawn ones."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import pi
from typing import Any, NamedTuple

import numpy as np

from tests.oracles.poses import pose, rot_x, trans

Array = Any


@dataclass(frozen=True)
class Row:
    """One row of a Denavit–Hartenberg table; metres and radians."""

    a: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    prismatic: bool = False


class Links(NamedTuple):
    """Link i is before[i] · Rot(z, θ[i]) · Trans(z, d[i]) · after[i]; its joint adds to θ, or to d where it slides."""

    before: Array
    theta: Array
    d: Array
    slides: Array
    after: Array


@dataclass(frozen=True)
class Arm:
    """A table, its convention (Craig's ``mdh`` or the standard ``dh``), and what stands before and after it."""

    convention: str
    rows: tuple[Row, ...]
    base: Array = field(default_factory=lambda: np.eye(4))
    tool: Array = field(default_factory=lambda: np.eye(4))
    lower: Array = None
    upper: Array = None

    @property
    def n(self) -> int:
        return len(self.rows)

    @cached_property
    def links(self) -> Links:
        """The links of the table."""
        moves = [trans(x=r.a) for r in self.rows]
        turns, none = [rot_x(r.alpha) for r in self.rows], [np.eye(4)] * self.n
        if self.convention == "mdh":
            before, after = [R @ T for R, T in zip(turns, moves, strict=True)], none
        else:
            before, after = none, [T @ R for R, T in zip(turns, moves, strict=True)]
        theta, d, slides = (np.array([getattr(r, x) for r in self.rows]) for x in ("theta", "d", "prismatic"))
        return Links(np.array(before), theta, d, slides, np.array(after))


def _rows(*table: tuple[float, float, float], slides: int = -1) -> tuple[Row, ...]:
    """Rows from (α in degrees, a, d)."""
    return tuple(Row(a, np.deg2rad(alpha), d, 0.0, i == slides) for i, (alpha, a, d) in enumerate(table))


PAPER = Arm("mdh", _rows((90, 0, 0), (-90, 0, 0), (0, 0.472, 0), (-90, 0.055, 0.470), (90, 0, 0), (-90, 0, 0.261)))
"""The paper's Table 1, corrected."""
SLIDING = Arm("mdh", _rows((0, 0, 0.4), (-90, 0, 0.15), (90, 0, 0), (0, 0, 0), (-90, 0, 0), (90, 0, 0.2), slides=2))
"""An arm whose third joint slides."""
UR5E = Arm(
    "dh", _rows((90, 0, 0.1625), (0, -0.425, 0), (0, -0.3922, 0), (90, 0, 0.1333), (-90, 0, 0.0997), (0, 0, 0.0996))
)
"""Universal Robots' own table."""


def random_arm(rng: np.random.Generator, n: int = 6, *, prismatic: bool = False, convention: str = "mdh") -> Arm:
    """An arm with nothing special about it: no right angles, no zeros; one of its joints slides where asked."""
    rows = [Row(*rng.uniform([-0.5, -pi, -0.5, -pi], [0.5, pi, 0.5, pi]).tolist()) for _ in range(n)]
    if prismatic:
        i = int(rng.integers(n))
        rows[i] = replace(rows[i], prismatic=True)
    base = pose(rng.uniform(-1.5, 1.5, 3), rng.uniform(-1, 1, 3))
    tool = pose(rng.uniform(-1.5, 1.5, 3), rng.uniform(-0.3, 0.3, 3))
    return Arm(convention, tuple(rows), base, tool, np.full(n, -3.0), np.full(n, 3.0))


def span(arm: Arm) -> Array:
    """Ends (2, n) of the ranges of the joints, two turns where a range has none."""
    return np.clip([arm.lower, arm.upper], -2.0 * pi, 2.0 * pi)


def configurations(arm: Arm, count: int, seed: int) -> Array:
    """Configurations (count, n) uniform inside the limits."""
    return np.random.default_rng(seed).uniform(*span(arm), (count, arm.n))
