"""Entries of a block: methods, laws, peers, problem sets and arms as suites name them; judgement of their answers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from benchmarks import settings
from benchmarks.blocks.block import Block, Entry
from benchmarks.problems.base import SETS, ProblemSet
from benchmarks.records import RunFolder, slug
from benchmarks.settings import Flag, LawName, MaybeCount, Options, Settings, SolverName, default_label, key, named
from optik.arm.inertia import payload_masses
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.check import check_count
from optik.dynamics import torques_batch
from optik.errors import InvalidInput
from optik.ik import Tolerance
from optik.plugins.files import resolve_data_file
from optik.registry import build_method, short_name
from optik.scene import Scene
from optik.types import Array, Flags
from planners.limits import DERIVATIVES, LOADED, limit_names
from planners.trajectory import Trajectory

# ---------------- arms with a payload and scenes


def arm_label(robot: str, payload: float | tuple[float, float] | None) -> str:
    """Return the name of an arm in reports."""
    if payload is None:
        return short_name(robot)
    low, high = payload_masses(payload)
    return f"{short_name(robot)} " + (f"{low:g} kg" if low == high else f"{low:g} to {high:g} kg")


def arm_with(robot: str, payload: float | tuple[float, float] | None) -> Robot:
    """Load an arm and give it a payload."""
    arm = load(robot)
    return arm if payload is None else arm.with_payload(payload)


def _payload(value: Any) -> float | tuple[float, float]:
    try:
        low, high = payload_masses(value)
    except InvalidInput as error:
        raise InvalidInput("", error.got, error.expected) from None
    return high if low == high else (low, high)


Payload = Annotated[float | tuple[float, float] | None, BeforeValidator(_payload)]
"""Mass of the payload [kg], or the lightest and the heaviest; by default that of the robot's own file."""


SCENES = {file.stem: str(file) for file in sorted((Path(__file__).parent / "scenes").glob("*.toml"))}
"""Files of the built-in scenes by name."""


def _scene(value: Any) -> str:
    if isinstance(value, str) and value in SCENES:
        return value
    if isinstance(value, str) and "." not in value and "/" not in value:
        raise InvalidInput("", repr(value), f"one of {', '.join(SCENES)}, or the path of a file")
    return resolve_data_file(value, "scene")


SceneName = Annotated[str, BeforeValidator(_scene)]
"""The name of a built-in scene, or the path of a file."""


def scene_named(name: str, margin: float = 0.0) -> Scene:
    """Load a scene; a margin [m] replaces the scene's own."""
    scene = Scene.load(SCENES.get(name, name))
    return replace(scene, margin=margin) if margin else scene


JOINT_LIMITS = (*DERIVATIVES, *LOADED)
"""Limits on every joint: for each, reports show the largest ratio to it, with its joint and its time."""


def sample_torques(robot: Robot, motion: Trajectory, t: Array) -> tuple[Array, Array]:
    """Return torques and their rates at instants."""
    states = np.ascontiguousarray(np.stack([motion(t, order) for order in range(4)], axis=1))
    found = []
    for held in robot.loads:
        out = np.empty((t.size, 2, robot.n))
        torques_batch(robot.chain, held.bodies, held.viscous, states, out)
        out[:, 0] += held.coulomb * np.sign(states[:, 1])
        found.append(out)
    stacked = np.stack(found)
    return stacked[:, :, 0], stacked[:, :, 1]


# ---------------- entries and problem sets of a block as a suite's file has them


LABEL_MEANING = "Name in reports; by default its own."
"""Meaning of the key `label`."""


class Method(Settings):
    """An IK method."""

    solver: SolverName = key("IK method: a name from `optik doctor`, or the path of a file.")
    label: str = Field(default_factory=default_label("solver"), description=LABEL_MEANING)
    options: Options = key("Options of the method.", {})
    max_problems: MaybeCount = key("Largest number of problems, for slow methods; by default all.", None)

    def entry(self) -> Entry:
        """Return the method as an entry of the block."""
        return Entry(self.label, self.solver, self.options, self.max_problems)


class BudgetedMethod(Method):
    """An IK method that only a budget stops, or with ``whole = true`` one with its default settings."""

    whole: Flag = key(
        "Whether each problem is one call with default settings and restarts, instead of one attempt.", False
    )

    def entry(self) -> Entry:
        """Return the method as an entry of the block."""
        for fixed in ("max_iterations", "max_restarts", "time_limit"):
            if fixed in self.options and not self.whole:
                expected = "budgets in place of it: one attempt, stopped at each budget; or whole = true"
                raise InvalidInput("", fixed, expected)
        return Entry(self.label, self.solver, self.options, self.max_problems, whole=self.whole)


