"""Path and time together: the duration of a motion whose path has freedoms, and of the same motion along the initial path."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from itertools import pairwise
from typing import Annotated, Any
from zlib import crc32

import numpy as np
import polars as pl
from pydantic import AfterValidator, model_validator

from benchmarks import settings
from benchmarks.blocks.base import NUMBER, TEXT, WHOLE, Field, Kind, Session, Trials, fields_of
from benchmarks.blocks.block import Block, Column, Entry, Of, Target, largest, quantile, share
from benchmarks.blocks.entries import Payload, arm_label
from benchmarks.blocks.timing.motions import draw_motion_of
from benchmarks.blocks.timing.rows import in_group
from benchmarks.blocks.timing.settings import LimitSet
from benchmarks.peers.base import Absent
from benchmarks.problems.base import start_of
from benchmarks.records import RunFolder
from benchmarks.settings import LISTED, Count, Flag, Joints, RobotName, Settings, key, numbered, one_of
from benchmarks.statistics import quantiles
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.errors import InvalidInput, NoSolution
from optik.types import Array
from planners.certificate.analysis import MotionAnalysis
from planners.certificate.certification import certify
from planners.freedom import freedom_of, freedoms
from planners.limits import MotionLimits
from planners.motion import PlanStatus
from planners.motion.motion import stretch_analysed
from planners.paths.base import Path
from planners.paths.free_path import free
from planners.paths.joint_line import JointLine
from planners.paths.point_to_point import PointToPoint, ViaPoint
from planners.plan import Plan, plan

ALONG_INITIAL, CHOSEN = "initial path", "path and time"
"""Labels of both motions: the paths of a set without and with freedoms."""
DRAKE = "drake"
"""Names of the peers that choose path and time."""

VIA_TOLERANCE = (5e-3, 0.09)
"""Largest distance [m] and angle [rad] of the tool from a via pose of a cycle."""

TORCH = (0.05, 0.1)
"""Offset of a torch's tip from the flange, along its x and z axes [m]."""

SHOWN_INSTANTS = 251
"""Number of stored instants of the motion of an example."""


_both = pl.col("ratio").is_not_null()


def _median(column: str) -> Of:
    return quantile(column, 0.5, among=_both)


def _span(least: float, most: float) -> Of:
    """Return the computation of two quantiles of the duration ratios, as text."""
    return lambda rows: " to ".join(f"{x:.3g}" for x in quantiles(rows["ratio"].drop_nulls().to_numpy(), (least, most)))


MEASURES = (
    Column("motions", "n", show="count", of=len),
    Column("solved", "motions found", "%", show="share", aside=True, of=share("solved")),
    Column("certified", "certified", "%", show="share", of=share("certified")),
    Column("median_before", "median before", "s", of=_median("before")),
    Column("median_duration", "median after", "s", of=_median("duration")),
    Column("median_ratio", "median after / before", of=_median("ratio")),
    Column("quartiles", "quartiles", show="text", of=_span(0.25, 0.75)),
    Column("worst_ratio", "largest after / before", show="exact", aside=True, of=largest("ratio")),
    Column("median_ms", "median time of a plan", "ms", of=_median("ms")),
    Column("median_ms_fixed", "median time of a plan of the initial path", "ms", aside=True, of=_median("ms_fixed")),
    Column("steps", "median Newton steps", show="count", aside=True, of=_median("steps")),
    Column("starts", "median initial guesses", show="count", aside=True, of=_median("starts")),
)
"""Measures: columns of the table of a block, which its targets can name."""


