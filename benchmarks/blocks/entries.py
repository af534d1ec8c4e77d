"""Entries and problem sets of a block as a suite's file has them: methods, laws and peers with options, and problems."""

from __future__ import annotations

from typing import Annotated, Any

import polars as pl
from pydantic import AfterValidator, Field, model_validator

from benchmarks.blocks.block import Block, Entry
from benchmarks.problems.base import SETS, ProblemSet
from benchmarks.records import RunFolder, slug
from benchmarks.settings import (
    LISTED,
    Flag,
    LawName,
    MaybeCount,
    Options,
    RobotName,
    SetName,
    Settings,
    SolverName,
    default_label,
    key,
    named,
    naming,
)
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.check import check_count
from optik.errors import InvalidInput
from optik.plugins.usage import resolve_data_file
from optik.registry import build_method, short_name
from planners.limits import limit_names

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
    without: Annotated[tuple[Any, ...], LISTED, AfterValidator(_limits)] = key(
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

    robot: RobotName = key("The arm: a name, or the path of a file.")
    set: SetName = key("The problem set: a name, or the path of a file.")
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
    with naming(f"block {block.id!r}: options"):
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
