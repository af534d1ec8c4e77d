"""What is installed or not: plug-ins under the contract tests, those of ``--plugin GROUP=PATH`` too; hidden packages."""

import sys
from collections import defaultdict
from pathlib import Path

import pytest

from optik.registry import names
from tests.oracles import REPOSITORY

EXAMPLES = {
    "optik.ik": "jt.py", "optik.robots": "arm.toml", "planners.timing": "law.py", "planners.limits": "weighted_speed.py",
    "planners.paths": "spiral.py", "planners.freedom": "standoff.py", "planners.search": "prm.py", "planners.files": "tsv.py",
    "planners.cell.drives": "lagging.py", "benchmarks.problems": "beside.py", "benchmarks.suites": "suite.toml",
    "benchmarks.peers.ik": "scipy_least_squares.py", "benchmarks.peers.laws": "scipy_spline.py",
}  # fmt: skip
"""Files in ``examples/plugins/``, by their group."""

GIVEN: dict[str, list[str]] = defaultdict(list)
"""Absolute paths by group, as given on the command line."""


def outside(group: str) -> tuple[str, ...]:
    """Paths of all plug-ins of a group that are tested."""
    example = (str(REPOSITORY / "examples" / "plugins" / EXAMPLES[group]),) if group in EXAMPLES else ()
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


def hide(patch: pytest.MonkeyPatch, *packages: str) -> None:
    """Let packages be absent, whatever of them was imported before: a module that is loaded is found without its parent."""
    for name in [name for name in sys.modules if name.partition(".")[0] in packages]:
        patch.delitem(sys.modules, name)
    for package in packages:
        patch.setitem(sys.modules, package, None)  # what the import machinery says of a package that is not there
