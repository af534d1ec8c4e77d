"""Docstrings: what the documentation site shows has all sections; arrays say their shape and unit.

Full sections (Parameters, Returns, Raises) are for what a reader of the site sees: the members that the pages in docs/api
list, every METHOD, and the classes of base.py that plug-ins implement. A method that overrides one of these inherits its
docstring. Every other function has one sentence. Of what is shown:

1. A function or method with arguments has a section "Parameters", one that returns or raises says so. Left out: overloads.
2. A parameter whose annotation names an array type (Array, Flags, Indices, ArrayLike, NDArray, or another name for
   one of these) says its shape in parentheses, (n,) or (..., 4, 4), or the word "scalar" or "shape" (as in "the shape
   of t"), on its type line or in its description; and its unit in square brackets, [rad, m], [1/s], [1] for
   none, or [as q]. Truth values and indices have no unit: Flags, Indices, other NDArray than of floats, or "bool"
   or "int" on the type line.
3. The same holds for what it returns: for the section as a whole, and for each entry whose type line says "array".

Ruff (D417, DOC102, DOC202, DOC403 in `make lint`) compares the sections that a docstring has with its function, wherever it is.

`python tests/lint/test_docstrings.py FILE …` prints what is missing in these files.
"""

import ast
import importlib
import inspect
import json
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
FILES = sorted(f for part in ("optik", "planners", "benchmarks") for f in (REPOSITORY / part).rglob("*.py"))

NO_PLUGINS = {"blocks", "report"}
"""Folders of benchmarks whose base.py no plug-in implements."""

REAL, WHOLE = {"real"}, {"whole"}
TYPES = {"Array": REAL, "ArrayLike": REAL, "Flags": WHOLE, "Indices": WHOLE}
"""Array types by name: of real numbers, which have a unit, or of truth values and indices."""

ELEMENT = r"(?:\.\.\.|…|\w+(?:\s?[-+*/·]\s?\w+)*)"
SHAPE = re.compile(rf"\({ELEMENT},(?:\s?{ELEMENT},)*(?:\s?{ELEMENT})?\)|\bscalars?\b|\bshapes?\b")
BRACKETS = re.compile(r"(?:^|(?<=[\s(]))\[([^\[\]]+)\]", re.MULTILINE)
UNITS = {"rad", "m", "s", "deg", "°", "mm", "cm", "µm", "ms", "µs", "ns", "kg", "N", "Nm", "J", "W", "Hz", "%"}


# ---------------------------------------------------------------- reading a docstring
def is_unit(text):
    """Whether what stands in square brackets is a unit: not an interval, an index or a list."""
    if text.startswith("as ") or text == "1":
        return True
    words = re.split(r"[\s,/·*()]+", re.sub(r"\^\(?[\w+-]+\)?|[²³⁴⁵⁻¹ᵏ]", "", text))
    return bool(words) and all(w in UNITS or w in ("", "1", "or") for w in words) and any(w in UNITS for w in words)


def sections(docstring):
    """Sections of a NumPy docstring: title → {first line of an entry: the whole entry}."""
    found, entries, entry = {}, {}, ""
    lines = inspect.cleandoc(docstring).splitlines()
    for line, below in zip(lines, [*lines, ""][1:], strict=True):
        if line and re.fullmatch(r"-{3,}", below):
            entries = found.setdefault(line, {})
        elif line and not line.startswith((" ", "--")):
            entry = line
            entries[entry] = line
        elif entry in entries:
            entries[entry] += "\n" + line
    return found


def lacks(entry, unit):
    """What an array's entry does not say: its shape, its unit."""
    wanted = {"shape in parentheses": SHAPE.search(entry)}
    if unit and not re.search(r"\b(bool|int)\b", entry.partition("\n")[0]):
        wanted["unit in square brackets"] = any(map(is_unit, BRACKETS.findall(entry)))
    return [what for what, said in wanted.items() if not said]