def _limits(names: tuple[Any, ...]) -> tuple[str, ...]:
    if unknown := [limit for limit in names if limit not in limit_names()]:
        raise InvalidInput("", repr(unknown[0])[:60], f"limits out of {', '.join(limit_names())}")
    return names


class Law(Settings):
    """A time law."""

    law: LawName = key("Time law: a name, or the path of a file.")
    label: str = Field(default_factory=default_label("law"), description=LABEL_MEANING)
    options: Options = key("Options of the law.", {})
    without: Annotated[tuple[Any, ...], settings.LISTED, AfterValidator(_limits)] = key(
        "Limits that are hidden from the law; its motions are judged by them, too.", ()
    )

    def entry(self, role: str = "law") -> Entry:
        """Return the law as an entry of the block."""
        return Entry(self.label, self.law, self.options, role=role, without=self.without)


class IKPeer(Settings):
    """A method of another package."""

    peer: Annotated[str, named("benchmarks.peers.ik", "peer")] = key("IK peer: a name, or the path of a file.")
    label: str = Field(
        default_factory=lambda given: short_name(given["peer"]).replace("_", " "), description=LABEL_MEANING
    )
    max_problems: MaybeCount = key("Largest number of problems, for slow methods; by default all.", None)
    iterations: MaybeCount = key("Largest number of iterations, for methods that accept one.", None)

    def entry(self) -> Entry:
        """Return the peer as an entry of the block."""
        options = {} if self.iterations is None else {"iterations": self.iterations}
        return Entry(self.label, self.peer, options, self.max_problems, "peer")


class LawPeer(Settings):
    """A time law of another package."""

    peer: Annotated[str, named("benchmarks.peers.laws", "peer of time laws")] = key(
        "Peer of time laws: a name, or the path of a file."
    )
    label: str = Field(
        default_factory=lambda given: short_name(given["peer"]).replace("_", " "), description=LABEL_MEANING
    )
    max_lines: MaybeCount = key("Largest number of motions of each set, for slow laws; by default all.", None)

    def entry(self) -> Entry:
        """Return the peer as an entry of the block."""
        return Entry(self.label, self.peer, {}, self.max_lines, "peer")


TRIAL_PROBLEMS = 5
"""Number of problems sampled to check the options of a set: enough to use every option, few enough to cost nothing."""


class ProblemBlock(Block):
    """A block of IK problems: one problem set on one robot."""

    robot: settings.RobotName = key("The arm: a name, or the path of a file.")
    set: settings.SetName = key("The problem set: a name, or the path of a file.")
    options: Options = key("Options of the problem set.", {})

    @model_validator(mode="before")
    @classmethod
    def _find_file(cls, data: Any) -> Any:
        if isinstance(data, dict) and data.get("set") == "file" and isinstance(data.get("options"), dict):
            options = data["options"]
            if "path" in options:
                path = resolve_data_file(options["path"], "options: path")
                data = data | {"options": options | {"path": path}}
        return data

    def draw(self, seed: int) -> tuple[Robot, ProblemSet]:
        """Return the robot, and sample the problems."""
        robot = load(self.robot)
        return robot, build_method(SETS, self.set, "problem set", robot, seed, **self.options)


def check_set(block: ProblemBlock) -> None:
    """Raise InvalidInput for wrong options of a problem set, by sampling a few problems of it."""
    with settings.naming(f"block {block.id!r}: options"):
        _draw_few(block)


def _draw_few(block: ProblemBlock) -> None:
    if "count" in block.options:
        check_count(block.options["count"], "count", 1)
        block = block.model_copy(
            update={"options": block.options | {"count": min(int(block.options["count"]), TRIAL_PROBLEMS)}}
        )
    block.draw(0)


def about_file(block: Block) -> str:
    """Return the name of the file with the hash of the problems of a block."""
    return f"problems/{slug(block.id)}.json"


def check_same(block: Block, before: str | None, now: str) -> None:
    """Raise InvalidInput if a resumed run would have other problems."""
    if before is not None and before != now:
        expected = f"{before[:16]}…, as when the run began; use another --out"
        raise InvalidInput(f"block {block.id!r}", f"problems with SHA-256 {now[:16]}…", expected)


def record_hash(folder: RunFolder, block: Block, about: dict[str, Any]) -> None:
    """Write the hash of the problems of a block, or check that those of a resumed run have the same."""
    before = folder.read_json(about_file(block))
    check_same(block, None if before is None else str(before.get("sha256")), about["sha256"])
    if before is None:
        folder.write_json(about_file(block), about)


