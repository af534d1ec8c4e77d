"""A kind of block of this package: how much of a box the tool reaches by each IK method, at a constant orientation."""

from __future__ import annotations

import time
from typing import Annotated

import numpy as np
import polars as pl

import optik
from benchmarks.blocks.base import TEXT, WHOLE, Field, Kind
from benchmarks.blocks.block import Block, Column, median, share
from benchmarks.blocks.entries import Method
from benchmarks.settings import LISTED, Count, Entries, Joints, RobotName, Three, key


class ReachBlock(Block):
    """The settings of a block; each key has a meaning, and a default if it has one."""

    noun = "reach block"
    measures = (
        Column("reached", "of the box reached", "%", "more", "share", of=share("reached")),
        Column("median_ms", "median time of a call", "ms", "less", of=median("ms")),
    )

    robot: RobotName = key("The arm.")
    start_deg: Joints = key(
        "Configuration whose tool orientation is kept, and where each call starts.", unit="degrees, mm"
    )
    low_m: Three = key("Corner of the box with the least coordinates.", unit="m")
    high_m: Three = key("Corner with the largest ones.", unit="m")
    count: Count = key("Number of random points.", 200)
    methods: Annotated[tuple, LISTED, Entries(Method)] = key("The IK methods.")


FIELDS = {
    "method": TEXT, "problem": WHOLE, "reached": Field(pl.Boolean, False, "of the box reached", "%", "more"),
    "ms": Field(pl.Float64, None, "time of a call", "ms", "less", clock="wall"),
}  # fmt: skip
"""The columns of the rows: type, value where a method crashed, and how two runs are compared."""


class Reach(Kind):
    """A kind of block: one row for each point and method."""

    name = "reach"  # as the entry point says; also the key of a suite, [[reach]]
    title = "Reach of a box"
    block = ReachBlock
    fields = FIELDS
    size = 50
    alone = False  # times are only indicative: any process may do the work

    def count(self, block, session):
        """Return the number of problems."""
        return block.count

    def keys(self, trials):
        """Yield the keys of each row; a method with `max_problems` is given the first ones."""
        for method in (m for m in trials.block.methods if m.label in trials.labels):
            for number in trials.numbers:
                if method.most is None or number < method.most:
                    yield {"method": method.label, "problem": number}

    def solve(self, trials):
        """Yield a row for each problem and method; the seed depends on the problem, not on the process."""
        block, arm = trials.block, optik.load(trials.block.robot)
        q0, methods = np.radians(block.start_deg), {method.label: method for method in block.methods}
        for keys in self.keys(trials):
            method, target = methods[keys["method"]], arm.fk(q0)
            target[:3, 3] = np.random.default_rng((trials.seed, keys["problem"])).uniform(block.low_m, block.high_m)
            begin = time.perf_counter()
            found = optik.solve_ik(arm, target, q0, method.name, **method.options)
            ms = 1e3 * (time.perf_counter() - begin)
            yield keys | {"reached": bool(found), "ms": ms}
