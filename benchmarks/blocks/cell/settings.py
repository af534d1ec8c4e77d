"""Settings of blocks of the executed cell: spots on graph paper, cycles of ISO 9283, and time laws on the plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

from benchmarks.blocks._entries import check_labels, read_law, read_method
from benchmarks.blocks._problems import ProblemBlock
from benchmarks.blocks.base import Block, Entry
from benchmarks.blocks.cell.measures import MEASURES
from benchmarks.problems.base import SETS
from benchmarks.settings import all_of, check_keys, check_known, check_list, check_table
from benchmarks.targets import read_target
from optik.check import check_count, check_flag, check_number, real_array
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


@dataclass(frozen=True, kw_only=True)
class Noise:
    """What varies from trial to trial. Standard deviations of normal distributions, half widths of uniform ones.

    Attributes
    ----------
    laser_angle : float
        Standard deviation of pan and of tilt [rad].
    laser_range : float
        Standard deviation of the range [m].
    laser_position : float
        Standard deviation of each coordinate of the laser unit's calibrated position [m].
    laser_rotation : float
        Standard deviation of each component of the laser unit's calibrated orientation [rad].
    friction : float
        Half width of the factor on the friction of each joint, uniform around 1 [1].
    payload : float
        Half width of the factor on the mass in the tool, uniform around 1 [1].
    encoder_counts : float
        Counts of an encoder per turn [1].
    encoder_angle : float
        Standard deviation of an encoder's readings [rad, m].
    """

    laser_angle: float = 0.0
    laser_range: float = 0.0
    laser_position: float = 0.0
    laser_rotation: float = 0.0
    friction: float = 0.0
    payload: float = 0.0
    encoder_counts: float = 2.0**20
    encoder_angle: float = 0.0


@dataclass(frozen=True, kw_only=True)
class CellBlock(Block):
    """Motions of an arm that a simulated drive executes.

    Attributes
    ----------
    what : {"spots", "iso", "laws"}
        What is executed: spots on graph paper, cycles of ISO 9283, or time laws.
    robot : str
        The arm: a name, or the path of a file.
    drive : {"auto", "ideal", "mujoco"}
        What executes: mujoco where it is installed and else ideal, or the one that is named.
    period : float
        Of the servo [s].
    payload : float
        Mass in the tool [kg]; by default what the robot's own file states.
    noise : Noise
        What varies from trial to trial.
    """

    what: str
    robot: str
    drive: str = AUTO_DRIVE
    period: float = PERIOD
    payload: float | None = None
    noise: Noise = field(default_factory=Noise)

    @property
    def robots(self) -> tuple[str, ...]:
        """The one arm."""
        return (self.robot,)


@dataclass(frozen=True, kw_only=True)
class SpotsBlock(CellBlock, ProblemBlock):
    """Spots on graph paper: the tool is sent to each by iterations of an IK method, and along the whole line.

    Attributes
    ----------
    methods : tuple of Entry
        The IK methods. One that is ``whole`` takes the tool along the straight line. The others move it at each budget, in
        joint space to their own answer, or with ``along`` through their answers at each pose of the line.
    budgets : tuple of int
        Iterations at which the methods are stopped, increasing.
    law : str
        The time law of all motions.
    count : int
        Number of spots, those with a known solution first.
    repeats : int
        How often each spot is shown, each time with other noise.
    laser_m : tuple of three floats
        Where the laser unit stands in the base frame [m].
    """

    methods: tuple[Entry, ...]
    budgets: tuple[int, ...] = (1, 2, 3, 5, 8, 12, 20)
    law: str = "optimal"
    count: int = 60
    repeats: int = 1
    laser_m: tuple[float, ...] = (-0.6, 0.3, 0.3)

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


@dataclass(frozen=True, kw_only=True)
class IsoBlock(CellBlock):
    """Cycles through the five poses of ISO 9283 and along one line, with noise and without.

    Attributes
    ----------
    start_deg : tuple of float
        Where the tool is the centre of the cube, and the line begins [degrees, mm].
    move_m : tuple of three floats
        From the start of the line to its end, in the base frame [m].
    law : str
        The time law of all motions.
    cycles, path_cycles : int
        Cycles through the poses, and along the line.
    """

    start_deg: tuple[float, ...]
    move_m: tuple[float, ...] = PAPER_MOVE
    law: str = "optimal"
    cycles: int = POSE_CYCLES
    path_cycles: int = PATH_CYCLES

    @property
    def entries(self) -> tuple[Entry, ...]:
        """With noise, and without."""
        return tuple(Entry(label, self.law, {}) for label in (NOISY, NOISELESS))


@dataclass(frozen=True, kw_only=True)
class LawsBlock(CellBlock):
    """Straight lines under several time laws, as the plant executes them.

    Attributes
    ----------
    start_deg : tuple of float
        Where all lines begin [degrees, mm].
    moves_m : tuple of tuples of three floats
        From the start of each line to its end, in the base frame [m].
    laws : tuple of Entry
        The time laws.
    repeats : int
        How often each motion is executed with noise, beside once without.
    same_duration : bool
        Whether each motion is executed a second time, slowed to the longest of its line.
    """

    start_deg: tuple[float, ...]
    laws: tuple[Entry, ...]
    moves_m: tuple[tuple[float, ...], ...] = (PAPER_MOVE,)
    repeats: int = 0
    same_duration: bool = True

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The laws."""
        return self.laws


