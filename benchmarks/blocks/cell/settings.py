"""Settings of blocks of the executed cell: spots on graph paper, cycles of ISO 9283, and time laws on the plant."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, model_validator

from benchmarks.blocks._entries import BudgetedMethod, Law
from benchmarks.blocks._problems import ProblemBlock
from benchmarks.blocks.base import Block, Entry
from benchmarks.blocks.cell.measures import MEASURES
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
from benchmarks.targets import Measure
from optik.errors import InvalidInput
from planners.cell.drives._setpoints import PERIOD
from planners.cell.iso9283 import PATH_CYCLES, POSE_CYCLES

SPOTS, ISO, LAWS = "spots", "iso", "laws"
"""What a block executes."""

AUTO_DRIVE, DRIVES = "auto", ("auto", "ideal", "mujoco")
"""Drives of a block; ``auto`` is mujoco where it is installed, else ideal. One that moves a real arm is none of them."""

NOISY, NOISELESS = "with noise", "without noise"
"""Labels of the entries of a block of ISO 9283."""

PAPER_MOVE = (-0.12, 0.0, 0.20)
"""The line of `optik demo` [m]."""

Amount = Annotated[float, numbered("a number, 0 or more", least=0.0)]
"""A standard deviation or a half width."""


def _below_1(value: float) -> float:
    if value >= 1.0:
        raise InvalidInput("", value, "a share below 1")
    return value


Share = Annotated[Amount, AfterValidator(_below_1)]
"""Half width of a factor, below 1."""


class Noise(Settings):
    """What varies from trial to trial. Standard deviations of normal distributions, half widths of uniform ones."""

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
    """A method with budgets, from the start or (``along``) at each pose; or ``whole``, with its default settings."""

    along: Flag = key(
        "Whether the method iterates at each of 151 poses of the line, starting from its previous solution.", False
    )

    def entry(self) -> Entry:
        """The method as the block compares it."""
        if self.whole and self.along:
            raise InvalidInput("", "both `whole` and `along`", "only one of them (`along` has budgets)")
        found = super().entry()
        named = f"{found.label}, at each pose" if self.along and "label" not in self.model_fields_set else found.label
        return Entry(named, found.name, found.options, found.most, whole=self.whole, along=self.along)


class SpotsBlock(CellBlock, ProblemBlock):
    """Spots on graph paper: the tool is sent to each by iterations of an IK method, and along the whole line.

    A method that is ``whole`` takes the tool along the straight line. The others move it at each budget, in joint space to
    their own answer, or with ``along`` through their answers at each pose of the line.
    """

    measures: ClassVar[tuple[Measure, ...]] = MEASURES[SPOTS]

    methods: Annotated[tuple[Entry, ...], Entries(CellMethod)] = key("The IK methods.")
    budgets: Budgets = key("Iterations at which the methods are stopped, increasing.", (1, 2, 3, 5, 8, 12, 20))
    law: LawName = key("Time law of all motions.", "optimal")
    count: Count = key("Number of spots, those with a known solution first.", 60)
    repeats: Count = key("Trials of each spot, each with other noise.", 1)
    laser_m: Three = key("Position of the laser unit in the base frame.", (-0.6, 0.3, 0.3), "m")

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Every method at every budget, as the suite has them."""
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

    measures: ClassVar[tuple[Measure, ...]] = MEASURES[ISO]

    start_deg: Joints = key("Configuration at the centre of the cube, where the line begins.", unit="degrees, mm")
    move_m: Three = key("From the start of the line to its end, in the base frame.", PAPER_MOVE, "m")
    law: LawName = key("Time law of all motions.", "optimal")
    cycles: Count = key("Cycles through the poses.", POSE_CYCLES)
    path_cycles: Count = key("Cycles along the line.", PATH_CYCLES)

    @property
    def entries(self) -> tuple[Entry, ...]:
        """With noise, and without."""
        return tuple(Entry(label, self.law, {}) for label in (NOISY, NOISELESS))


def _told_all(laws: tuple[Entry, ...]) -> tuple[Entry, ...]:
    if untold := [law.label for law in laws if law.without]:
        raise InvalidInput("", f"`without` of {untold[0]}", "laws that are told every limit")
    return laws


class LawsBlock(CellBlock):
    """Straight lines under several time laws, as the plant executes them."""

    measures: ClassVar[tuple[Measure, ...]] = MEASURES[LAWS]

    start_deg: Joints = key("Start of all lines.", unit="degrees, mm")
    laws: Annotated[tuple[Entry, ...], Entries(Law), AfterValidator(_told_all)] = key("The time laws.")
    moves_m: Annotated[tuple[Three, ...], LISTED] = key(
        "From the start of each line to its end, in the base frame.", (PAPER_MOVE,), "m"
    )
    repeats: Annotated[int, counted(0)] = key("Executions of each motion with noise, beside one without.", 0)
    same_duration: Flag = key("Whether each motion is also executed slowed to the longest of its line.", True)

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The laws."""
        return self.laws


def budget_label(label: str, budget: int | None) -> str:
    """What reports and targets call a method at one budget."""
    return label if budget is None else f"{label}, {budget} iteration{'s' if budget > 1 else ''}"


BLOCKS: dict[str, type[CellBlock]] = {SPOTS: SpotsBlock, ISO: IsoBlock, LAWS: LawsBlock}
"""Blocks by what they execute."""


def read_block(data: Any) -> CellBlock:
    """Check the settings of a block of the executed cell."""
    where = f"cell {data.get('id', '?')!r}" if isinstance(data, dict) else "cell"
    check_keys(data, set(data) if isinstance(data, dict) else set(), where, need={"id", "what", "robot"})
    if data["what"] not in BLOCKS:
        raise InvalidInput(f"{where}: what", repr(data["what"])[:60], f"one of {', '.join(BLOCKS)}")
    return BLOCKS[data["what"]].read(data)