class FreeSet(Settings):
    """Motions of a kind on a robot, and the freedom of their paths."""

    robot: RobotName = key("The arm: a name, or the path of a file.")
    kind: Annotated[str, one_of("regular", "near_singular", "arc", "seam", "joints", "cycle")] = key(
        "Paths of the tool as in `[[timing]]` (`regular`, `near_singular`, `arc`, `seam`), `joints` (random moves), "
        "`cycle` (pick and place through six via poses, within 5 mm and 0.09 rad)."
    )
    count: Count = key("Number of motions.")
    freedom: str = key("For paths of the tool: `turn`, `tilt` or `elbow`; joint moves and cycles need none.", "")
    hold_start: Flag = key("Whether the motion starts at the given configuration, with all coordinates at 0.", False)
    payload: Payload = key("Mass in the tool, or [lightest, heaviest]; by default that of the robot file.", None, "kg")
    torch_deg: Annotated[float | None, numbered("degrees")] = key(
        "Angle between a torch and the flange's axis; by default the tool of the robot file.", None, "degrees"
    )
    home_deg: Joints = key("Configuration at both ends of a cycle; joint 1 is varied by 1 rad.", (), "degrees, mm")

    @model_validator(mode="after")
    def _fits(self) -> FreeSet:
        needs = self.kind not in ("joints", "cycle")
        if (self.freedom not in freedoms()) if needs else bool(self.freedom):
            allowed = f"one of {', '.join(freedoms())}" if needs else f"none with the kind {self.kind!r}"
            raise InvalidInput("freedom", repr(self.freedom), allowed)
        if (self.kind == "cycle") != bool(self.home_deg):
            raise InvalidInput("home_deg", self.home_deg, "a configuration for the kind `cycle`, and only there")
        return self

    @property
    def label(self) -> str:
        """Name of the kind and of its freedom in reports and targets."""
        held = ", start held" if self.hold_start else ""
        return f"{self.kind.replace('_', '-')}, {self.freedom}{held}" if self.freedom else self.kind

    @property
    def arm(self) -> str:
        """Name of the arm in reports and targets, with payload and torch."""
        torch = "" if self.torch_deg is None else f", torch {self.torch_deg:g}°"
        return arm_label(self.robot, self.payload) + torch

    def load(self) -> Robot:
        """Return the arm with its payload and its torch."""
        return self.fit(load(self.robot))

    def fit(self, arm: Robot) -> Robot:
        """Give an arm the payload and the torch."""
        arm = arm if self.payload is None else arm.with_payload(self.payload)
        if self.torch_deg is None:
            return arm
        c, s = np.cos(np.radians(self.torch_deg)), np.sin(np.radians(self.torch_deg))
        return arm.with_tool([[c, 0, s, TORCH[0]], [0, 1, 0, 0], [-s, 0, c, TORCH[1]], [0, 0, 0, 1]])


def _different(sets: tuple[FreeSet, ...]) -> tuple[FreeSet, ...]:
    settings.check_different([f"{part.label} on {part.arm}" for part in sets], "", "set")
    return sets


class FreedomBlock(Block):
    """Motions × limits, each along the initial path and with path and time together."""

    noun = "freedom block"
    measures = MEASURES

    sets: Annotated[tuple[FreeSet, ...], LISTED, AfterValidator(_different)] = key("Sets of motions.")
    limits: Annotated[tuple[LimitSet, ...], LISTED, AfterValidator(settings.check_labels)] = key(
        "Limits of the motions."
    )
    peers: Annotated[tuple[Annotated[str, one_of(DRAKE)], ...], LISTED] = key(
        "Peers of path and time together: `drake` (only `joints`).", ()
    )

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The choice of path and time, and the peers."""
        return (Entry(CHOSEN, "optimal", {}), *(Entry(name, name, {}, role="peer") for name in self.peers))

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the arms, in their order."""
        return tuple(dict.fromkeys(part.robot for part in self.sets))

    @property
    def groups(self) -> tuple[str, ...]:
        """Kinds of motions, arms and limits, which a target can name."""
        named = (name for part in self.sets for name in (part.label, part.arm))
        return tuple(dict.fromkeys((*named, *(part.label for part in self.limits))))


# ---------------------------------------------------------------- problems


def draw(part: FreeSet, limits: Sequence[LimitSet], seed: int, index: int) -> tuple[Robot, Array, Path, Path]:
    """Sample one problem: arm, start, the initial path, and the path with freedoms."""
    arm = part.load()
    if part.kind == "cycle":
        q, path = _cycle(part, arm, np.random.default_rng((seed, crc32(part.arm.encode()), index)))
        return arm, q, path, path
    line = draw_motion_of(arm, part.robot, part.kind, index, seed, limits)
    if isinstance(line.path, JointLine):
        return arm, line.q_start, line.path, PointToPoint(arm, line.q_start, line.path.q_goal)
    given: dict[str, Any] = {part.freedom: 0.2 if part.freedom == "tilt" else True}
    return arm, line.q_start, line.path, free(line.path, hold_start=part.hold_start, **given)


def _cycle(part: FreeSet, arm: Robot, rng: np.random.Generator) -> tuple[Array, PointToPoint]:
    """Return home, and a path from home over a pick and a place to home: three via poses each, the middle one 0.1 m below."""
    home = start_of(arm, part.home_deg)
    home[0] += rng.uniform(-1.0, 1.0)
    vias, T = [], arm.fk(home)
    for reach in (0.1, 0.15):
        down = np.append(rng.uniform(-reach, reach, 2), rng.uniform(-0.15, -0.05))
        aside = [np.append(rng.uniform(-0.04, 0.04, 2), 0.1) for _ in range(2)]
        for move in (down + aside[0], down, down + aside[1]):
            pose = T.copy()
            pose[:3, 3] += move
            vias.append(ViaPoint(pose, VIA_TOLERANCE))
    return home, PointToPoint(arm, home, *vias, home)


