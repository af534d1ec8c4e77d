"""The layout of the packages: imports point down, no circles, few entries at the top, short files, few parameters."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

from tests.oracles import REPOSITORY

PACKAGES = ("optik", "planners", "benchmarks")
"""Each may use itself and those to its left."""
FILES = sorted(f for package in PACKAGES for f in (REPOSITORY / package).rglob("*.py"))
MOST_AT_TOP = {"optik": 20, "planners": 19, "benchmarks": 16}
"""Files and folders of a package besides ``__init__.py`` and ``py.typed``."""
LONGEST_FILE, LONGEST_FUNCTION, MOST_POSITIONAL = 600, 57, 8  # a function without its docstring
BUILT = {"__pycache__", "_kernels"}
"""Folders that Python and ``make kernels`` write."""
SUFFIXES = {".py", ".toml", ".typed", ".j2", ".css", ".js"}
"""What may lie in a package: anything else would be in the wheel, too."""
REASON = "More than 8 parameters:"
"""A comment that begins so, inside a kernel or above it, says why a kernel takes more."""


BY_NAME = {"import_module", "__import__", "resolve_name", "run_module"}
"""Functions that import a module by its name."""
BY_DATA = (
    "optik/registry.py", "benchmarks/report/base.py", "benchmarks/cli/installation.py", "benchmarks/peers/_workers/",
)  # fmt: skip
"""Files that import plug-ins, pages of kinds, and what is installed: their names are data."""
UPWARDS = {("optik.arm.robot", "optik.view"), ("planners.planning.result", "planners.replan.finish")}
"""Imports of methods that call a room above their object: `robot.show()`, and `plan.slowed_to()` with `stopping`."""


def relative(path: Path) -> str:
    return path.relative_to(REPOSITORY).as_posix()


@cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(text_of(path))


# ---------------------------------------------------------------- the graph of imports
def named(node: ast.Call) -> str | None:
    """The module that a call imports by its name; its package where the rest is computed; None for another call."""
    function = getattr(node.func, "attr", getattr(node.func, "id", ""))
    if function not in BY_NAME:
        return None
    first = node.args[0] if node.args else None
    first = first.values[0] if isinstance(first, ast.JoinedStr) else first
    return first.value if isinstance(first, ast.Constant) and isinstance(first.value, str) else ""


def imports(root: Path, packages: tuple[str, ...]) -> dict[str, set[str]]:
    """For each module the modules that it imports, anywhere in it, for types and by name; of a package, what is from it."""
    files = {}
    for package in packages:
        for file in (root / package).rglob("*.py"):
            parts = file.relative_to(root).with_suffix("").parts
            files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    graph: dict[str, set[str]] = defaultdict(set)
    for module, file in files.items():
        inside = module if file.name == "__init__.py" else module.rpartition(".")[0]
        for node in ast.walk(parsed(file)):
            if isinstance(node, ast.Import):
                graph[module] |= {a.name for a in node.names if a.name in files}
            elif isinstance(node, ast.ImportFrom):
                before = inside.split(".")[: inside.count(".") + 2 - node.level] if node.level else []
                source = ".".join([*before, *([node.module] if node.module else [])])
                for alias in node.names:
                    inner = f"{source}.{alias.name}"
                    graph[module] |= {inner} if inner in files else {source} & set(files)
            elif isinstance(node, ast.Call) and (name := named(node)) is not None:
                graph[module] |= {name.rstrip(".")} & set(files)
        graph[module].discard(module)
    return graph


def downwards(*packages: str) -> dict[str, set[str]]:
    """The imports of packages without those of `UPWARDS`."""
    graph = imports(REPOSITORY, packages)
    return {module: {name for name in found if (module, name) not in UPWARDS} for module, found in graph.items()}


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules of which each is reached from each: everything that a module reaches is walked, module by module."""

    def reach(module: str) -> set[str]:
        found: set[str] = set()
        ahead = [*graph.get(module, ())]
        while ahead:
            if (name := ahead.pop()) not in found:
                found.add(name)
                ahead += graph.get(name, ())
        return found

    reached = {m: reach(m) for m in list(graph)}
    groups = {tuple(sorted(k for k in reached[m] if m in reached.get(k, ()))) for m in reached if m in reached[m]}
    return sorted(list(group) for group in groups)


