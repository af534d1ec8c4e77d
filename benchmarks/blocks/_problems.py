"""Base of blocks of IK problems: one problem set on one robot."""

from __future__ import annotations

from typing import Any

import polars as pl
from pydantic import model_validator

from benchmarks.blocks.base import Block
from benchmarks.problems.base import SETS, ProblemSet
from benchmarks.records import RunFolder, slug
from benchmarks.settings import Options, RobotName, SetName, key, naming
from optik.arm.library import load
from optik.arm.robot import Robot
from optik.check import check_count
from optik.errors import InvalidInput
from optik.plugins.usage import resolve_data_file
from optik.registry import build_method

TRIAL_PROBLEMS = 5
"""Number of problems sampled to check the options of a set: enough to use every option, few enough to cost nothing."""


class ProblemBlock(Block):
    """A block of IK problems: one problem set on one robot."""

    robot: RobotName = key(
        "The arm: a name from `optik robots`, or a file; behind a URDF perhaps `#tip=LINK&base=LINK`."
    )
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
