"""What the README shows runs, and its names exist."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from optik.registry import own_names
from planners.limits import ALL_LIMITS

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_readme_s_python_runs() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, flags=re.S)
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("True ")


PAGES = """
import json, sys
for page, code in json.load(sys.stdin).items():
    print(page, file=sys.stderr)
    exec(compile(code, page, "exec"), {"__name__": "__main__"})
"""
"""Runs each page's code in a namespace of its own, all in one process: imports are most of a process's time."""


def test_the_python_of_the_docs_runs(tmp_path: Path) -> None:
    """The others run beside the examples and the blocks that begin with ``# NAME.py`` or ``# NAME.toml``, which are files."""
    pages = {}
    for place in ("examples", "examples/plugins"):
        shutil.copytree(ROOT / place, tmp_path, dirs_exist_ok=True)
    for page in sorted((ROOT / "docs").glob("*.md")):
        code = []
        for block in re.findall(r"```(?:python|toml)\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.S):
            named = re.match(r"# (\w+\.(?:py|toml))\n", block)
            if named:
                (tmp_path / named[1]).write_text(block, encoding="utf-8")
            else:
                code.append(block)
        if code:
            pages[page.name] = "\n".join(code)
    assert len(pages) > 4
    done = subprocess.run(
        [sys.executable, "-c", PAGES],
        input=json.dumps(pages),
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr


def test_every_file_that_the_readme_and_the_docs_link_to_exists() -> None:
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
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