def store_problems(
    folder: RunFolder, block: ProblemBlock, robot: Robot, problems: ProblemSet, *, poses: bool = True
) -> None:
    """Write the problems of a block and their hash, or check that those of a resumed run are the same."""
    name = f"problems/{slug(block.id)}.parquet"
    about = {"sha256": problems.sha256, "problems": len(problems), "known": int(problems.known.sum())}
    record_hash(folder, block, about)
    if not folder.has(name):
        frame = problems.frame(robot)
        folder.write(name, frame if poses else frame.drop("target", "start"))


def need_problems(rows: pl.DataFrame, block: Block) -> pl.DataFrame:
    """Return rows that have the columns of their problems; raise InvalidInput if they were not found."""
    if "group" not in rows.columns:
        words = f"no problems of the block {block.id!r}"
        raise InvalidInput("run", words, "a complete run; delete the rows of the block and repeat the run")
    return rows


# ---------------- judgement of answers by our own forward kinematics and limits


JUDGED_AT = (1e-3, 1e-6, 1e-9)
"""Tolerances [m and rad] for judging answers: coarse, that of a solved problem, and near the precision of a double.

The forward kinematics agrees with extended precision to 1e-15 m and rad on all arms of optik, six orders of magnitude below the
finest tolerance.
"""


def level_name(tolerance: float) -> str:
    """Return a tolerance as keys and names of measures have it: 1e-6."""
    return f"{tolerance:.0e}".replace("e-0", "e-")


def level_words(tolerance: float) -> str:
    """Return a tolerance as reports write it: 1e−6."""
    return level_name(tolerance).replace("-", "−")


def solved_at(tolerance: float) -> pl.Expr:
    """Say whether the answer of a row meets its target within a tolerance, with every joint inside its limits."""
    return pl.col("inside") & within(tolerance)


def within(tolerance: float) -> pl.Expr:
    """Say whether BOTH errors of a row are within a tolerance."""
    return (pl.col("position_error") <= tolerance) & (pl.col("rotation_error") <= tolerance)


def shared(rows: pl.DataFrame, labels: tuple[str, ...] | None = None) -> pl.DataFrame:
    """Return the rows of some methods, or of all, on the problems given to all of them."""
    chosen = rows if labels is None else rows.filter(pl.col("method").is_in(labels))
    return chosen.filter(pl.col("method").n_unique().over("problem") == chosen["method"].n_unique())


def judge_configurations(robot: Robot, targets: Array, q: Array) -> tuple[Flags, Array, Array]:
    """Return which configurations are inside the limits, and their position and rotation errors [m, rad]."""
    e = robot.pose_errors(q, targets) if len(q) else np.empty((0, 6))
    return robot.limits.contains(q), np.linalg.norm(e[:, :3], axis=1), np.linalg.norm(e[:, 3:], axis=1)


def judged(robot: Robot, targets: Array, answers: list[Array], *, wraps: bool) -> pl.DataFrame:
    """Judge the answers of calls: one row per target, of its best answer.

    A target is solved if any answer meets it within `Tolerance()` inside the limits. Of several answers, one inside the
    limits counts before one outside, then the smaller error.
    """
    owner = np.repeat(np.arange(len(answers)), [len(a) for a in answers])
    q = np.concatenate([np.empty((0, robot.n)), *answers])
    keep = np.isfinite(q).all(axis=1)
    q, owner = q[keep], owner[keep]
    if wraps:
        q = wrapped(robot, q)
    inside, position, rotation = judge_configurations(robot, targets[owner], q)
    tolerance = Tolerance()
    size = np.maximum(position / tolerance.position, rotation / tolerance.rotation)
    order = np.lexsort((size, ~inside, owner))
    first = order[np.unique(owner[order], return_index=True)[1]]  # the best answer of each target that has one
    k = len(answers)
    rows: dict[str, NDArray[Any]] = {
        "solved": np.zeros(k, dtype=bool),
        "inside": np.zeros(k, dtype=bool),
        "position_error": np.full(k, np.nan),
        "rotation_error": np.full(k, np.nan),
    }
    at = owner[first]
    rows["solved"][at] = inside[first] & (size[first] <= 1.0)
    rows["inside"][at] = inside[first]
    rows["position_error"][at], rows["rotation_error"][at] = position[first], rotation[first]
    return pl.DataFrame(rows)


def wrapped(robot: Robot, q: Array) -> Array:
    """Add full turns to revolute joints outside their limits, to bring them inside if possible."""
    lower, upper = robot.limits.lower, robot.limits.upper
    turn = 2.0 * np.pi
    up = q + turn * np.ceil(np.maximum(lower - 1e-9 - q, 0.0) / turn)
    moved = up - turn * np.ceil(np.maximum(up - upper - 1e-9, 0.0) / turn)
    return np.where(robot.prismatic, q, moved)
