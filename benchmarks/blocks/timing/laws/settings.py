"""Settings of blocks of timed lines: lines, limits, laws and peers, and one line for a detailed view."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, Field, model_validator

from benchmarks.blocks._arms import Payload
from benchmarks.blocks._entries import Law, LawPeer
from benchmarks.blocks.base import Block, Entry
from benchmarks.blocks.timing.laws.measures import MEASURES
from benchmarks.blocks.timing.laws.motions import MOTION_KINDS
from benchmarks.blocks.timing.laws.sets import LimitSet, LineSet
from benchmarks.settings import (
    LISTED,
    Count,
    Entries,
    RobotName,
    Settings,
    SolverName,
    check_different,
    check_labels,
    counted,
    key,
)
from benchmarks.targets import Measure, Target
from optik.errors import InvalidInput


class Example(Settings):
    """The motion of which the report has a detailed view."""

    fixed = frozenset({"path"})

    robot: RobotName = key("The arm: a name, or the path of a file.", "")
    kind: str = key("Kind of motions, or the name of a file.", "")
    index: Annotated[int, counted(0)] = key("Number of the motion in its set, from 0.", 0)
    limits: str = key("Label of the limits.", "")
    payload: Payload = key("Mass in the tool; by default that of the first such set.", None, "kg")
    path: str = ""


class LawTarget(Target):
    """A bound on a law or a peer."""

    method: str = key("Label of the law that the bound applies to.", alias="law")


def _different_sets(lines: tuple[LineSet, ...]) -> tuple[LineSet, ...]:
    check_different([f"{part.label} of {part.arm}" for part in lines], "", "set")
    return lines


def _different_limits(limits: tuple[LimitSet, ...]) -> tuple[LimitSet, ...]:
    check_labels(limits)
    return limits


class LawBlock(Block):
    """Lines × limits × laws."""

    noun = "timing block"
    measures: ClassVar[tuple[Measure, ...]] = MEASURES

    lines: Annotated[tuple[LineSet, ...], LISTED, AfterValidator(_different_sets)] = key("Sets of motions.")
    limits: Annotated[tuple[LimitSet, ...], LISTED, AfterValidator(_different_limits)] = key(
        "Limits of the joints and of the tool; each motion is timed within each."
    )
    laws: Annotated[tuple[Entry, ...], Entries(Law)] = key("Time laws of ours.")
    peers: Annotated[tuple[Entry, ...], Entries(LawPeer)] = key("Time laws of other packages.", ())
    reference: Annotated[Entry | None, Entries(Law, single=True, role="reference")] = key(
        "Law whose duration is the optimum T* unless a shorter motion is within all limits.", None
    )
    plan: str = Field(
        default_factory=lambda given: given["laws"][0].label,
        description="Label of the law with which whole plans are timed; by default the first.",
    )
    solver: SolverName = key("IK method that follows the paths.", "lm")
    samples: Annotated[int, counted(2)] = key("Samples of each path.", 151)
    rounds: Count = key("Timed calls of each law on each motion, after one that is not counted.", 3)
    example: Example = key("The motion of the detailed view; by default the first near-singular line.", Example())
    targets: Annotated[tuple[LawTarget, ...], LISTED] = key("Bounds that the report checks.", ())

    @model_validator(mode="after")
    def _fits(self) -> LawBlock:
        if self.plan not in [law.label for law in self.laws]:
            raise InvalidInput("plan", repr(self.plan), f"a label of its laws: {', '.join(x.label for x in self.laws)}")
        return self

    @classmethod
    def read(cls, data: Any) -> LawBlock:
        """Check the table, and complete the example."""
        block = super().read(data)
        return block.model_copy(update={"example": block._chosen(f"{cls.noun} {block.id!r}: example")})

    def _chosen(self, where: str) -> Example:
        """The example with all that it leaves out."""
        given, kinds = self.example, [part.label for part in self.lines]
        chosen = next((part for part in self.lines if part.kind == "near_singular"), self.lines[0])
        robot, kind = given.robot or chosen.robot, given.kind or chosen.label
        if kind not in MOTION_KINDS and kind not in kinds:
            raise InvalidInput(where, f"kind {kind!r}", f"one of {', '.join(dict.fromkeys(kinds))}")
        path = next((part.path for part in self.lines if part.label == kind), "")
        payload = given.payload
        if payload is None:
            payload = next((part.payload for part in self.lines if (part.robot, part.label) == (robot, kind)), None)
        labels = [part.label for part in self.limits]
        limits = given.limits or labels[0]
        if limits not in labels:
            raise InvalidInput(where, f"limits {limits!r}", f"a label of its limits: {', '.join(labels)}")
        update = {"robot": robot, "kind": "file" if path else kind, "limits": limits, "path": path, "payload": payload}
        return given.model_copy(update=update)

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The laws, then the peers; the reference is none of them."""
        return (*self.laws, *self.peers)

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the arms, in their order."""
        return tuple(dict.fromkeys(part.robot for part in self.lines))

    @property
    def arms(self) -> tuple[str, ...]:
        """What reports call the arms: each with each of its payloads."""
        return tuple(dict.fromkeys(part.arm for part in self.lines))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of motions as reports call them, in their order."""
        return tuple(dict.fromkeys(part.label for part in self.lines))

    @property
    def groups(self) -> tuple[str, ...]:
        """Kinds of motions, arms and limits, which a target may name."""
        return tuple(dict.fromkeys((*self.kinds, *self.arms, *(part.label for part in self.limits))))