def part(module: str) -> str:
    """A module at the top of a package, or the folder there that it is in."""
    return ".".join(module.split(".")[:2])


def test_imports_point_down_and_never_up() -> None:
    graph = imports(REPOSITORY, (*PACKAGES, "tests"))
    rank = {name: i for i, name in enumerate((*PACKAGES, "tests"))}
    assert {module.partition(".")[0] for module in graph} == set(rank)
    edges = [(module, name) for module, found in graph.items() for name in found]
    assert [(a, b) for a, b in edges if rank[a.partition(".")[0]] < rank[b.partition(".")[0]]] == []


def test_no_module_and_no_folder_of_optik_and_planners_is_imported_by_what_it_imports() -> None:
    assert circles(downwards(*PACKAGES)) == []
    graph = defaultdict[str, set[str]](set)
    for module, found in downwards("optik", "planners").items():
        graph[part(module)] |= {part(other) for other in found if "." in other} - {part(module)}
    assert circles(graph) == []


def test_few_methods_are_functions_of_a_room_above_and_each_would_be_a_circle() -> None:
    graph = imports(REPOSITORY, PACKAGES)
    assert len(UPWARDS) <= 2
    for module, name in UPWARDS:
        assert name in graph[module]
        assert any({module, name} <= set(circle) for circle in circles(graph))


def test_a_module_that_is_imported_by_its_name_says_which() -> None:
    calls = ((path, node) for path in FILES for node in ast.walk(parsed(path)) if isinstance(node, ast.Call))
    unsaid = {relative(path) for path, node in calls if named(node) is not None and not named(node)}
    assert [name for name in sorted(unsaid) if not name.startswith(BY_DATA)] == []