def _timed(*given: Any, **limits: Any) -> tuple[Plan, float]:
    """Return a plan and its computing time [ms]."""
    begin = time.perf_counter()
    found = plan(*given, **limits)
    return found, 1e3 * (time.perf_counter() - begin)


def solve(
    part: FreeSet, limits: MotionLimits, problem: tuple[Robot, Array, Path, Path]
) -> tuple[dict[str, Any], list[Plan], Plan]:
    """Return the row of one problem, the plans along the initial path (of a cycle from stop to stop), and the chosen plan."""
    arm, q, initial, path = problem
    lines: list[Path] = [initial]
    if isinstance(initial, PointToPoint):
        lines = [JointLine(arm, a, b) for a, b in pairwise([q, *(via.q for via in initial.vias), q])]
    before = [_timed(arm, line, line.q_start if isinstance(line, JointLine) else q, limits=limits) for line in lines]
    (chosen, ms), plans = _timed(arm, path, q, limits=limits), [one for one, _ms in before]
    duration = sum(one.trajectory.duration for one in plans) if all(plans) else None
    row = {
        "status": str(chosen.status), "ms": ms, "ms_fixed": sum(each for _one, each in before),
        "stop_duration" if part.kind == "cycle" else "fixed_duration": duration, "certified": False,
    }  # fmt: skip
    if chosen and chosen.freedom is not None:
        told = ("fixed_duration", "gain", "starts", "steps", "gradient", "distance", "outcome")
        row |= {name: getattr(chosen.freedom, name) for name in told}
        row |= {"duration": chosen.trajectory.duration, "certified": bool(chosen.certificate.is_valid)}
    return row, plans, chosen


def solve_by_peer(
    name: str, limits: MotionLimits, problem: tuple[Robot, Array, Path, Path], ours: dict[str, Any]
) -> dict[str, Any]:
    """Return the row of a peer beside ours: its motion, slowed uniformly until it respects all limits."""
    arm, _q, _given, path = problem
    row = {key: ours.get(key) for key in ("fixed_duration", "stop_duration", "ms_fixed")} | {"certified": False}
    enforced = tuple(each for each in limits.names if limits.value(each) is not None)
    from benchmarks.peers.drake_moves import solve_by_drake

    try:
        raw, ms = solve_by_drake(arm, path, limits)
        motion = stretch_analysed(MotionAnalysis(arm, raw), limits, enforced).trajectory
    except (NoSolution, Absent) as error:
        return row | {"status": str(PlanStatus.TIMING_INFEASIBLE), "outcome": str(error)}
    proof = certify(arm, None, motion, limits, law=name, enforced=enforced)  # its spline in t has no parameter s
    status = PlanStatus.SOLVED if proof.is_valid else PlanStatus.NOT_PROVED
    row |= {"ms": ms, "starts": 1, "status": str(status), "outcome": "chosen", "certified": bool(proof.is_valid)}
    row |= {"duration": motion.duration, "own_duration": raw.duration}
    fixed = row["fixed_duration"]
    return row if fixed is None else row | {"gain": 1.0 - motion.duration / fixed}


# ---------------------------------------------------------------- examples


