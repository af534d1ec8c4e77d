"""Settings and measures of blocks of the executed cell."""

from __future__ import annotations

from typing import Annotated

import polars as pl
from pydantic import AfterValidator, model_validator

from benchmarks.blocks.block import Entry
from benchmarks.blocks.columns import Column, largest, mean, median, quantile
from benchmarks.blocks.entries import BudgetedMethod, ProblemBlock
from benchmarks.settings import (
    Budgets,
    Count,
    Entries,
    Flag,
    LawName,
    Settings,
    Three,
    key,
    numbered,
    one_of,
)
from benchmarks.statistics import percentage
from optik.errors import InvalidInput
from planners.cell.drives.setpoints import PERIOD

WITHIN_M = 2e-3
"""Accuracy on each axis that the paper claims [m]."""

AXES = ("x", "y", "z")
"""Suffixes of columns for the axes of the base frame."""


def within(rows: pl.DataFrame) -> pl.Series:
    """Return whether each executed tool is within the paper's accuracy on each axis; false without an execution."""
    found = rows.select(ok=pl.max_horizontal(*(pl.col(f"error_{a}").abs() for a in AXES)) <= WITHIN_M)["ok"]
    return found.fill_null(False)


def share_within(rows: pl.DataFrame) -> tuple[float, float, float]:
    """Return the percentage of trials within the paper's accuracy on each axis, with its Wilson 95 % interval."""
    ok = within(rows)
    return percentage(int(ok.sum()), len(ok))


MEASURES = (
    Column("within_2mm", "within 2 mm on each axis", "%", show="share", of=share_within),
    Column("median_error_mm", "median position error", "mm", of=median("position_error", 1e3)),
    Column("p95_error_mm", "95th percentile of the position error", "mm", of=quantile("position_error", 0.95, 1e3)),
    Column("worst_servo_mm", "largest servo error at the end", "mm", of=largest("servo_error", 1e3)),
    Column("worst_split_m", "largest |total − sum of its parts|", "m", of=largest("split_rest")),
    Column("executed", "executed to the end", "%", of=mean(pl.col("status") == "executed", 100.0)),
    Column("tracking_mm", "largest tracking error of the tool", "mm", of=largest("tracking_m", 1e3)),
    Column("tracking_mrad", "largest tracking error of a joint", "mrad", of=largest("tracking_rad", 1e3)),
    Column("torque_ratio", "largest torque / certificate's bound", show="exact", of=largest("torque_ratio")),
    Column("median_energy_j", "median energy", "J", of=median("energy")),
    Column("median_duration_s", "median duration", "s", of=median("duration")),
)  # fmt: skip
"""Measures that a target can name: of spots, and of every executed motion."""

SPOTS = "spots"
"""The type of motions of a block."""

AUTO_DRIVE, DRIVES = "auto", ("auto", "ideal", "mujoco")
"""Drives of a block; ``auto`` is mujoco if it is installed, else ideal. None of them moves a real arm."""

Amount = Annotated[float, numbered("a number, 0 or more", least=0.0)]
"""A standard deviation or a half width."""


def _below_1(value: float) -> float:
    if value >= 1.0:
        raise InvalidInput("", value, "a number below 1")
    return value


Share = Annotated[Amount, AfterValidator(_below_1)]
"""Half width of a factor, below 1."""


class Noise(Settings):
    """Random quantities of a trial: standard deviations of normal distributions, half widths of uniform ones."""

    laser_angle: Amount = key("Standard deviation of pan and of tilt.", 0.0, "rad")
    laser_range: Amount = key("Standard deviation of the range.", 0.0, "m")
    laser_position: Amount = key(
        "Standard deviation of each coordinate of the laser unit's calibrated position.", 0.0, "m"
    )
    laser_rotation: Amount = key(
        "Standard deviation of each component of the laser unit's calibrated orientation.", 0.0, "rad"
    )
    friction: Share = key("Half width of the factor on the friction of each joint, uniform around 1.", 0.0, "1")
    payload: Share = key("Half width of the factor on the mass in the tool, uniform around 1.", 0.0, "1")
    encoder_counts: Annotated[float, numbered("1 or more counts per turn", least=1.0)] = key(
        "Counts of an encoder per turn.", 2.0**20, "1"
    )
    encoder_angle: Amount = key("Standard deviation of an encoder's readings.", 0.0, "rad, m")


class CellMethod(BudgetedMethod):
    """A method with budgets, from the start or (``along``) at each pose; or with ``whole`` and its default settings."""

    along: Flag = key(
        "Whether the method iterates at each of 151 poses of the line, starting from its previous solution.", False
    )

    def entry(self) -> Entry:
        """Return the method as an entry of the block."""
        if self.whole and self.along:
            raise InvalidInput("", "both `whole` and `along`", "only one of them (`along` has budgets)")
        found = super().entry()
        named = f"{found.label}, at each pose" if self.along and "label" not in self.model_fields_set else found.label
        return Entry(named, found.name, found.options, found.most, whole=self.whole, along=self.along)


class CellBlock(ProblemBlock):
    """Spots on graph paper: iterations of an IK method move the tool to each spot, directly and along the line.

    A simulated drive executes the motions. A method that is ``whole`` takes the tool along the straight line. The others move
    it at each budget, in joint space to their own answer, or with ``along`` through their answers at each pose of the line.
    """

    noun = "cell"
    measures = MEASURES

    what: Annotated[str, one_of(SPOTS)] = key("What is executed: `spots` on graph paper.", SPOTS)
    drive: Annotated[str, one_of(*DRIVES)] = key(
        "`mujoco` or `ideal`; `auto` is `mujoco` if it is installed.", AUTO_DRIVE
    )
    period: Annotated[float, numbered("seconds above 0", above=0.0)] = key("Period of the servo.", PERIOD, "s")
    payload: Annotated[float | None, numbered("kilograms, 0 or more", least=0.0)] = key(
        "Mass in the tool; by default that of the robot file.", None, "kg"
    )
    noise: Noise = key("Variation from trial to trial.", Noise())
    methods: Annotated[tuple[Entry, ...], Entries(CellMethod)] = key("The IK methods.")
    budgets: Budgets = key("Iterations at which the methods are stopped, increasing.", (1, 2, 3, 5, 8, 12, 20))
    law: LawName = key("Time law of all motions.", "optimal")
    count: Count = key("Number of spots, those with a known solution first.", 60)
    repeats: Count = key("Trials of each spot, each with other noise.", 1)
    laser_m: Three = key("Position of the laser unit in the base frame.", (-0.6, 0.3, 0.3), "m")

    @model_validator(mode="after")
    def _payload_varies(self) -> CellBlock:
        if self.payload is None and "payload" in self.noise.model_fields_set:
            raise InvalidInput("noise: payload", "no `payload` of the block", "a mass in the tool that can vary")
        return self

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Every method at every budget, in the order of the suite."""
        return tuple(
            Entry(
                budget_label(m.label, k),
                m.name,
                m.options | ({"max_iterations": k} if k else {}),
                whole=m.whole,
                along=m.along,
            )
            for m in self.methods
            for k in (self.budgets if not m.whole else (None,))
        )


def budget_label(label: str, budget: int | None) -> str:
    """Return the name of a method at one budget in reports and targets."""
    return label if budget is None else f"{label}, {budget} iteration{'s' if budget > 1 else ''}"