def budget_label(label: str, budget: int | None) -> str:
    """What reports and targets call a method at one budget."""
    return label if budget is None else f"{label}, {budget} iteration{'s' if budget > 1 else ''}"


SHARED_KEYS = {"id", "title", "what", "robot", "drive", "period", "payload", "noise", "targets"}
"""Keys of every block of this kind."""


def read_block(data: Any) -> CellBlock:
    """Check the settings of a block of the executed cell."""
    where = f"cell {data.get('id', '?')!r}" if isinstance(data, dict) else "cell"
    check_keys(data, set(data) if isinstance(data, dict) else set(), where, need={"id", "what", "robot"})
    readers = {SPOTS: _spots, ISO: _iso, LAWS: _laws}
    what = _one_of(data["what"], tuple(readers), f"{where}: what")
    block = readers[what](data, where, _shared(data, where))
    targets = all_of(
        data.get("targets"), f"{where}: targets",
        lambda one: read_target(one, where, MEASURES[what], labels=block.labels),
    )  # fmt: skip
    return replace(block, targets=targets)


def _shared(data: dict[str, Any], where: str) -> dict[str, Any]:
    return {
        "id": str(data["id"]), "title": str(data.get("title", data["id"])), "what": data["what"],
        "robot": check_known(data["robot"], "optik.robots", "robot"),
        "drive": _one_of(data.get("drive", AUTO_DRIVE), DRIVES, f"{where}: drive"),
        "period": check_number(data.get("period", PERIOD), f"{where}: period", "seconds above 0", above=0.0),
        "payload": _payload(data, where), "noise": _noise(data.get("noise", {}), f"{where}: noise"),
    }  # fmt: skip


def _payload(data: dict[str, Any], where: str) -> float | None:
    if "payload" not in data:
        if "payload" in check_table(data.get("noise", {}), f"{where}: noise"):
            raise InvalidInput(
                f"{where}: noise: payload", "no `payload` of the block", "a mass in the tool that can vary"
            )
        return None
    return check_number(data["payload"], f"{where}: payload", "kilograms, 0 or more", least=0.0)


def _noise(data: Any, where: str) -> Noise:
    names = {f.name for f in fields(Noise)}
    check_keys(data, names, where)
    found = {name: check_number(data[name], f"{where}: {name}", "a number, 0 or more", least=0.0) for name in data}
    for share in ("friction", "payload"):
        if found.get(share, 0.0) >= 1.0:
            raise InvalidInput(f"{where}: {share}", found[share], "a share below 1")
    if found.get("encoder_counts", 1.0) < 1.0:
        raise InvalidInput(f"{where}: encoder_counts", found["encoder_counts"], "1 or more counts per turn")
    return Noise(**found)


def _spots(data: dict[str, Any], where: str, shared: dict[str, Any]) -> SpotsBlock:
    own = {"set", "options", "methods", "budgets", "law", "count", "repeats", "laser_m"}
    check_keys(data, SHARED_KEYS | own, where, need={"set", "methods"})
    given = _counts(data, where, count=1, repeats=1)
    if "budgets" in data:
        given["budgets"] = _increasing(data["budgets"], f"{where}: budgets")
    if "laser_m" in data:
        given["laser_m"] = _three(data["laser_m"], f"{where}: laser_m")
    methods = tuple(_method(m, where) for m in check_list(data["methods"], f"{where}: methods"))
    check_labels(methods, f"{where}: methods")
    return SpotsBlock(
        **shared, **given, methods=methods, set=check_known(data["set"], SETS, "problem set"), law=_law(data),
        options=dict(check_table(data.get("options", {}), f"{where}: options")),
    )  # fmt: skip


