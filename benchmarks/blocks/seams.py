"""Seams among boxes, drawn or published: as whole paths, followed one way alone, and both with freedoms of the tool."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import product
from typing import Annotated, Any, NamedTuple
from zlib import crc32

import numpy as np
import polars as pl
from pydantic import BeforeValidator, model_validator
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from benchmarks.blocks.base import NUMBER, TEXT, WHOLE, Field, Kind, Session, Trials, fields_of
from benchmarks.blocks.block import Block, Column, Entry, count, mean, median, quantile, share
from benchmarks.blocks.timing.settings import LimitSet
from benchmarks.problems.seam_files import EXPECTED, PublishedSeam, find_seam_files, read_seams
from benchmarks.settings import Count, Flag, MaybeCount, RobotName, counted, key, naming, numbered
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.check import format_value
from optik.errors import InvalidInput
from optik.plugins.files import resolve_data_files
from optik.registry import short_name
from optik.scene import Scene
from optik.scene.contact import find_nearest_pairs
from optik.types import Array
from planners.paths.free_path import free
from planners.paths.polyline import Polyline
from planners.plan import plan
from planners.program.parts import Program

WAYS, FREE = {"whole path": "auto", "local": "local"}, ", free"
"""Labels of both ways with their `resolve`, and what is added to the label where the freedoms are free."""
TOLERANCE = (1e-4, 1e-4)
"""Largest distance [m] and angle [rad] of the tool from a seam."""
BLEND = 1e-3
"""Largest distance from a pose of a seam [m]."""
ROOM, REGULAR = 0.005, 0.02
"""Least clearance [m] and least singular value of the motion that a seam is swept from."""
FREE_SAMPLES, NEAR = 400, (0.8, 2.5)
"""Configurations from which a motion is drawn, and the distances between two that follow each other [rad, m]."""
FEWEST, MOTIONS, MOST_SCENES = 20, 30, 1000
"""Free configurations that are enough for some boxes, tries of a motion among them, and most tries of boxes."""

MEASURES = (
    Column("seams", "seams", show="count", of=len),
    Column("certified", "certified", "%", "more", "share", of=share("certified")),
    Column("reconfigurations", "mean reconfigurations", of=mean("reconfigurations", among="certified")),
    Column("median_duration", "median duration", "s", of=median("duration")),
    Column("median_ratio", "median duration over local's", of=median("ratio")),
    Column("both", "certified by both ways", show="count", aside=True, of=count(pl.col("ratio").is_not_null())),
    Column("median_ms", "median CPU time of a plan", "ms", "less", of=quantile("ms", 0.5)),
    Column("p95_ms", "p95 CPU time of a plan", "ms", "less", of=quantile("ms", 0.95)),
    Column("sequence_ms", "median time of the sequence", "ms", of=median("sequence_ms")),
)
"""Measures: columns of the table of a block, which its targets can name."""


def _find_files(name: Any) -> tuple[str, ...]:
    """Return the paths of the files of a file or a folder, which starts at the suite's folder."""
    if not isinstance(name, str) or not name:
        raise InvalidInput("", format_value(name, 60), EXPECTED)
    return resolve_data_files(name, find_seam_files)


