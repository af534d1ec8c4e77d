"""What the README shows runs, and its names exist."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import typer

import planners
from benchmarks.cli.app import app
from docs.generate import describe_object, find_examples, walk
from optik.registry import own_names
from planners.limits import ALL_LIMITS

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_readme_s_python_runs() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, flags=re.S)
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("True ")


def test_the_page_of_plan_begins_with_the_readme_s_python() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, flags=re.S)
    page = describe_object("planners.plan", planners.plan, find_examples()["plan"])
    assert page.startswith(f"# planners.plan\n\nFor example:\n\n```python\n{code}```\n")
    assert "./" not in page.partition("Used in")[0]


def test_every_command_has_a_page_and_is_in_the_help() -> None:
    command = typer.main.get_command(app)
    pages = {words.split()[1] for words, _ in walk("optik", command)}
    assert pages == set(command.commands) >= {"plan", "stream"}


PAGES = """
import ast, contextlib, io, json, os, re, subprocess, sys, webbrowser
webbrowser.open = lambda url: True
folder, most = os.getcwd(), int(sys.argv[1])
def command(line):
    done = subprocess.run(line, shell=True, capture_output=True, text=True)
    assert done.returncode in (0, 1) and "Traceback" not in done.stderr, done.stderr
    return done.stdout + done.stderr
for page, cells in json.load(sys.stdin).items():
    os.chdir(folder)
    names = {"__name__": "__main__", "command": command}
    for number, cell in enumerate(cells):
        place = f"{page}, cell {number}"
        print(place, file=sys.stderr)
        tree = ast.parse(re.sub("^!(.*)", lambda found: f"print(command({found[1]!r}))", cell, flags=re.M))
        last = ast.Expression(tree.body.pop().value) if isinstance(tree.body[-1], ast.Expr) else None
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(tree, place, "exec"), names)
            shown = None if last is None else eval(compile(last, place, "eval"), names)
            if shown is not None:
                print(repr(shown) if not hasattr(shown, "_repr_html_") else shown._repr_html_()[:100])
        assert len(printed.getvalue()) < most, f"{place} prints {len(printed.getvalue())} characters"
"""
"""Runs each page's cells in a namespace of its own, all in one process: imports are most of a process's time.

The last expression of a cell shows itself, as in a notebook. No cell prints as many characters as the argument.
"""

BLOCK = re.compile(r"```(?:\{code-cell\}|python|toml)\n(?::[^\n]*\n)*\n?(.*?)```", re.DOTALL)
"""A block of code, or a cell of a notebook without its options."""


def run_pages(pages: dict[str, list[str]], folder: Path, temporary: Path, most: int) -> None:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # the notebooks call `optik`
    done = subprocess.run(
        [sys.executable, "-c", PAGES, str(most)],
        input=json.dumps(pages),
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT), "TMPDIR": str(temporary), "PATH": path},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.soak
def test_the_python_of_the_docs_runs(tmp_path: Path) -> None:
    """The others run beside the examples and the blocks that begin with ``# NAME.py`` or ``# NAME.toml``, which are files."""
    pages: dict[str, list[str]] = {}
    for place in ("examples", "examples/plugins"):
        shutil.copytree(ROOT / place, tmp_path, dirs_exist_ok=True)
    for page in sorted((ROOT / "docs").glob("*.md")):
        for block in BLOCK.findall(page.read_text(encoding="utf-8")):
            if named := re.match(r"# (\w+\.(?:py|toml))\n", block):
                (tmp_path / named[1]).write_text(block, encoding="utf-8")
            else:
                pages.setdefault(page.name, []).append(block)
    assert len(pages) > 4
    run_pages(pages, tmp_path, tmp_path, 100_000)


@pytest.mark.parametrize(
    "folder", [*(pytest.param(name, marks=pytest.mark.soak) for name in ("howto", "tutorial")), "explanation"]
)
def test_the_notebooks_run_and_print_little(folder: str, tmp_path: Path) -> None:
    notebooks = sorted((ROOT / "docs" / folder).glob("*.md"))
    pages = {page.name: cells for page in notebooks if (cells := BLOCK.findall(page.read_text(encoding="utf-8")))}
    assert len(pages) > 2
    run_pages(pages, ROOT / "docs" / folder, tmp_path, 2000)


def test_every_file_that_the_readme_and_the_docs_link_to_exists() -> None:
    pages = [page for page in (ROOT / "docs").rglob("*.md") if not {"_build", "generated"} & set(page.parts)]
    for page in (ROOT / "README.md", *pages):
        for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / link).is_file(), f"{page.name} links to {link}"


LISTED = {
    "optik.ik": ("docs/inverse_kinematics.md", r"`{}`"),
    "planners.timing": ("docs/planning.md", r"^\| `{}` \|"),
    "planners.limits": ("docs/planning.md", r"^\| `{}` \|"),
    "planners.files": ("docs/files.md", r"^\| `\.{}` \|"),
    "benchmarks.problems": ("docs/suites.md", r"`{}`"),
}
"""Where the documentation lists the files of a folder, and how a line names one."""


@pytest.mark.parametrize("group", LISTED)
def test_every_file_of_a_folder_is_on_the_page_that_lists_them(group: str) -> None:
    page, line = LISTED[group]
    text, names = (ROOT / page).read_text(encoding="utf-8"), own_names(group)
    names |= set(ALL_LIMITS) if group == "planners.limits" else set()
    missing = [name for name in sorted(names) if not re.search(line.format(name), text, re.MULTILINE)]
    assert not missing, f"{page} does not list {', '.join(missing)} of {group}: add a line like those of the others"


def test_the_readme_names_every_time_law() -> None:
    (row,) = re.findall(r"^\| time laws \|.*", TEXT, re.MULTILINE)
    missing = [name for name in sorted(own_names("planners.timing")) if f"`{name}`" not in row]
    assert not missing, f"README.md, in the row of the time laws: add {', '.join(missing)}"


def test_the_make_targets_that_the_readme_names_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"^make (\w+)", TEXT, flags=re.M):
        assert re.search(rf"^{target}:", makefile, flags=re.M)
