"""Settings of blocks of timed lines: sets of motions and of limits, laws and peers, and one line for a detailed view."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from benchmarks import settings
from benchmarks.blocks.block import Block, Entry, Target
from benchmarks.blocks.entries import Law, LawPeer, Payload, SceneName, arm_label, arm_with, scene_named
from benchmarks.blocks.timing.rows import MEASURES
from benchmarks.settings import LISTED, Count, Entries, Joints, RobotName, Settings, Three, counted, key, one_of
from optik.arm.robot import Robot
from optik.errors import InvalidInput
from optik.plugins.files import resolve_data_file
from planners.limits import ALL_LIMITS, TOOL_SPEEDS, MotionLimits, limit_names

LINE_KINDS = {"regular": (0.05, np.inf), "near_singular": (0.02, 0.04)}
"""Range of the smallest singular value along the whole line, for each kind of line."""

GIVEN_LINE = "line"
"""Kind of a straight line that the suite gives."""

MOTION_KINDS = (*LINE_KINDS, "arc", "seam", "joints", GIVEN_LINE, "file")
"""All kinds of motions: straight lines of two kinds, other sampled ones, a given line, and those of a file."""

_KEYS_OF = {GIVEN_LINE: {"start_deg", "move_m"}, "file": {"path"}}
"""Keys of the kinds that are not sampled."""

OF_ROBOT = "robot"
"""Value of a limit in a suite for the limit of each robot."""


class LineSet(Settings):
    """Motions of a kind on a robot, sampled at random, or the one in a file."""

    robot: RobotName = key("The arm: a name, or the path of a file.")
    kind: Annotated[str, one_of(*MOTION_KINDS)] = key(
        "Straight lines (`regular`, `near_singular`), `arc`, `seam` (a polyline), `joints` (straight in joint space), a given "
        "`line`, or a `file`."
    )
    count: Count = key("Number of motions; required, except for the kinds `line` and `file`.", 1)
    start_deg: Joints = key("For the kind `line`: the start configuration.", (), "degrees, mm")
    move_m: Three = key("For the kind `line`: from its start to its end, in the base frame.", (0.0, 0.0, 0.0), "m")
    path: str = key("For the kind `file`: a table of waypoints, or a motion that `planners.save` wrote.", "")
    payload: Payload = key("Mass in the tool, or [lightest, heaviest]; by default that of the robot file.", None, "kg")

    @model_validator(mode="before")
    @classmethod
    def _count_or_path(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        given = _KEYS_OF.get(str(data.get("kind")), {"count"})
        settings.check_keys(data, {"robot", "kind", "payload", *given}, "", {"robot", "kind", *given})
        return data | {"path": resolve_data_file(data["path"], "path")} if "path" in given else data

    @property
    def label(self) -> str:
        """Name of the kind in reports and targets; for a file, the file's name."""
        return FilePath(self.path).name if self.path else self.kind

    @property
    def arm(self) -> str:
        """Name of the arm in reports and targets, with the payload if there is one."""
        return arm_label(self.robot, self.payload)

    def load(self) -> Robot:
        """Return the arm, with its payload."""
        return arm_with(self.robot, self.payload)


class LimitSet(Settings):
    """Limits of a motion: numbers, one for each joint, or ``"robot"`` for the robot's."""

    velocity: Any = key('Velocity limit: a number, one for each joint, or `"robot"`.', None, "rad/s, m/s")
    acceleration: Any = key("Acceleration limit.", None, "rad/s², m/s²")
    jerk: Any = key("Jerk limit.", None, "rad/s³, m/s³")
    torque: Any = key("Torque limit, for an arm with known masses.", None, "N·m, N")
    torque_rate: Any = key("Torque rate limit.", None, "N·m/s, N/s")
    tool_speed: Any = key("Limit on the speed of the tool point.", None, "m/s")
    rotation_speed: Any = key("Limit on the angular speed of the tool.", None, "rad/s")
    extra: dict[str, Any] = key("Further limits by name, a number or a table of fields; their names are keys, too.", {})
    label: str = Field(default_factory=lambda given: _words(given), description="Name of these limits in reports.")

    @model_validator(mode="before")
    @classmethod
    def _further(cls, data: Any) -> Any:
        """Collect the keys that are names of further limits."""
        if not isinstance(data, dict):
            return data
        further = {name: data[name] for name in data if name not in cls.model_fields and name in limit_names()}
        rest = {name: value for name, value in data.items() if name not in further}
        return rest | {"extra": dict(data.get("extra", {})) | further} if further else data

    @model_validator(mode="after")
    def _of_motions(self) -> LimitSet:
        if not self._given and not self.extra:
            raise InvalidInput("", "none", f"some of {', '.join(ALL_LIMITS)}")
        for field in self.own:
            if field in TOOL_SPEEDS:
                raise InvalidInput(field, repr(OF_ROBOT), "a number: robots have no limits of their own on the tool")
        _ = self.limits
        return self

    @property
    def _given(self) -> dict[str, Any]:
        return {field: value for field in ALL_LIMITS if (value := getattr(self, field)) is not None}

    @property
    def own(self) -> tuple[str, ...]:
        """Names of the limits that are the robot's."""
        return tuple(field for field, value in (self._given | self.extra).items() if value == OF_ROBOT)

    @property
    def limits(self) -> MotionLimits:
        """Limits that are numbers."""
        numbers = {field: value for field, value in self._given.items() if value != OF_ROBOT}
        return MotionLimits(**numbers, extra={name: value for name, value in self.extra.items() if value != OF_ROBOT})

    def of(self, robot: Robot) -> MotionLimits:
        """Return the limits on a robot."""
        theirs = MotionLimits.of(robot)
        values: dict[str, Any] = {name: theirs.value(name) for name in self.own}
        for name, value in values.items():
            if value is None:
                wanted = "numbers, or a robot whose file states this limit"
                if name in ("torque", "torque_rate"):
                    wanted += " and its masses"
                raise InvalidInput(f"limits {self.label!r}: {name}", f"{OF_ROBOT!r} with {robot.name}", wanted)
        joints = {name: value for name, value in values.items() if name in ALL_LIMITS}
        further = {name: value for name, value in values.items() if name not in ALL_LIMITS}
        found = replace(self.limits, **joints, extra=dict(self.limits.extra or {}) | further)
        found.bounds(robot.n)
        return found

    @property
    def counts_torque(self) -> bool:
        """Whether the torque is limited."""
        return "torque" in self.own or self.limits.torque is not None


