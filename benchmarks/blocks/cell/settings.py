"""Settings and measures of blocks of the executed cell: spots on graph paper, cycles of ISO 9283, laws on the plant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
import polars as pl
from pydantic import AfterValidator, model_validator

from benchmarks.blocks.block import Block, Entry
from benchmarks.blocks.cell.iso9283 import PathFigures, PoseFigures, path_figures, pose_figures
from benchmarks.blocks.columns import Column, largest, mean, median, quantile
from benchmarks.blocks.entries import BudgetedMethod, Law, ProblemBlock
from benchmarks.settings import (
    LISTED,
    Budgets,
    Count,
    Entries,
    Flag,
    Joints,
    LawName,
    RobotName,
    Settings,
    Three,
    check_keys,
    counted,
    key,
    numbered,
    one_of,
)
from benchmarks.statistics import percentage
from optik import se3
from optik.errors import InvalidInput
from optik.types import Array
from planners.cell.drives.setpoints import PERIOD

POSE_TEST, PATH_TEST = "pose", "path"
"""The two tests of the rows."""
POSE_CYCLES, PATH_CYCLES = 30, 10
"""Numbers of cycles of the pose test and of the path test in the standard."""


def figures_of(rows: pl.DataFrame) -> list[PoseFigures | PathFigures]:
    """Return the figures of one entry: those of each pose, then those of the path."""
    done = rows.filter(pl.col("reached_x").is_not_null()).sort("cycle", "problem")
    noise = bool(done["noise"].any())
    found: list[PoseFigures | PathFigures] = []
    for _, part in done.filter(pl.col("test") == POSE_TEST).group_by("problem", maintain_order=True):
        found.append(pose_figures(_command(part), _reached(part), noise=noise))
    path = done.filter(pl.col("test") == PATH_TEST)
    if not path.is_empty():
        command = path.filter(pl.col("cycle") == path["cycle"][0]).select("x", "y", "z").to_numpy()
        met = path.select("reached_x", "reached_y", "reached_z").to_numpy().reshape(-1, len(command), 3)
        found.append(path_figures(command, met, noise=noise))
    return found


def _command(part: pl.DataFrame) -> Array:
    """Return the commanded pose of some rows, which is the same for all; rotations are relative to its orientation."""
    T = np.eye(4)
    T[:3, 3] = part.select("x", "y", "z").row(0)
    return T


def _reached(part: pl.DataFrame) -> Array:
    """Return the reached poses, their orientations relative to the commanded one, in the base frame."""
    poses = np.repeat(np.eye(4)[None], len(part), axis=0)
    poses[:, :3, 3] = part.select("reached_x", "reached_y", "reached_z").to_numpy()
    poses[:, :3, :3] = se3.exp_so3(part.select("turn_x", "turn_y", "turn_z").to_numpy())
    return poses


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


def _iso(what: type, field: str) -> Callable[[pl.DataFrame], float]:
    """Return the largest of one figure of ISO 9283, over the poses or the path; NaN if it is not applicable."""

    def value(rows: pl.DataFrame) -> float:
        found = [getattr(f, field) for f in figures_of(rows) if isinstance(f, what)]
        return 1e3 * max(found) if found and None not in found else float("nan")

    return value


OF_EXECUTIONS = (
    Column("executed", "executed to the end", "%", of=mean(pl.col("status") == "executed", 100.0)),
    Column("tracking_mm", "largest tracking error of the tool", "mm", of=largest("tracking_m", 1e3)),
    Column("tracking_mrad", "largest tracking error of a joint", "mrad", of=largest("tracking_rad", 1e3)),
    Column("torque_ratio", "largest torque / certificate's bound", show="exact", of=largest("torque_ratio")),
    Column("median_energy_j", "median energy", "J", of=median("energy")),
    Column("median_duration_s", "median duration", "s", of=median("duration")),
)  # fmt: skip
"""Measures of every executed motion."""

OF_SPOTS = (
    Column("within_2mm", "within 2 mm on each axis", "%", show="share", of=share_within),
    Column("median_error_mm", "median position error", "mm", of=median("position_error", 1e3)),
    Column("p95_error_mm", "95th percentile of the position error", "mm", of=quantile("position_error", 0.95, 1e3)),
    Column("worst_servo_mm", "largest servo error at the end", "mm", of=largest("servo_error", 1e3)),
    Column("worst_split_m", "largest |total − sum of its parts|", "m", of=largest("split_rest")),
)
"""Additional measures of spots."""

OF_ISO = (
    Column("ap_mm", "AP, largest of the five poses (simulated)", "mm", of=_iso(PoseFigures, "accuracy")),
    Column("rp_mm", "RP, largest of the five poses (simulated)", "mm", of=_iso(PoseFigures, "repeatability")),
    Column("at_mm", "AT (simulated)", "mm", of=_iso(PathFigures, "accuracy")),
    Column("rt_mm", "RT (simulated)", "mm", of=_iso(PathFigures, "repeatability")),
)
"""Additional measures of cycles of ISO 9283."""

MEASURES = {"spots": (*OF_SPOTS, *OF_EXECUTIONS), "iso": (*OF_ISO, *OF_EXECUTIONS), "laws": OF_EXECUTIONS}
"""Measures that a target of a block can name, by the type of motion."""

ALL_MEASURES: tuple[Column, ...] = (*OF_SPOTS, *OF_ISO, *OF_EXECUTIONS)
"""All measures, each once."""


SPOTS, ISO, LAWS = "spots", "iso", "laws"
"""Types of motions of a block."""

AUTO_DRIVE, DRIVES = "auto", ("auto", "ideal", "mujoco")
"""Drives of a block; ``auto`` is mujoco if it is installed, else ideal. None of them moves a real arm."""

NOISY, NOISELESS = "with noise", "without noise"
"""Labels of the entries of a block of ISO 9283."""

PAPER_MOVE = (-0.12, 0.0, 0.20)
"""The line of `optik demo` [m]."""

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


class CellBlock(Block):
    """Motions of an arm that a simulated drive executes."""

    noun = "cell"
    measures = ALL_MEASURES

    what: Annotated[str, one_of(SPOTS, ISO, LAWS)] = key(
        "What is executed: `spots` on graph paper, cycles of ISO 9283 (`iso`), or time `laws`."
    )
    robot: RobotName = key("The arm: a name, or the path of a file.")
    drive: Annotated[str, one_of(*DRIVES)] = key(
        "`mujoco` or `ideal`; `auto` is `mujoco` if it is installed.", AUTO_DRIVE
    )
    period: Annotated[float, numbered("seconds above 0", above=0.0)] = key("Period of the servo.", PERIOD, "s")
    payload: Annotated[float | None, numbered("kilograms, 0 or more", least=0.0)] = key(
        "Mass in the tool; by default that of the robot file.", None, "kg"
    )
    noise: Noise = key("Variation from trial to trial.", Noise())

    @model_validator(mode="after")
    def _payload_varies(self) -> CellBlock:
        if self.payload is None and "payload" in self.noise.model_fields_set:
            raise InvalidInput("noise: payload", "no `payload` of the block", "a mass in the tool that can vary")
        return self


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


class SpotsBlock(CellBlock, ProblemBlock):
    """Spots on graph paper: iterations of an IK method move the tool to each spot, directly and along the line.

    A method that is ``whole`` takes the tool along the straight line. The others move it at each budget, in joint space to
    their own answer, or with ``along`` through their answers at each pose of the line.
    """

    measures = MEASURES[SPOTS]

    methods: Annotated[tuple[Entry, ...], Entries(CellMethod)] = key("The IK methods.")
    budgets: Budgets = key("Iterations at which the methods are stopped, increasing.", (1, 2, 3, 5, 8, 12, 20))
    law: LawName = key("Time law of all motions.", "optimal")
    count: Count = key("Number of spots, those with a known solution first.", 60)
    repeats: Count = key("Trials of each spot, each with other noise.", 1)
    laser_m: Three = key("Position of the laser unit in the base frame.", (-0.6, 0.3, 0.3), "m")

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


class IsoBlock(CellBlock):
    """Cycles through the five poses of ISO 9283 and along one line, with noise and without."""

    measures = MEASURES[ISO]

    start_deg: Joints = key("Configuration at the centre of the cube, where the line begins.", unit="degrees, mm")
    move_m: Three = key("From the start of the line to its end, in the base frame.", PAPER_MOVE, "m")
    law: LawName = key("Time law of all motions.", "optimal")
    cycles: Count = key("Cycles through the poses.", POSE_CYCLES)
    path_cycles: Count = key("Cycles along the line.", PATH_CYCLES)

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The two entries of the block: the time law executed with noise, and without noise."""
        return tuple(Entry(label, self.law, {}) for label in (NOISY, NOISELESS))