class SeamsBlock(Block):
    """Seams of an arm among boxes, without a start."""

    noun = "seams block"
    measures = MEASURES
    not_problems = frozenset({"reconfigurations"})

    robot: RobotName = key("The arm: a name, or the path of a file; it must have shapes.")
    files: Annotated[tuple[str, ...], BeforeValidator(_find_files)] = key(
        "Copy of the repository of CppFlow or IKLink, or a problem or a trace in it; by default the block generates seams.",
        (),
    )
    boxes: Count = key("Number of boxes around the arm.", 5)
    poses: Count = key("Number of poses of a seam.", 400)
    turn: Annotated[float, numbered("radians, 0 or more", least=0.0)] = key(
        "Range of the turn of the tool by which a generated seam was swept, and which is free in further rows.",
        0.0,
        "rad",
    )
    tilt: Annotated[float, numbered("radians, 0 or more", least=0.0)] = key("Range of its tilt.", 0.0, "rad")
    count: MaybeCount = key(
        "Number of seams; required, except with `files`, where it is by default all of the arm.", None
    )
    limits: LimitSet = key("Limits of the motions, as in `[[timing]]`.")
    reconfigurations: Annotated[int, counted(0)] = key("Most reconfigurations along a seam.", 0)
    contact: Flag = key("Whether contact is judged, of links too; `false` plans without shapes and boxes.", True)

    @model_validator(mode="after")
    def _drawn_or_given(self) -> SeamsBlock:
        if drawn := sorted(self.model_fields_set & {"boxes", "poses"}) if self.files else []:
            raise InvalidInput("files", f"with {drawn[0]}", "without it, because files have their own boxes and poses")
        if not self.files and self.count is None:
            raise InvalidInput("count", "none", "a number of seams, or files")
        return self

    @property
    def freedoms(self) -> dict[str, Any]:
        """Ranges of the freedoms by their kinds."""
        return {kind: most for kind, most in (("turn", self.turn), ("tilt", self.tilt)) if most > 0.0}

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Both ways, along the given seam and along that with freedoms."""
        kinds = ("", FREE) if self.freedoms else ("",)
        return tuple(Entry(way + kind, how, {}) for kind in kinds for way, how in WAYS.items())


# ---------------------------------------------------------------- problems


class Seam(NamedTuple):
    """Boxes, a seam, and the joints q (k, n) [rad, m] and freedoms f (k, d) [rad] by which its poses were swept."""

    scene: Scene
    path: Polyline
    q: Array
    f: Array


def draw_seams(
    robot: Robot, rng: np.random.Generator, boxes: int, poses: int, freedoms: dict[str, float]
) -> Iterator[Seam]:
    """Yield seams that a collision-free, regular motion follows, with freedoms that wave; raise InvalidInput without one."""
    while True:
        scene, q = _draw_motion(robot, rng, boxes, poses)
        T, f = robot.fk(q), np.zeros((poses, 3))
        wave = rng.uniform(1.0, 3.0) * np.linspace(0.0, 2.0 * np.pi, poses) + rng.uniform(0.0, 6.0)
        f[:, 0] = 0.9 * freedoms.get("turn", 0.0) * np.sin(wave)
        round_about = np.linspace(0.0, 4.0, poses)
        f[:, 1:] = 0.8 * freedoms.get("tilt", 0.0) * np.column_stack([np.cos(round_about), np.sin(round_about)])
        T[:, :3, :3] = T[:, :3, :3] @ np.swapaxes(Rotation.from_euler("ZXY", f).as_matrix(), 1, 2)
        try:
            path = Polyline(T, blend=BLEND)
        except InvalidInput:
            continue  # a reversal
        yield Seam(scene, path, q, f[:, [i for i, kind in enumerate(("turn", "tilt", "tilt")) if kind in freedoms]])


def _draw_boxes(rng: np.random.Generator, count: int) -> Scene:
    boxes = []
    for _ in range(count):
        T, angle, radius = np.eye(4), rng.uniform(-np.pi, np.pi), rng.uniform(0.35, 0.8)
        T[:3, :3] = Rotation.from_quat(rng.normal(size=4)).as_matrix()
        T[:3, 3] = radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0.1, 0.9)
        boxes.append((T, rng.uniform(0.08, 0.25, 3)))
    return Scene(boxes=tuple(boxes))


def _draw_motion(robot: Robot, rng: np.random.Generator, boxes: int, count: int) -> tuple[Scene, Array]:
    """Return boxes and a joint motion (count, n) through four configurations."""
    for _ in range(MOST_SCENES):
        scene = _draw_boxes(rng, boxes)
        q = 0.9 * robot.limits.sample(rng, FREE_SAMPLES) + 0.1 * robot.limits.middle
        q = q[find_nearest_pairs(robot, scene, q)[0] > 2.0 * ROOM]
        for _ in range(MOTIONS if len(q) >= FEWEST else 0):
            way = [q[rng.integers(len(q))]]
            for _ in range(3):
                away = np.linalg.norm(q - way[-1], axis=1)
                near = q[(away > NEAR[0]) & (away < NEAR[1])]
                if not len(near):
                    break
                way.append(near[rng.integers(len(near))])
            if len(way) < 4:
                continue
            u = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1)))
            x = CubicSpline(u, way, bc_type="natural")(np.linspace(0.0, u[-1], count))
            free_of = find_nearest_pairs(robot, scene, x)[0].min() > ROOM
            if robot.limits.contains(x).all() and free_of and robot.singular_values(x)[:, -1].min() > REGULAR:
                return scene, x
    raise InvalidInput("boxes", f"{boxes} boxes: no motion of {robot.name} in {MOST_SCENES:,} tries", "fewer boxes")


def draw(block: SeamsBlock, arm: Robot, seed: int, number: int) -> Seam:
    """Sample one seam."""
    rng = np.random.default_rng((seed, crc32(short_name(block.robot).encode()), number))
    return next(draw_seams(arm, rng, block.boxes, block.poses, block.freedoms))


def solve(block: SeamsBlock, arm: Robot, seam: Seam | PublishedSeam, entry: Entry) -> dict[str, Any]:
    """Return the row of one seam and one way."""
    path: Any = seam.path
    scene = seam.scene if block.contact else None
    paths = [part.goal for part in path.parts] if isinstance(path, Program) else [path]
    begin = time.process_time()
    found = plan(
        arm if block.contact else arm.with_shapes(None),
        free(path, **block.freedoms) if entry.label.endswith(FREE) else path, limits=block.limits.of(arm), scene=scene,
        tolerance=TOLERANCE, resolve=entry.name, reconfigurations=0 if isinstance(path, Program) else block.reconfigurations,
    )  # fmt: skip
    made = found.resolution
    return {
        "method": entry.label, "seam": seam.name if isinstance(seam, PublishedSeam) else "", "status": str(found.status),
        "reason": found.failure.reason if found.failure else "", "ms": 1e3 * (time.process_time() - begin),
        "certified": bool(found), "length": sum(one.end for one in paths),
        "duration": found.trajectory.duration if found else None, "sequence_ms": 1e3 * made.seconds if made else None,
        "reconfigurations": len(made.cuts) if made else 0,
    }  # fmt: skip


FIELDS = {
    "method": TEXT, "problem": WHOLE, "seam": TEXT, "status": Field(pl.String, "crashed"), "reason": TEXT, "length": NUMBER,
    "certified": Field(pl.Boolean, False, "certificate valid", "%", "more", exact=True),
    "duration": Field(pl.Float64, None, "duration", "s", "less", only="certified"), "reconfigurations": WHOLE,
    "ms": Field(pl.Float64, None, "CPU time of a plan", "ms", "less", only="certified", clock="cpu"),
    **fields_of(NUMBER, "sequence_ms"),
}  # fmt: skip
"""Fields of the rows."""


class _Seams(Kind):
    """Blocks of seams among boxes."""

    name = "seams"
    title = "Seams among boxes"
    block = SeamsBlock
    fields = FIELDS
    order = 63

    def prepare(self, block: SeamsBlock, seed: int) -> list[PublishedSeam]:
        """Check arm and limits, and read the seams, or sample the first one."""
        arm = load(block.robot)
        with naming(f"seams {block.id!r}"):
            if block.contact or not block.files:
                Scene().pair_mask(arm)
            block.limits.of(arm)
            if not block.files:
                draw(block, arm, seed, 0)
                return []
            with naming("files"):
                seams = read_seams(block.files, arm)[: block.count]
            for seam in seams:
                if block.freedoms and isinstance(seam.path, Program):
                    raise InvalidInput(
                        "turn, tilt", f"{seam.name}, which reverses", "seams without a stop, or neither key"
                    )
            return seams

    def share(self, session: Session) -> Robot:
        """Return the arm, after the plans of the first seam, and of the first one with stops, which compile."""
        block, arm = session.block, load(session.block.robot)
        first = {type(seam.path): seam for seam in session.prepared[::-1]}.values() or [
            draw(block, arm, session.seed, 0)
        ]
        for seam, entry in product(first, block.entries):
            solve(block, arm, seam, entry)
        return arm

    def count(self, block: SeamsBlock, session: Session) -> int:
        return len(session.prepared) or block.count or 0

    def solve(self, trials: Trials) -> Iterator[dict[str, Any]]:
        """Plan every seam in all ways."""
        assert trials.session is not None
        block, arm, given = trials.block, trials.session.shared, trials.session.prepared
        for problem in trials.numbers:
            seam = given[problem] if given else draw(block, arm, trials.seed, problem)
            yield from (solve(block, arm, seam, entry) | {"problem": problem} for entry in block.entries)

    def complete(self, rows: pl.DataFrame, block: SeamsBlock) -> pl.DataFrame:
        """Add the duration over that of the local way along the same seam."""
        local = pl.col("duration").filter(pl.col("method").str.starts_with("local")).first()
        return rows.with_columns(ratio=pl.col("duration") / local.over("problem", pl.col("method").str.ends_with(FREE)))


METHOD = _Seams