# ---------------------------------------------------------------- reading code
def kinds(annotation, names):
    """Kinds of array that an annotation names."""
    found = set()
    for node in ast.walk(annotation) if annotation else ():
        if isinstance(node, ast.Name) and node.id in names:
            found |= names[node.id]
        elif isinstance(node, ast.Subscript) and ast.unparse(node.value) == "NDArray":
            found |= REAL if "float" in ast.unparse(node.slice) else WHOLE
    return found


@cache
def array_names():
    """The array types and every other name that a module gives to a type with an array in it."""
    names = dict(TYPES)
    for _ in range(2):  # a name for a name
        for file in FILES:
            for node in ast.parse(file.read_text(encoding="utf-8")).body:
                target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
                value = getattr(node, "value", None)
                group = (
                    isinstance(value, ast.Subscript) and ast.unparse(value.value) == "tuple"
                )  # documented where it is named
                if (
                    isinstance(target, ast.Name)
                    and isinstance(value, ast.Subscript | ast.Name | ast.BinOp)
                    and not group
                ):
                    kind = kinds(value, names)
                    if kind and target.id not in TYPES and target.id[0].isupper() and not target.id.isupper():
                        names[target.id] = kind
    return names


def public_functions(node, owner=""):
    """Every public function with arguments: its qualified name, its node, and the arguments that a caller gives."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ClassDef) and not child.name.startswith("_"):
            yield from public_functions(child, f"{owner}{child.name}.")
        elif isinstance(child, ast.FunctionDef) and not child.name.startswith("_"):
            by = [ast.unparse(d) for d in child.decorator_list]
            a = child.args
            arguments = [*a.posonlyargs, *a.args][bool(owner) and "staticmethod" not in by :]
            arguments += [x for x in (a.vararg, *a.kwonlyargs, a.kwarg) if x]
            if arguments and "overload" not in by and not any(re.search(r"\.(command|callback)\(", d) for d in by):
                yield owner + child.name, child, arguments
        elif isinstance(child, ast.If | ast.Try | ast.With | ast.ExceptHandler):
            yield from public_functions(child, owner)


def complaints(text, names, shown=None):
    """What the docstrings of a module lack, as "line: function: what"; of the functions `shown` only, if given."""
    for name, function, arguments in public_functions(ast.parse(text)):
        if shown is not None and name not in shown:
            continue
        said = sections(ast.get_docstring(function) or "")
        where = f"{function.lineno}: {function.name}:"
        if "Parameters" not in said:
            yield f"{where} no section Parameters"
        for argument in arguments:
            arrays = kinds(argument.annotation, names)
            for first, entry in said.get("Parameters", {}).items():
                if arrays and argument.arg in re.split(r"[,\s*]+", first.partition(" : ")[0]):
                    yield from (f"{where} {argument.arg} lacks {what}" for what in lacks(entry, arrays >= REAL))
        arrays = kinds(function.returns, names)
        out = said.get("Returns") or said.get("Yields") or {}
        if arrays and not out:
            yield f"{where} no section Returns"
        elif arrays:
            entries = [e for first, e in out.items() if re.search(r"\barrays?\b", first)]
            whole = "\n".join(entries or out.values())
            for entry in entries or [whole]:
                told = " ".join(entry.partition("\n")[0].split())[:40]
                yield from (f"{where} returned {told!r} lacks {what}" for what in lacks(entry, arrays >= REAL))


# ---------------------------------------------------------------- what the site shows
def pages_objects():
    """The objects that the pages of docs/api list."""
    for page in sorted((REPOSITORY / "docs" / "api").glob("*.md")):
        for name, members in re.findall(r"automodule:: (\S+)\n\s+:members:(.*)", page.read_text(encoding="utf-8")):
            module = importlib.import_module(name)
            own = [n for n, v in vars(module).items() if n[0] != "_" and getattr(v, "__module__", name) == name]
            listed = re.findall(r"\w+", members) or getattr(module, "__all__", own)
            yield from (getattr(module, one) for one in listed)


def plugin_objects():
    """Every METHOD with a public name, and the classes of every base.py that plug-ins implement."""
    for file in FILES:
        text, module = file.read_text(encoding="utf-8"), ".".join(file.relative_to(REPOSITORY).with_suffix("").parts)
        wanted = re.findall(r"^METHOD = ([A-Za-z]\w*)", text, re.MULTILINE)
        wanted += (
            re.findall(r"^class ([A-Za-z]\w*)", text, re.MULTILINE)
            if file.name == "base.py" and file.parts[-2] not in NO_PLUGINS
            else []
        )
        yield from (getattr(importlib.import_module(module.removesuffix(".__init__")), name) for name in wanted)


@cache
def shown_functions():
    """File → qualified names of the functions whose docstrings need all sections."""
    found = {}
    for thing in {*filter(callable, [*pages_objects(), *plugin_objects()])}:
        if inspect.isclass(thing):
            overrides = {name for base in thing.__mro__[1:] for name in vars(base)}
            members = [getattr(thing, name, None) for name in vars(thing) if name not in overrides]
        else:
            members = [thing]
        for member in filter(inspect.isroutine, map(inspect.unwrap, filter(callable, members))):
            file = Path(inspect.getsourcefile(member) or "") if hasattr(member, "__code__") else Path()
            if file in FILES:
                found.setdefault(file, set()).add(member.__qualname__)
    return found


def undocumented(file, shown):
    """Ruff's findings about returned values and errors that a docstring does not name, of the functions `shown`."""
    command = [sys.executable, "-m", "ruff", "check", "--isolated", "--preview", "--select", "DOC201,DOC402,DOC501"]
    options = [
        "--config",
        "lint.pydocstyle.convention='numpy'",
        "--config",
        "lint.pydoclint.ignore-one-line-docstrings=true",
    ]
    ran = subprocess.run([*command, *options, "--output-format", "json", file], capture_output=True, text=True)
    spans = {name: f for name, f, _ in public_functions(ast.parse(file.read_text(encoding="utf-8"))) if name in shown}
    for finding in json.loads(ran.stdout):
        row = finding["location"]["row"]
        owners = [name for name, f in spans.items() if f.lineno <= row <= f.end_lineno]
        yield from (f"{row}: {name}: {finding['message']}" for name in owners)