def test_a_circle_is_found_through_a_function_a_package_a_name_a_type_and_a_relative_import(tmp_path: Path) -> None:
    files = {
        "p/__init__.py": "",
        "p/a.py": "def f():\n    from p.b import g\n",
        "p/b.py": "from p import c\n",
        "p/c.py": "from .a import f\n",
        "p/d.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from p.e import x\n",
        "p/e.py": "import p.d\n",
        "p/f.py": "import importlib\nimportlib.import_module('p.g')\n",
        "p/g.py": "__import__(f'p.f.{x}')\nimport_module(x)\n",
        "p/inner/__init__.py": "from .. import a\nfrom . import one\n",
        "p/inner/one.py": "import numpy\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    graph = imports(tmp_path, ("p",))
    assert graph["p.a"] == {"p.b"}
    assert graph["p.c"] == {"p.a"}
    assert graph["p.e"] == {"p.d"}
    assert graph["p.inner"] == {"p.a", "p.inner.one"}
    assert circles(graph) == [["p.a", "p.b", "p.c"], ["p.d", "p.e"], ["p.f", "p.g"]]
    calls = [node for node in ast.walk(parsed(tmp_path / "p/g.py")) if isinstance(node, ast.Call)]
    assert [named(call) for call in calls] == ["p.f.", ""]


# ---------------------------------------------------------------- private names
def private_imports(root: Path, packages: tuple[str, ...]) -> list[str]:
    """Imports of a module or name with an underscore from outside the folder, or the module, that it belongs to."""
    found = []
    for package in packages:
        for file in sorted((root / package).rglob("*.py")):
            module = ".".join(file.relative_to(root).with_suffix("").parts)
            for node in ast.walk(parsed(file)):
                if not isinstance(node, ast.ImportFrom) or (node.module or "").partition(".")[0] not in packages:
                    continue
                for name in (f"{node.module}.{alias.name}" for alias in node.names):
                    owner = name[: name.find("._")]
                    folder = owner if (root / owner.replace(".", "/")).is_dir() else owner.rpartition(".")[0]
                    if "._" in name and not module.startswith(f"{folder}."):
                        found.append(f"{module}: {name}")
    return found


def test_private_names_stay_in_their_folder(tmp_path: Path) -> None:
    assert private_imports(REPOSITORY, PACKAGES) == []
    for name, text in {
        "p/a/__init__.py": "",
        "p/a/_inner.py": "_x = 1\n",
        "p/a/one.py": "from p.a._inner import _x\nfrom p.a import _inner\n",
        "p/b.py": "from p.a._inner import y\nfrom p.a import _inner\nfrom p.a.one import _z\n",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert private_imports(tmp_path, ("p",)) == ["p.b: p.a._inner.y", "p.b: p.a._inner", "p.b: p.a.one._z"]


# ---------------------------------------------------------------- sizes
def test_every_file_says_its_job_in_its_first_line() -> None:
    for path in FILES:
        docstring = ast.get_docstring(parsed(path))
        assert docstring, relative(path)
        assert 10 <= len(docstring.splitlines()[0]) <= 120, relative(path)
        assert text_of(path).startswith('"""'), relative(path)


@pytest.mark.parametrize("package", PACKAGES)
def test_few_files_and_folders_are_at_the_top_of_a_package(package: str) -> None:
    top = {f.name for f in (REPOSITORY / package).iterdir()} - {"__init__.py", "py.typed", "__pycache__"}
    assert len(top) <= MOST_AT_TOP[package], sorted(top)


@pytest.mark.parametrize("package", PACKAGES)
def test_nothing_but_code_data_and_templates_lies_in_a_package(package: str) -> None:
    files = [f for f in (REPOSITORY / package).rglob("*") if f.is_file() and not BUILT & set(f.parts)]
    published = REPOSITORY / "benchmarks" / "results"  # which the wheel leaves out
    inside = [f for f in files if not f.is_relative_to(published)]
    assert [relative(f) for f in inside if f.suffix not in SUFFIXES and f.name != "py.typed"] == []
    assert len(inside) > 50 if package != "benchmarks" else len(files) > len(inside) > 50


def test_no_two_test_files_have_one_name() -> None:
    """Pytest imports a test file by its name alone, and refuses the second of two."""
    names = [path.name for path in (REPOSITORY / "tests").rglob("test_*.py")]
    assert [name for name in names if names.count(name) > 1] == []


def test_files_and_functions_are_short() -> None:
    assert [relative(path) for path in FILES if text_of(path).count("\n") > LONGEST_FILE] == []
    long = {
        f"{relative(path)}: {node.name}": count
        for path in FILES
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (count := node.end_lineno - node.lineno + 1 - (ast.get_docstring(node) or "").count("\n"))
        > LONGEST_FUNCTION
    }
    assert long == {}


def is_kernel(node: ast.FunctionDef) -> bool:
    """Whether a function is compiled: some decorator of `optik.compiled` is on it."""
    names = {n.id for d in node.decorator_list for n in ast.walk(d) if isinstance(n, ast.Name)}
    return bool(names & {"compiled", "inlined", "parallel"})


def test_kernels_take_few_parameters_or_say_why() -> None:
    many = []
    for path in FILES:
        lines = text_of(path).splitlines()
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.FunctionDef) and is_kernel(node):
                count = len(node.args.posonlyargs) + len(node.args.args)
                around = lines[max(node.lineno - 8, 0) : node.end_lineno]
                if count > MOST_POSITIONAL and not any(line.strip().startswith(f"# {REASON}") for line in around):
                    many.append((relative(path), node.name, count))
    assert many == []


# ---------------------------------------------------------------- constants
SHARED = {"METHOD", "METHOD_BASE", "MEASURES", "FIELDS", "REPORT", "SECTIONS"}
"""Names that mean the same in every file that has them: what a file of its kind brings."""


def constants(path: Path) -> Iterator[tuple[str, bool]]:
    """Names of a module's constants, and whether words say why they are what they are.

    That is: a sentence below, or a comment above or beside it; of a block of lines without a gap, the block's.
    """
    lines, body = text_of(path).splitlines(), parsed(path).body
    said_below = {
        before.end_lineno
        for before, after in pairwise(body)
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str)
    }
    for block in blocks(body):
        first, last = block[0], block[-1]
        commented = first.lineno > 1 and lines[first.lineno - 2].lstrip().startswith("#")
        for node in block:
            beside = any("  # " in line for line in lines[node.lineno - 1 : node.end_lineno])
            said = commented or beside or node.end_lineno in said_below or last.end_lineno in said_below
            for name in names_of(node):
                yield name, said