def _motion(plans: Sequence[Plan], label: str) -> pl.DataFrame:
    """Return a motion of one or more plans, one row for each instant and joint."""
    ends = np.cumsum([0.0, *(one.trajectory.duration for one in plans)])
    joints, frames = plans[0].robot.joint_names, []
    for one, begin in zip(plans, ends[:-1], strict=True):
        t = np.linspace(0.0, one.trajectory.end, max(2, SHOWN_INSTANTS // len(plans)))
        q, dq = (one.trajectory(t, order).ravel() for order in (0, 1))
        columns = {"t": np.repeat(begin + t, len(joints)), "joint": list(joints) * t.size, "q": q, "dq": dq}
        frames.append(pl.DataFrame({"motion": label, **columns}))
    return pl.concat(frames)


def _coordinates(found: Plan) -> pl.DataFrame:
    """Return the free coordinates along the path, with the allowed and the reached range of each."""
    own, arm = found.freedom, found.robot
    assert own is not None
    if own.ranges:
        named = [(f"{r.name} {k + 1}" if len(own.ranges) > 1 else r.name, r.unit, *r.allowed, *r.reached)
                 for k, r in enumerate(own.ranges)]  # fmt: skip
        s, values = own.s, own.values
    else:  # the joints themselves, of a free joint path
        s, low, high = np.linspace(0.0, found.joint_path.end, own.s.size), arm.limits.lower, arm.limits.upper
        values = (found.joint_path(s) - low) / (high - low)
        named = [
            (name, "", 0.0, 1.0, *ends)
            for name, *ends in zip(arm.joint_names, values.min(0), values.max(0), strict=True)
        ]
    names = ("coordinate", "unit", "least", "most", "reached_least", "reached_most")
    about = pl.DataFrame(named, schema=list(names), orient="row")
    return pl.concat([
        about[k].join(pl.DataFrame({"s": s, "value": values[:, k]}), how="cross") for k in range(len(named))
    ])  # fmt: skip


FIELDS = {
    "method": TEXT, "problem": WHOLE, **fields_of(TEXT, "kind robot limits"), "status": Field(pl.String, "crashed"),
    "outcome": TEXT, "certified": Field(pl.Boolean, False, "certificate valid", "%", "more", exact=True),
    **fields_of(NUMBER, "fixed_duration stop_duration"),
    "duration": Field(pl.Float64, None, "duration", "s", "less", only="solved"), "gain": NUMBER,
    **fields_of(WHOLE, "starts steps"), **fields_of(NUMBER, "gradient distance ms_fixed"),
    "ms": Field(pl.Float64, None, "time of a plan", "ms", "less", only="solved", clock="wall"), "own_duration": NUMBER,
    "solved": Field(pl.Boolean, None, "motions found", "%", "more", exact=True, stored=False),
}  # fmt: skip
"""Fields of the rows."""


class _Freedom(Kind):
    """Blocks of motions with freedoms."""

    name = "freedom"
    title = "Path and time together"
    block = FreedomBlock
    fields = FIELDS
    order = 62

    def prepare(self, block: FreedomBlock, seed: int) -> None:
        """Check the limits on every arm, and sample the first problem of each set."""
        for k, part in enumerate(block.sets):
            with settings.naming(f"freedom {block.id!r}: sets[{k}]"):
                arm = part.load()
                if part.freedom and not freedom_of(part.freedom).screws and arm.n <= 6:
                    came = f"{part.freedom!r} of {arm.name} with {arm.n} joints"
                    raise InvalidInput("freedom", came, "a freedom of the tool, or an arm with more than six joints")
                for limits in block.limits:
                    limits.of(arm)
                draw(part, block.limits, seed, 0)

    def count(self, block: FreedomBlock, session: Session) -> int:
        return sum(part.count for part in block.sets)

    def solve(self, trials: Trials) -> Iterator[dict[str, Any]]:
        """Solve some motions by all methods; the first of a set that became shorter is an example of the report."""
        assert trials.session is not None
        block, journal, folder = trials.block, trials.session.journal, trials.session.folder
        starts = np.cumsum([0, *(part.count for part in block.sets)])
        for problem in trials.numbers:
            k = int(np.searchsorted(starts, problem, "right")) - 1
            part, index = block.sets[k], problem - int(starts[k])
            drawn = draw(part, block.limits, trials.seed, index)
            for limits in block.limits:
                within = limits.of(drawn[0])
                about = {"problem": problem, "kind": part.label, "robot": part.arm, "limits": limits.label}
                if index == 0:
                    solve(part, within, drawn)  # compiles, and is not counted
                row, plans, chosen = solve(part, within, drawn)
                yield row | about | {"method": CHOSEN}
                for peer in block.peers:
                    why = journal.crashed.get(peer)
                    with journal.at_work(peer) if why is None else nullcontext():
                        by = solve_by_peer(peer, within, drawn, row) if why is None else self.lost(outcome=why)
                    yield by | about | {"method": peer}
                if all(plans) and chosen.freedom is not None and chosen.freedom.gain > 0.0:
                    self._store_example(folder, block, k, plans, chosen)

    def _store_example(
        self, folder: RunFolder, block: FreedomBlock, number: int, plans: Sequence[Plan], found: Plan
    ) -> None:
        """Write motions and coordinates of the first motion of a set that became shorter."""
        names = [self.file(block, f"{name}-{number}.parquet") for name in ("motion", "coordinates")]
        if not folder.has(names[1]):
            folder.write(names[0], pl.concat([_motion([found], CHOSEN), _motion(plans, ALONG_INITIAL)]))
            folder.write(names[1], _coordinates(found))

    def complete(self, rows: pl.DataFrame, block: FreedomBlock) -> pl.DataFrame:
        """Add whether there is a motion, and the ratio of the durations: over stops at each via pose of a cycle."""
        before = pl.coalesce("stop_duration", "fixed_duration")
        return rows.with_columns(
            solved=pl.col("duration").is_not_null(), before=before, ratio=pl.col("duration") / before
        )

    def judged_rows(self, rows: pl.DataFrame, target: Target) -> tuple[pl.DataFrame, str]:
        """Return our rows, or those of a named peer, of a group; of measures of durations and times those with a motion."""
        rows = in_group(rows if target.method else rows.filter(method=CHOSEN), target.group)
        if target.measure not in ("solved", "certified"):
            rows = rows.filter("solved", pl.col("ratio").is_not_null())
        return rows, f"{len(rows):,} motions"


METHOD = _Freedom