# ---------------------------------------------------------------- the packages keep the rules
def test_what_the_site_shows_says_parameters_shapes_and_units():
    found = []
    for file, shown in shown_functions().items():
        name = file.relative_to(REPOSITORY).as_posix()
        told = [*complaints(file.read_text(encoding="utf-8"), array_names(), shown), *undocumented(file, shown)]
        found += [f"{name}:{line}" for line in told]
    assert not found, "\n" + "\n".join(found)


def test_parameters_of_one_entry_have_one_type():
    found = []
    for file, shown in shown_functions().items():
        for name, function, _ in public_functions(ast.parse(file.read_text(encoding="utf-8"))):
            entries = sections(ast.get_docstring(function) or "").get("Parameters", {}) if name in shown else {}
            heaps = [first for first in entries if re.match(r"\w+, .* : .*\band\b", first)]
            found += [f"{file.relative_to(REPOSITORY)}: {name}: {heap}" for heap in heaps]
    assert not found, "\n".join(found)


def test_the_site_shows_the_interfaces_and_not_what_is_inside():
    shown = {
        f"{file.relative_to(REPOSITORY).as_posix()}:{name}"
        for file, names in shown_functions().items()
        for name in names
    }
    assert {"optik/arm/robot.py:Robot.fk", "planners/plan.py:plan", "planners/timing/base.py:TimeLaw.run"} <= shown
    assert {"planners/paths/line.py:Line.pose", "planners/timing/optimal.py:Optimal.run"}.isdisjoint(
        shown
    )  # they inherit
    assert not any("/interior_point/" in name for name in shown)


