"""Names: few at the top of a package, and one meaning for each."""

import ast
from collections import defaultdict

import planners
from tests.lint.test_layout import FILES, parsed, relative

MOST_PUBLIC = 36
"""Names at the top of `planners`; each new capability may add one."""
MOST_SHARED = 30
APART = {
    "plan_stop", "slow_to", "find_stops", "round_corners", "find_path", "find_reversals", "tool_bounds", "fourth_bounds",
    "smallest_singular_value", "torques_at", "join",
}  # fmt: skip
"""Names that stood in sight of each other with two meanings."""
SHARED = {
    "the sections of a kind of block in the report, each in the file of its kind": {"limitations", "tables", "winners"},
    "the work of a block's worker": {"solve"},
    "the start of a process": {"main"},
    "of parts of a link, not of objects in a scene or of a program": {"Hull", "Part", "find_hull"},
}
"""Names of public functions and classes that stand in two folders, by their reason."""


def test_the_top_of_planners_has_few_names_by_task() -> None:
    assert len(planners.__all__) == len(set(planners.__all__)) <= MOST_PUBLIC
    assert planners.__all__[0] == "plan" and all(hasattr(planners, name) for name in planners.__all__)


def test_a_name_of_two_folders_has_a_reason() -> None:
    where: dict[str, set[str]] = defaultdict(set)
    for path in FILES:
        for node in parsed(path).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                where[node.name].add(relative(path.parent))
    shared = {name for name, folders in where.items() if len(folders) > 1}
    assert shared == set().union(*SHARED.values())
    assert len(shared) <= MOST_SHARED and not shared & APART