def blocks(body: list[ast.stmt]) -> Iterator[list[ast.Assign | ast.AnnAssign]]:
    """Assignments that follow each other line by line."""
    block: list[ast.Assign | ast.AnnAssign] = []
    for node in body:
        if block and (
            not isinstance(node, ast.Assign | ast.AnnAssign) or node.lineno != (block[-1].end_lineno or 0) + 1
        ):
            yield block
            block = []
        if isinstance(node, ast.Assign | ast.AnnAssign):
            block.append(node)
    if block:
        yield block


def names_of(node: ast.Assign | ast.AnnAssign) -> list[str]:
    """Names in capitals that an assignment gives; one letter is a symbol of a formula."""
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    flat = [name for t in targets for name in (t.elts if isinstance(t, ast.Tuple) else [t])]
    return [n.id for n in flat if isinstance(n, ast.Name) and n.id.isupper() and len(n.id) > 1 and n.id not in SHARED]


def second_meanings(root: Path, files: list[Path]) -> list[str]:
    """Constants whose name another file of the folder has, too, with the first of these files."""
    first: dict[tuple[Path, str], Path] = {}
    found = []
    for path in files:
        for name in dict.fromkeys(name for name, _ in constants(path)):
            other = first.setdefault((path.parent, name), path)
            if other != path:
                found.append(f"{path.relative_to(root)}: {name}, which is in {other.relative_to(root)}, too")
    return found


def test_a_constants_name_has_one_meaning_in_its_folder(tmp_path: Path) -> None:
    assert second_meanings(REPOSITORY, FILES) == []
    files = [tmp_path / name for name in ("a.py", "b.py", "c.py")]
    for file, text in zip(files, ("MOST = 1\n", "LEAST = 2\nLEAST = 3\n", "LEAST = 4\nmost = 5\n"), strict=True):
        file.write_text(text)
    assert second_meanings(tmp_path, files) == ["c.py: LEAST, which is in b.py, too"]


def test_every_constant_says_why() -> None:
    assert [(relative(path), name) for path in FILES for name, said in constants(path) if not said] == []


# ---------------------------------------------------------------- names of variables
EMPTY_NAMES = {"found", "made", "given", "held", "own", "spent"}
"""Names of results that say nothing: a long function names what was found, made or given."""
MOST_EMPTY = {"optik": 0, "planners": 2, "benchmarks": 0}
"""Functions of more than 20 lines that assign such a name; these numbers only go down."""


def with_empty_names(path: Path) -> list[str]:
    """Functions of more than 20 lines that assign a variable whose name says nothing."""
    functions = [node for node in ast.walk(parsed(path)) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    return [
        f"{path.name}: {function.name}"
        for function in functions
        if (function.end_lineno or 0) - function.lineno + 1 > 20
        and any(
            isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store) and n.id in EMPTY_NAMES for n in ast.walk(function)
        )
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_few_variables_of_long_functions_have_names_that_say_nothing(package: str, tmp_path: Path) -> None:
    files = [path for path in FILES if path.is_relative_to(REPOSITORY / package)]
    assert len([function for path in files for function in with_empty_names(path)]) <= MOST_EMPTY[package]
    for lines, named in ((18, []), (19, ["a.py: f"])):
        file = tmp_path / f"{lines}" / "a.py"
        file.parent.mkdir()
        file.write_text("def f():\n    found = 1\n" + "    found += 1\n" * lines + "def g():\n    found = 2\n")
        assert with_empty_names(file) == named