# ---------------------------------------------------------------- the reader sees what it should
GOOD = '''
class Arm:
    def fk(self, q: ArrayLike, *more: Rows, check: Bools | None = None, order: int = 0) -> tuple[Array, Bools]:
        """Tool poses.

        Parameters
        ----------
        q : (n,) or (..., n) array
            Configurations [rad, m].
        *more : (k + 1, n) arrays
            Others, in [0, 1] of the range [1].
        check : (n,) array of bool, optional
            Joints to check.
        order : int
            Derivative.

        Returns
        -------
        poses : (..., 4, 4) array
            Poses; the last column [m].
        good : (n,) array of bool
            Whether each joint is inside its limits.
        """
'''
NAMES = TYPES | {"Rows": REAL, "Bools": WHOLE}


def test_a_complete_docstring_has_nothing_to_complain_of():
    assert list(complaints(GOOD, NAMES)) == []


@pytest.mark.parametrize(
    ("before", "after", "complaint"),
    [
        ("Parameters\n        ----------", "Options\n        -------", "no section Parameters"),
        ("q : (n,) or (..., n) array", "q : array", "q lacks shape"),
        ("[rad, m]", "``q[i]``", "q lacks unit"),
        ("range [1]", "range", "more lacks unit"),
        ("(k + 1, n) arrays", "arrays (one, or many)", "more lacks shape"),
        ("check : (n,) array of bool", "check : array of bool", "check lacks shape"),
        ("check : (n,) array of bool", "check : array", "check lacks shape"),
        ("(..., 4, 4) array", "array", "returned 'poses : array' lacks shape"),
        ("column [m]", "column", "returned 'poses : (..., 4, 4) array' lacks unit"),
        ("good : (n,) array", "good : array", "returned 'good : array of bool' lacks shape"),
    ],
)
def test_what_is_missing_is_told(before, after, complaint):
    assert before in GOOD
    found = list(complaints(GOOD.replace(before, after), NAMES))
    assert [line.split(": ", 2)[2].startswith(complaint) for line in found] == [True]


@pytest.mark.parametrize(
    "code",
    [
        "def _f(q: Array): ...", "class _A:\n    def f(self, q: Array): ...", "def f() -> Array: ...",
        "class A:\n    @property\n    def f(self) -> Array: ...", "@overload\ndef f(q: Array) -> Array: ...",
        "@app.command('x')\ndef f(q: Array) -> Array: ...", "def f():\n    def g(q: Array): ...",
    ],
)  # fmt: skip
def test_what_is_not_public_is_left_out(code):
    assert list(complaints(code, NAMES)) == []


@pytest.mark.parametrize(
    "code", ["def f(q): ...", "class A:\n    @classmethod\n    def f(cls, *, q): ...", "if x:\n    def f(q): ..."]
)
def test_what_is_public_is_read(code):
    assert [line.partition(": ")[2] for line in complaints(code, NAMES)] == ["f: no section Parameters"]


@pytest.mark.parametrize(
    "text", ["rad", "rad, m", "m/s²", "rad/s^k, m/s^k", "1", "1/s", "°", "as q", "rad or m", "kg·m²"]
)
def test_units_are_known(text):
    assert is_unit(text)


@pytest.mark.parametrize("text", ["0, 1", "i", "optional", "n", "", "2", "words"])
def test_other_brackets_are_no_units(text):
    assert not is_unit(text)


def test_names_for_array_types_are_followed():
    assert array_names()["Array"] == REAL
    assert kinds(ast.parse("x: dict[str, NDArray[np.bool_]] | None").body[0].annotation, TYPES) == WHOLE


if __name__ == "__main__":
    told = []
    for given in map(Path, sys.argv[1:]):
        shown = shown_functions().get(given.resolve(), set())
        told += [f"{given}:{line}" for line in complaints(given.read_text(encoding="utf-8"), array_names(), shown)]
    print("\n".join(told) or "complete")
    sys.exit(bool(told))