def told(limits: MotionLimits, entry: Entry) -> MotionLimits:
    """Return the limits that a law receives: all but those that its entry excludes."""
    return limits.select(tuple(name for name in limits.names if name not in entry.without)) if entry.without else limits


def _words(given: dict[str, Any]) -> str:
    """Describe the limits, in the order of the file."""
    numbers = [
        f"own {field}" if value == OF_ROBOT else str(value)
        for field, value in given.items()
        if value is not None and field != "extra"
    ]
    further = [
        f"own {name}" if value == OF_ROBOT else name if isinstance(value, dict) else f"{name} {value}"
        for name, value in given["extra"].items()
    ]
    return ", ".join([*numbers, *(words.replace("_", " ") for words in further)])


class Example(Settings):
    """The motion of the report's detailed view."""

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
    settings.check_different([f"{part.label} of {part.arm}" for part in lines], "", "set")
    return lines


class LawBlock(Block):
    """Lines × limits × laws."""

    noun = "timing block"
    measures = MEASURES
    not_problems = frozenset({"plan", "detail"})

    lines: Annotated[tuple[LineSet, ...], LISTED, AfterValidator(_different_sets)] = key("Sets of motions (lines).")
    limits: Annotated[tuple[LimitSet, ...], LISTED, AfterValidator(settings.check_labels)] = key(
        "Limits of the joints and of the tool; each motion is timed within each."
    )
    laws: Annotated[tuple[Entry, ...], Entries(Law)] = key("Time laws of ours.")
    peers: Annotated[tuple[Entry, ...], Entries(LawPeer)] = key("Peers of time laws.", ())
    reference: Annotated[Entry | None, Entries(Law, single=True, role="reference")] = key(
        "Law for T*, the shortest known duration; a shorter motion of another law within all limits replaces it.", None
    )
    plan: str = Field(
        default_factory=lambda given: given["laws"][0].label,
        description="Label of the law with which whole plans are timed; by default the first.",
    )
    solvers: Annotated[tuple[settings.SolverName, ...], LISTED] = key(
        "IK methods that follow the paths, each for itself.", ("lm",)
    )
    scene: SceneName = key("Scene of whole plans: `shelf`, `table`, `plates`, or a file; by default none.", "")
    margin: Annotated[float, settings.numbered("metres, 0 or more", least=0.0)] = key(
        "Least distance between arm and scene.", 0.0, "m"
    )
    samples: Annotated[int, counted(2)] = key("Samples of each path.", 151)
    rounds: Count = key("Timed calls of each law on each motion, after one that is not counted.", 3)
    example: Example = key("The motion of the detailed view; by default the first near-singular line.", Example())
    detail: settings.Flag = key(
        "Whether the report shows joints, tool, arm and clearance along the example, for every law.", False
    )
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
        """Return the example with all defaults."""
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
        if kind == GIVEN_LINE and kind not in kinds:
            raise InvalidInput(where, f"kind {kind!r}", f"one of {', '.join(dict.fromkeys(kinds))}")
        update = {"robot": robot, "kind": "file" if path else kind, "limits": limits, "path": path, "payload": payload}
        return given.model_copy(update=update)

    @property
    def example_set(self) -> LineSet:
        """The set of the example: one of the block where its lines are given, else one of its kind."""
        chosen = self.example
        given: dict[str, Any] = {"robot": chosen.robot, "kind": chosen.kind}
        of = {part.kind: part for part in self.lines if part.kind == GIVEN_LINE}
        given |= {"path": chosen.path} if chosen.path else {"count": chosen.index + 1}
        given |= {} if chosen.payload is None else {"payload": chosen.payload}
        return of.get(chosen.kind) or LineSet.model_validate(given)

    @property
    def plan_options(self) -> dict[str, Any]:
        """Options of every whole plan: the samples, and the scene if there is one."""
        scene = {"scene": scene_named(self.scene, self.margin)} if self.scene else {}
        return {"samples": self.samples} | scene

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the arms, in their order."""
        return tuple(dict.fromkeys(part.robot for part in self.lines))

    @property
    def arms(self) -> tuple[str, ...]:
        """Names of the arms in reports: each with each of its payloads."""
        return tuple(dict.fromkeys(part.arm for part in self.lines))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of motions with their names in reports, in their order."""
        return tuple(dict.fromkeys(part.label for part in self.lines))

    @property
    def groups(self) -> tuple[str, ...]:
        """Kinds of motions, arms and limits, which a target can name."""
        return tuple(dict.fromkeys((*self.kinds, *self.arms, *(part.label for part in self.limits))))