def _told_all(laws: tuple[Entry, ...]) -> tuple[Entry, ...]:
    if untold := [law.label for law in laws if law.without]:
        raise InvalidInput("", f"`without` of {untold[0]}", "laws without the key `without`")
    return laws


class LawsBlock(CellBlock):
    """Straight lines under several time laws, as the plant executes them."""

    measures = MEASURES[LAWS]

    start_deg: Joints = key("Start of all lines.", unit="degrees, mm")
    laws: Annotated[tuple[Entry, ...], Entries(Law), AfterValidator(_told_all)] = key("The time laws.")
    moves_m: Annotated[tuple[Three, ...], LISTED] = key(
        "From the start of each line to its end, in the base frame.", (PAPER_MOVE,), "m"
    )
    repeats: Annotated[int, counted(0)] = key("Executions of each motion with noise, in addition to one without.", 0)
    same_duration: Flag = key("Whether each motion is also executed slowed to the longest of its line.", True)


def budget_label(label: str, budget: int | None) -> str:
    """Return the name of a method at one budget in reports and targets."""
    return label if budget is None else f"{label}, {budget} iteration{'s' if budget > 1 else ''}"


BLOCKS: dict[str, type[CellBlock]] = {SPOTS: SpotsBlock, ISO: IsoBlock, LAWS: LawsBlock}
"""Blocks by their type of motion."""


def read_block(data: Any) -> CellBlock:
    """Check the settings of a block of the executed cell."""
    where = f"cell {data.get('id', '?')!r}" if isinstance(data, dict) else "cell"
    check_keys(data, set(data) if isinstance(data, dict) else set(), where, need={"id", "what", "robot"})
    if data["what"] not in BLOCKS:
        raise InvalidInput(f"{where}: what", repr(data["what"])[:60], f"one of {', '.join(BLOCKS)}")
    return BLOCKS[data["what"]].read(data)
