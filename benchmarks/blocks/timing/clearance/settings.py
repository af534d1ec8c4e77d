"""Settings of blocks of motions through a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from benchmarks.blocks._scenes import scene_name
from benchmarks.blocks.base import Block, Entry
from benchmarks.blocks.timing.clearance.measures import MEASURES
from benchmarks.settings import all_of, check_keys, check_known, check_list
from benchmarks.targets import read_target
from optik.check import check_count, check_number
from optik.errors import InvalidInput

PROOF = "proof for every instant"
"""Label of the proof beside those of the sampling."""


@dataclass(frozen=True, kw_only=True)
class ClearanceBlock(Block):
    """Motions of an arm through a scene, judged by the proof and by sampling.

    Attributes
    ----------
    robot : str
        The arm: a name, or the path of a file; it must have shapes.
    scene : str
        Name of a scene (``shelf``, ``table``, ``plates``), or the path of a file.
    count : int
        Number of motions, each straight in joint space from rest to rest between two free configurations, drawn at random.
    joint_steps : tuple of float
        Sampling: largest joint motion from one sample to the next [rad, m].
    rates : tuple of float
        Sampling: samples a second [Hz].
    margin : float
        Distance that the arm shall keep from the scene [m].
    """

    robot: str
    scene: str
    count: int
    joint_steps: tuple[float, ...]
    rates: tuple[float, ...]
    margin: float

    @property
    def robots(self) -> tuple[str, ...]:
        """The one arm."""
        return (self.robot,)

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The proof, then coal at each rate, from coarse to fine."""
        sampled = [sampling_label(step, "rad") for step in self.joint_steps] + [
            sampling_label(rate, "Hz") for rate in self.rates
        ]
        return (Entry(PROOF, "clearance", {}), *(Entry(label, "coal", {}, role="peer") for label in sampled))


def sampling_label(value: float, unit: str) -> str:
    """What reports and targets call coal at one resolution."""
    return f"coal, {value:g} {unit}"


def read_block(data: Any) -> ClearanceBlock:
    """Check the settings of a block of motions through a scene."""
    where = f"clearance {data.get('id', '?')!r}" if isinstance(data, dict) else "clearance"
    keys = {"id", "title", "robot", "scene", "count", "joint_steps", "rates", "margin", "targets"}
    check_keys(data, keys, where, need={"id", "robot", "scene", "count"})
    check_count(data["count"], f"{where}: count", 1)
    block = ClearanceBlock(
        id=str(data["id"]),
        title=str(data.get("title", data["id"])),
        robot=check_known(data["robot"], "optik.robots", "robot"),
        scene=scene_name(data["scene"], f"{where}: scene"),
        count=data["count"],
        joint_steps=_above_0(data.get("joint_steps", [0.2, 0.1, 0.05, 0.02]), f"{where}: joint_steps"),
        rates=_above_0(data.get("rates", [100.0, 400.0]), f"{where}: rates"),
        margin=check_number(data.get("margin", 0.0), f"{where}: margin", "metres, 0 or more", least=0.0),
    )
    targets = all_of(
        data.get("targets"), f"{where}: targets", lambda one: read_target(one, where, MEASURES, labels=block.labels)
    )
    return ClearanceBlock(**{**block.__dict__, "targets": targets})


def _above_0(values: Any, where: str) -> tuple[float, ...]:
    """Numbers above 0; an empty list is none."""
    if values == []:
        return ()
    found = tuple(check_number(value, where, "numbers above 0") for value in check_list(values, where))
    if any(value <= 0.0 for value in found) or len(set(found)) < len(found):
        raise InvalidInput(where, repr(values)[:60], "different numbers above 0")
    return found
