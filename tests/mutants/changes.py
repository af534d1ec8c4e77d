"""What may be changed in a file, one point at a time, found in its syntax tree and drawn by a seed."""

from __future__ import annotations

import ast
import hashlib
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Change:
    """One stretch of a file's bytes replaced by another text."""

    file: str
    begin: int
    end: int
    new: str
    source: bytes

    def apply(self) -> bytes:
        return self.source[: self.begin] + self.new.encode() + self.source[self.end :]

    @property
    def line(self) -> int:
        return self.source[: self.begin].count(b"\n") + 1

    def lines(self) -> tuple[str, str]:
        """The first line that is changed, before and after."""
        first = self.source.rfind(b"\n", 0, self.begin) + 1
        last = self.source.find(b"\n", self.end)
        last = len(self.source) if last < 0 else last
        old = self.source[first:last].decode()
        new = (self.source[first : self.begin] + self.new.encode() + self.source[self.end : last]).decode()
        return " ".join(old.split()), " ".join(new.split())

    @property
    def key(self) -> str:
        """The same for the same change of the same file."""
        what = f"{self.file}:{self.begin}:{self.end}:{self.new}:".encode() + self.source
        return hashlib.sha256(what).hexdigest()[:16]


def read(root: Path, file: str) -> bytes:
    """A file of the tree."""
    try:
        return (root / file).read_bytes()
    except FileNotFoundError:
        raise SystemExit(f"stale: there is no {file}; bring tests/mutants/listed.py up to date") from None


def named(root: Path, file: str, old: str, new: str) -> Change:
    """A change given by its text, which must be in the file exactly once."""
    source = read(root, file)
    if (found := source.count(old.encode())) != 1:
        raise SystemExit(f"stale: {file} has {old!r} {found} times, not once; bring tests/mutants/listed.py up to date")
    begin = source.index(old.encode())
    return Change(file, begin, begin + len(old.encode()), new, source)


def list_places(root: Path, file: str) -> dict[tuple[int, int], list[Change]]:
    """All changes of a file, by the stretch of bytes that is replaced."""
    source = read(root, file)
    places: dict[tuple[int, int], list[Change]] = {}
    for begin, end, new in _Reader(source).found:
        places.setdefault((begin, end), []).append(Change(file, begin, end, new, source))
    return places


def drawn(root: Path, file: str, count: int, seed: int) -> list[Change]:
    """So many different changes of a file: a place at random, then one of what may be changed there."""
    places, rng = list_places(root, file), random.Random(f"{seed} {file}")
    chosen = rng.sample(sorted(places), min(count, len(places)))
    return [rng.choice(places[place]) for place in chosen]


SWAPPED = {ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*")}
COMPARED = {ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">")}
OPPOSITE = {"max": "min", "maximum": "minimum", "argmax": "argmin", "any": "all", "floor": "ceil", "sin": "cos"}
OPPOSITE |= {b: a for a, b in OPPOSITE.items()}


class _Reader(ast.NodeVisitor):
    """Collects (begin, end, new text) of all single-point changes; says nothing of annotations, messages and docstrings."""

    def __init__(self, source: bytes) -> None:
        self._source = source
        self._starts = [0]
        for line in source.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))
        self.found: list[tuple[int, int, str]] = []
        self.visit(ast.parse(source))

    def _span(self, node: ast.AST) -> tuple[int, int]:
        return (
            self._starts[node.lineno - 1] + node.col_offset,
            self._starts[node.end_lineno - 1] + node.end_col_offset,
        )

    def _text(self, node: ast.AST) -> str:
        begin, end = self._span(node)
        return self._source[begin:end].decode()

    def _change(self, node: ast.AST, new: str) -> None:
        self.found.append((*self._span(node), new))

    def _between(self, left: ast.AST, right: ast.AST, old: str, new: str) -> None:
        """Replace the operator between two operands; brackets may stand around it."""
        begin, end = self._span(left)[1], self._span(right)[0]
        at = self._source.find(old.encode(), begin, end)
        if at >= 0:
            self.found.append((at, at + len(old.encode()), new))

    # ---- what is left alone

    def visit_Raise(self, node: ast.Raise) -> None:
        pass

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        pass

    def visit_arg(self, node: ast.arg) -> None:
        pass

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        for default in (*node.args.defaults, *filter(None, node.args.kw_defaults)):
            self.visit(default)
        for statement in node.body:
            self.visit(statement)

    # ---- what is changed

    def visit_Constant(self, node: ast.Constant) -> None:
        x = node.value
        if isinstance(x, bool):
            self._change(node, str(not x))
        elif isinstance(x, int):
            for new in {x + 1, x - 1 if x else 1}:
                self._change(node, str(new))
        elif isinstance(x, float):
            for new in (10.0 * x, x * (1.0 + 1e-3), x + 1.0):
                if new != x:
                    self._change(node, repr(new))

    def visit_BinOp(self, node: ast.BinOp) -> None:
        words = any(
            isinstance(x, ast.JoinedStr) or isinstance(getattr(x, "value", 0), str) for x in (node.left, node.right)
        )
        if (pair := SWAPPED.get(type(node.op))) and not words:
            self._between(node.left, node.right, *pair)
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        for left, op, right in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
            if pair := COMPARED.get(type(op)):
                self._between(left, right, *pair)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        pair = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        self._between(node.values[0], node.values[1], *pair)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub | ast.Not):
            self._change(node, f"({self._text(node.operand)})")
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in OPPOSITE:
            end = self._span(node.func)[1]
            self.found.append((end - len(name), end, OPPOSITE[name]))
        if name in ("abs", "fabs") and node.args:
            self._change(node, f"({self._text(node.args[0])})")
        self.generic_visit(node)

    def visit_If(self, node: ast.If | ast.While | ast.IfExp) -> None:
        self._change(node.test, f"(not ({self._text(node.test)}))")
        self.generic_visit(node)

    visit_While = visit_IfExp = visit_If

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._change(node, "pass")
        self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            self._change(node, "pass")
        self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        if all(isinstance(target, ast.Subscript | ast.Attribute) for target in node.targets):
            self._change(node, "pass")
        if not any(isinstance(target, ast.Name) and target.id == "__all__" for target in node.targets):
            self.generic_visit(node)

    def visit_Continue(self, node: ast.Continue | ast.Break) -> None:
        self._change(node, "pass")

    visit_Break = visit_Continue


def list_files(root: Path, names: tuple[str, ...]) -> list[str]:
    """Files, and the modules in folders."""
    found = [file for name in names for file in sorted((root / name).glob("*.py")) or [root / name]]
    return list(dict.fromkeys(file.relative_to(root).as_posix() for file in found))


def scatter(root: Path, files: list[str], count: int, seed: int) -> list[Change]:
    """So many changes of files, each place of all of them as likely as any other."""
    places = [place for file in files for place in sorted(list_places(root, file).items())]
    rng = random.Random(seed)
    return [rng.choice(found) for _, found in rng.sample(places, count)]


def spread(root: Path, files: list[str], count: int, seed: int) -> Iterator[Change]:
    """So many changes in all, the same number of each file but for one."""
    share, more = divmod(count, len(files))
    for i, file in enumerate(files):
        yield from drawn(root, file, share + (i < more), seed)
