"""Settings of blocks of motions through a scene."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import BeforeValidator

from benchmarks.blocks._scenes import SceneName
from benchmarks.blocks.base import Block, Entry
from benchmarks.blocks.timing.clearance.measures import MEASURES
from benchmarks.settings import Count, RobotName, key, numbered
from benchmarks.targets import Measure
from optik.check import check_number
from optik.errors import InvalidInput

PROOF = "proof for every instant"
"""Label of the proof beside those of the sampling."""


def _above_0(values: Any) -> tuple[float, ...]:
    if not isinstance(values, list | tuple):
        raise InvalidInput("", repr(values)[:60], "different numbers above 0")
    found = tuple(check_number(value, "", "numbers above 0", above=0.0) for value in values)
    if len(set(found)) < len(found):
        raise InvalidInput("", repr(values)[:60], "different numbers above 0")
    return found


Resolutions = Annotated[tuple[float, ...], BeforeValidator(_above_0)]
"""Different numbers above 0; no sampling of this sort where the list is empty."""


class ClearanceBlock(Block):
    """Motions of an arm through a scene, judged by the proof and by sampling."""

    noun = "clearance"
    measures: ClassVar[tuple[Measure, ...]] = MEASURES

    robot: RobotName = key("The arm: a name, or the path of a file; it must have shapes.")
    scene: SceneName = key("Scene: `shelf`, `table`, `plates`, or a file.")
    count: Count = key("Number of motions, straight in joint space from rest to rest between two free configurations.")
    joint_steps: Resolutions = key("Sampling: largest joint motion between samples.", (0.2, 0.1, 0.05, 0.02), "rad, m")
    rates: Resolutions = key("Sampling: samples a second.", (100.0, 400.0), "Hz")
    margin: Annotated[float, numbered("metres, 0 or more", least=0.0)] = key(
        "Least distance between arm and scene; for pairs of links it is 0.", 0.0, "m"
    )

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
