"""What the README shows runs, and its names exist."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

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
    """Blocks that begin with ``# NAME.py`` or ``# NAME.toml`` are files, which lie in the folder where the others run."""
    pages = {}
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


def test_the_make_targets_that_the_readme_names_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"^make (\w+)", TEXT, flags=re.M):
        assert re.search(rf"^{target}:", makefile, flags=re.M)
