"""Blocks of IK problems: one problem set on one robot, as several kinds have them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from benchmarks.blocks.base import Block
from benchmarks.problems.base import SETS, ProblemSet, problem_set
from benchmarks.records import RunFolder, slug
from benchmarks.settings import check_keys, check_known, check_table, naming
from optik.arm.robot import Robot
from optik.check import check_count
from optik.errors import InvalidInput
from optik.plugins.usage import resolve_data_file

TRIAL_PROBLEMS = 5
"""Problems that are drawn to check the options of a set: enough to meet every option, few enough to cost nothing."""


@dataclass(frozen=True, kw_only=True)
class ProblemBlock(Block):
    """A block of IK problems.

    Attributes
    ----------
    robot : str
        The arm: a name from `optik robots`, or the path of a file; behind a URDF perhaps ``#tip=LINK&base=LINK``.
    set : str
        The problem set: a name, or the path of a file.
    options : dict
        Options of the problem set.
    """

    robot: str
    set: str
    options: dict[str, Any]

    @property
    def robots(self) -> tuple[str, ...]:
        """The one arm."""
        return (self.robot,)


def named(data: Any, what: str) -> str:
    """How errors call a block: its kind and its id."""
    return f"{what} {data.get('id', '?')!r}" if isinstance(data, dict) else what


def read_problems(data: Any, where: str, known: set[str], need: set[str]) -> dict[str, Any]:
    """Check what every block of IK problems has: id, title, robot, set and options."""
    check_keys(data, {"id", "title", "robot", "set", "options"} | known, where, need={"id", "robot", "set"} | need)
    robot, drawn = check_known(data["robot"], "optik.robots", "robot"), check_known(data["set"], SETS, "problem set")
    options = dict(check_table(data.get("options", {}), f"{where}: options"))
    if drawn == "file" and "path" in options:
        options["path"] = resolve_data_file(options["path"], f"{where}: options: path")
    return {
        "id": str(data["id"]), "title": str(data.get("title", data["id"])), "robot": robot, "set": drawn,
        "options": options,
    }  # fmt: skip


def check_set(block: ProblemBlock) -> None:
    """Refuse wrong options of a problem set, by drawing a few problems of it."""
    with naming(f"block {block.id!r}: options"):
        _draw_few(block)


def _draw_few(block: ProblemBlock) -> None:
    if "count" in block.options:
        check_count(block.options["count"], "count", 1)
        block = replace(block, options=block.options | {"count": min(int(block.options["count"]), TRIAL_PROBLEMS)})
    problem_set(block, 0)


def about_file(block: Block) -> str:
    """Name of the file with the hash of the problems of a block."""
    return f"problems/{slug(block.id)}.json"


def check_same(block: Block, before: str | None, now: str) -> None:
    """Refuse to continue a run with other problems."""
    if before is not None and before != now:
        expected = f"{before[:16]}…, as when the run began; use another --out"
        raise InvalidInput(f"block {block.id!r}", f"problems with SHA-256 {now[:16]}…", expected)


def store_problems(
    folder: RunFolder, block: ProblemBlock, robot: Robot, problems: ProblemSet, *, poses: bool = True
) -> None:
    """Write the problems of a block and their hash, or check that those of a continued run are the same."""
    name, about = f"problems/{slug(block.id)}.parquet", about_file(block)
    before = folder.read_json(about)
    check_same(block, None if before is None else str(before.get("sha256")), problems.sha256)
    if not folder.has(name):
        frame = problems.frame(robot)
        folder.write(name, frame if poses else frame.drop("target", "start"))
    if before is None:
        folder.write_json(
            about, {"sha256": problems.sha256, "problems": len(problems), "known": int(problems.known.sum())}
        )
