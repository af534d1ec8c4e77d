"""Plug-ins under the contract tests: the examples, and those that ``pytest --plugin GROUP=PATH`` names."""

from collections import defaultdict
from pathlib import Path

from optik.registry import names
from tests.oracles import REPOSITORY

EXAMPLES = {
    "optik.ik": "jt.py", "planners.timing": "law.py", "planners.paths": "spiral.py", "planners.files": "tsv.py",
    "planners.cell.drives": "lagging.py", "benchmarks.problems": "beside.py",
    "benchmarks.peers.ik": "scipy_least_squares.py", "benchmarks.peers.laws": "scipy_spline.py",
}  # fmt: skip
"""Files in ``examples/``, by their group."""

GIVEN: dict[str, list[str]] = defaultdict(list)
"""Absolute paths by group, as given on the command line."""


def outside(group: str) -> tuple[str, ...]:
    """Paths of all plug-ins of a group that are tested."""
    example = (str(REPOSITORY / "examples" / EXAMPLES[group]),) if group in EXAMPLES else ()
    return (*example, *GIVEN[group])


def everything(group: str) -> tuple[str, ...]:
    """Names of ours, and paths of plug-ins."""
    return (*names(group), *outside(group))


def give(option: str) -> None:
    """Take one ``GROUP=PATH`` of the command line."""
    group, equals, path = option.partition("=")
    if not equals:
        raise ValueError(f"--plugin {option}: expected GROUP=PATH, such as optik.ik=./jt.py")
    if group not in EXAMPLES:
        raise ValueError(f"--plugin {option}: no group {group!r}; there are: {', '.join(EXAMPLES)}")
    if not Path(path).is_file():
        raise ValueError(f"--plugin {option}: no such file: {path}")
    GIVEN[group].append(str(Path(path).resolve()))
