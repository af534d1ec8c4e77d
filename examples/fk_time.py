"""A kind of suite block in one file: time of forward kinematics, one call for many configurations.

Try it: ``optik bench run examples/suite.toml --allow-plugins --out run``, and ``optik bench report run``.
"""

from dataclasses import dataclass

import numpy as np
import polars as pl

import optik
from benchmarks.kinds.base import Block, Kind, Measure, timed


@dataclass(frozen=True, kw_only=True)
class FkBlock(Block):
    """One arm, and how many configurations one call has."""

    robot: str
    sizes: tuple

    @property
    def robots(self):
        """Arms, for the first sentence of the report."""
        return (self.robot,)


class ForwardKinematics(Kind):
    """Time of forward kinematics."""

    name = "fk_time"
    title = "Forward kinematics"
    measures = (
        Measure("median_us", "µs", lambda rows: rows["us"].median(), "median time of a call"),
        Measure("longest_us", "µs", lambda rows: rows["us"].max(), "longest call"),
    )

    def settings(self, data):
        """Check one table of a suite: keys that are known, keys that must be there; the robot must exist."""
        shared = self.common(data, {"robot", "sizes"}, need={"robot", "sizes"})
        targets = self.targets(data, [f"{size} at once" for size in data["sizes"]])
        return FkBlock(**shared, targets=targets, sizes=tuple(data["sizes"]))

    def measure(self, block, seed, tell):
        """Return the rows; ``method`` is the label of what is compared, and what a target calls ``method``."""
        robot = optik.load(block.robot)
        frames = []
        for size in block.sizes:
            tell(f"{block.id}: {size} at once")
            q = np.random.default_rng(seed).uniform(robot.limits.lower, robot.limits.upper, (size, robot.n))
            robot.fk(q)  # the first call compiles
            ns, _ = timed(robot.fk, [(q,)] * 100)
            frames.append(pl.DataFrame({"method": f"{size} at once", "us": ns / 1e3}))
        return pl.concat(frames)


METHOD = ForwardKinematics
