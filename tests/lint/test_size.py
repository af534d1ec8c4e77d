"""The map in docs/architecture.md is true, and the code lines of each folder stay within lines.toml."""

import ast
import io
import re
import tokenize
import tomllib
from pathlib import Path

from tests.lint.test_layout import BUILT, PACKAGES, downwards
from tests.oracles import REPOSITORY

LEFT_OUT = {"__init__.py", "py.typed", *BUILT}
NO_CODE = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)


def code_lines(text: str) -> int:
    """Lines with code: without docstrings, those under constants too, comments and blank lines."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in NO_CODE:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            lines -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(lines)


def lines_of(path: Path) -> int:
    files = path.rglob("*.py") if path.is_dir() else [path]
    return sum(code_lines(file.read_text(encoding="utf-8")) for file in files)


def entries(package: str) -> list[str]:
    return [f.name + "/" * f.is_dir() for f in sorted((REPOSITORY / package).iterdir()) if f.name not in LEFT_OUT]


def test_code_lines_are_counted_without_docstrings_comments_and_blank_lines() -> None:
    text = '"""A module."""\n\nX = (\n    1,\n)\n"""A constant."""\n\n'
    text += 'def f():\n    """A function."""\n    # why\n    return "x"\n'
    assert code_lines(text) == 5


def test_no_folder_has_more_code_than_its_budget() -> None:
    budget = tomllib.loads((REPOSITORY / "tests" / "lint" / "lines.toml").read_text(encoding="utf-8"))
    found = {
        package: {e: n for e in entries(package) if (n := lines_of(REPOSITORY / package / e))} for package in PACKAGES
    }
    found["tests"] = {"all": lines_of(REPOSITORY / "tests")}
    over = {
        f"{p}/{e}": f"{n} of {budget[p].get(e, 0)}"
        for p, each in found.items()
        for e, n in each.items()
        if n > budget[p].get(e, 0)
    }
    assert over == {}, "remove or merge something, or raise the number and say in the commit what pays for it"
    assert {p: sorted(each) for p, each in budget.items()} == {p: sorted(each) for p, each in found.items()}


def test_the_map_has_every_entry_below_what_it_imports() -> None:
    page = (REPOSITORY / "docs" / "architecture.md").read_text(encoding="utf-8")
    tree = page.split("```text\n")[1].split("```")[0]
    order: dict[str, list[str]] = {}
    for indent, name in re.findall(r"^( *)(\S+)  .+$", tree, re.MULTILINE):
        if not indent:
            order[package := name.rstrip("/")] = []
        else:
            order[package].append(name)
    assert {p: sorted(each) for p, each in order.items()} == {p: sorted(entries(p)) for p in PACKAGES}
    rank = {f"{p}.{e.removesuffix('.py').rstrip('/')}": i for p, each in order.items() for i, e in enumerate(each)}
    wrong = set()
    for module, found in downwards(*PACKAGES).items():
        for other in found:
            a, b = (".".join(name.split(".")[:2]) for name in (module, other))
            if a.partition(".")[0] == b.partition(".")[0] and a in rank and b in rank and rank[a] < rank[b]:
                wrong.add(f"{a} imports {b}, which is below")
    assert sorted(wrong) == []


def test_each_row_of_new_things_names_files_that_exist() -> None:
    page = (REPOSITORY / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = [
        line.split("|")[1:-1]
        for line in page.split("## A new thing")[1].split("##")[0].splitlines()
        if line.startswith("| ")
    ]
    assert len(rows) > 10
    for row in rows[1:]:
        folder = REPOSITORY / re.findall(r"`([^`]+)/NAME", row[1])[0]
        model = re.findall(r"`([^`]+)`", row[3])[0]
        assert (folder / model).is_file() or (REPOSITORY / model).is_file(), row
        assert (REPOSITORY / re.findall(r"`([\w/.]+)", row[4])[0]).exists(), row
        assert (REPOSITORY / row[5].strip()).is_file(), row