def _iso(data: dict[str, Any], where: str, shared: dict[str, Any]) -> IsoBlock:
    check_keys(data, SHARED_KEYS | {"start_deg", "move_m", "law", "cycles", "path_cycles"}, where, need={"start_deg"})
    given = _counts(data, where, cycles=1, path_cycles=1)
    if "move_m" in data:
        given["move_m"] = _three(data["move_m"], f"{where}: move_m")
    return IsoBlock(**shared, **given, start_deg=_start(data, where), law=_law(data))


def _laws(data: dict[str, Any], where: str, shared: dict[str, Any]) -> LawsBlock:
    own = {"start_deg", "laws", "moves_m", "repeats", "same_duration"}
    check_keys(data, SHARED_KEYS | own, where, need={"start_deg", "laws"})
    given = _counts(data, where, repeats=0)
    if "moves_m" in data:
        given["moves_m"] = tuple(
            _three(m, f"{where}: moves_m") for m in check_list(data["moves_m"], f"{where}: moves_m")
        )
    if "same_duration" in data:
        given["same_duration"] = check_flag(data["same_duration"], f"{where}: same_duration")
    laws = tuple(read_law(law, f"{where}: laws") for law in check_list(data["laws"], f"{where}: laws"))
    check_labels(laws, f"{where}: laws")
    if told := [law.label for law in laws if law.without]:
        raise InvalidInput(f"{where}: laws", f"`without` of {told[0]}", "laws that are told every limit")
    return LawsBlock(**shared, **given, start_deg=_start(data, where), laws=laws)


def _method(data: Any, where: str) -> Entry:
    """Read a method with budgets, from the start or (``along = true``) at each pose; or with ``whole = true``, by default."""
    known = dict(data) if isinstance(data, dict) else data
    whole, along = (known.pop(key, False) if isinstance(known, dict) else False for key in ("whole", "along"))
    check_flag(whole, f"{where}: methods: whole")
    check_flag(along, f"{where}: methods: along")
    if whole and along:
        raise InvalidInput(f"{where}: methods", "both `whole` and `along`", "only one of them (`along` has budgets)")
    found = read_method(known, where)
    if along and "label" not in known:
        found = replace(found, label=f"{found.label}, at each pose")
    for fixed in ("max_iterations", "max_restarts", "time_limit"):
        if fixed in found.options and not whole:
            raise InvalidInput(f"{where}: methods", fixed, "budgets in place of it; or whole = true")
    return replace(found, whole=whole, along=along)


def _counts(data: dict[str, Any], where: str, **least: int) -> dict[str, Any]:
    """Those of some whole numbers that are given, each at least so large."""
    for key, low in least.items():
        check_count(data.get(key, low), f"{where}: {key}", low)
    return {key: data[key] for key in least if key in data}


def _law(data: dict[str, Any]) -> str:
    return check_known(data.get("law", "optimal"), "planners.timing", "time law")


def _start(data: dict[str, Any], where: str) -> tuple[float, ...]:
    """Joints of the start; their number is checked where the arm is loaded."""
    at = f"{where}: start_deg"
    return tuple(real_array(check_list(data["start_deg"], at), at, "degrees or mm, one number a joint").tolist())


def _three(values: Any, where: str) -> tuple[float, ...]:
    found = tuple(check_number(x, where, "three numbers [m]") for x in check_list(values, where))
    if len(found) != 3:
        raise InvalidInput(where, repr(values)[:60], "three numbers [m]")
    return found


def _increasing(values: Any, where: str) -> tuple[int, ...]:
    found = tuple(check_list(values, where))
    for value in found:
        check_count(value, where, 1)
    if list(found) != sorted(set(found)):
        raise InvalidInput(where, found, "whole numbers, each larger than the one before")
    return found


def _one_of(value: Any, known: Sequence[str], where: str) -> str:
    if value not in known:
        raise InvalidInput(where, repr(value)[:60], f"one of {', '.join(known)}")
    return str(value)
