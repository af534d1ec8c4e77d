"""Change one point of the code at a time and see whether a test fails; what finished is kept, so a second call goes on.

Every change is made in a copy of the tree, never in the tree itself. The copy shares the compiled kernels of an unchanged one
(by hard links: what is compiled anew is a file of its own), so only what a change reaches is compiled again.
"""

from __future__ import annotations

import argparse
import difflib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

from tests.mutants.changes import Change, list_files, named, scatter, spread
from tests.mutants.listed import DRAWS, EQUIVALENT, INTERPRETED, LISTED, SCATTERED, find_tests

ROOT = Path(__file__).resolve().parents[2]
COPIED = (
    *("optik", "planners", "benchmarks", "tests", "docs", "examples"),
    *("README.md", "CHANGELOG.md", "Makefile", "pyproject.toml"),
)
LIMIT = 300.0
"""Seconds that the tests of one change may take; those of the code as it is take a third at most."""


def copy(source: Path, target: Path, copy_file: Any = shutil.copy2) -> None:
    """Copy what tests need of a tree."""
    skip = shutil.ignore_patterns(".hypothesis", ".pytest_cache", "*.orig")
    for name in COPIED:
        if (source / name).is_dir():
            shutil.copytree(source / name, target / name, ignore=skip, copy_function=copy_file)
        elif (source / name).exists():
            target.mkdir(parents=True, exist_ok=True)
            copy_file(source / name, target / name)


def run_tests(tree: Path, tests: tuple[str, ...], limit: float) -> tuple[str, str, float]:
    """How the tests of a tree end: passed, failed or timeout; the last lines of what they say; and the seconds.

    Those in `INTERPRETED` are run first, with kernels as plain Python.
    """
    interpreted = tuple(test for test in tests if test in INTERPRETED)
    end, said, seconds = run_some(tree, interpreted, limit, "1") if interpreted else ("passed", "", 0.0)
    others = tuple(test for test in tests if test not in INTERPRETED)
    if end != "passed" or not others:
        return end, said, seconds
    end, said, more = run_some(tree, others, limit, "0")
    return end, said, seconds + more


def run_some(tree: Path, tests: tuple[str, ...], limit: float, interpreted: str) -> tuple[str, str, float]:
    """`run_tests` of tests that are all run with compiled kernels ("0"), or all without ("1")."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "-p", "no:cacheprovider", *tests]
    environment = os.environ | {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    environment["NUMBA_DISABLE_JIT"] = interpreted
    begin = time.monotonic()
    process = subprocess.Popen(
        command, cwd=tree, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        start_new_session=True,
    )  # fmt: skip
    try:
        said, _ = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return "timeout", "", time.monotonic() - begin
    end = "passed" if process.returncode == 0 else "failed"
    return end, "\n".join(said.strip().splitlines()[-4:]), time.monotonic() - begin


def judge(change: Change, pristine: Path) -> dict[str, Any]:
    """Run a change's tests on a copy that has it."""
    with tempfile.TemporaryDirectory(prefix="mutant-", dir=pristine.parent) as folder:
        tree = Path(folder)
        copy(pristine, tree, os.link)
        (tree / change.file).unlink()
        (tree / change.file).write_bytes(change.apply())
        end, said, seconds = run_tests(tree, find_tests(change.file), LIMIT)
    old, new = change.lines()
    result = {"passed": "survived", "failed": "killed", "timeout": "timeout"}[end]
    where = {"key": change.key, "file": change.file, "line": change.line, "old": old, "new": new}
    return where | {"result": result, "seconds": round(seconds, 1), "said": said}


def changes(
    which: str, root: Path = ROOT, seed: int | None = None, match: str = "", most: int | None = None
) -> list[tuple[str, Change]]:
    """The listed changes, and those of each draw; a seed, a number or an expression that files match draws other ones."""
    found = [("listed", named(root, *one)) for one in LISTED if re.search(match, one[0])]
    found = found[:most] if which in ("all", "listed") else []
    for draw, draws in ((spread, DRAWS), (scatter, SCATTERED)):
        for name, (own, count, names) in draws.items():
            files = [file for file in list_files(root, names) if re.search(match, file)]
            if which in ("all", name) and files:
                found += [(name, one) for one in draw(root, files, most or count, own if seed is None else seed)]
    return found


def report(kind: str, results: list[dict[str, Any]]) -> bool:
    """Print what became of changes; whether all that some test can notice were noticed."""
    dead = [r for r in results if r["result"] != "survived"]
    alive = [r for r in results if r["result"] == "survived"]
    same = {
        r["key"]: EQUIVALENT[r["file"], r["old"], r["new"]]
        for r in alive
        if (r["file"], r["old"], r["new"]) in EQUIVALENT
    }
    counted = len(results) - len(same)
    print(
        f"\n{kind}: {len(results)} changes, {len(dead)} killed ({sum(r['result'] == 'timeout' for r in dead)} by time)"
    )
    print(f"  {len(same)} equivalent, {counted - len(dead)} survived")
    if counted:
        low, high = binomtest(len(dead), counted).proportion_ci(method="wilson")
        shares = ", ".join(f"{100.0 * x:.1f}" for x in (len(dead) / counted, low, high))
        print(f"  percent of those that are not equivalent, and its Wilson interval (95 %): {shares}")
    for r in alive:
        print(f"  {r['file']}:{r['line']}" + (f" (equivalent: {same[r['key']]})" if r["key"] in same else ""))
        print("\n".join("    " + x for x in difflib.ndiff([r["old"]], [r["new"]]) if not x.startswith("?")))
    return counted == len(dead)


def main() -> int:
    """Run what is not yet done, then report on everything."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__.splitlines()[0])
    parser.add_argument("--which", choices=("all", "listed", *DRAWS, *SCATTERED), default="all")
    parser.add_argument(
        "--match", default="", help="draw only of files whose name has a match of this regular expression"
    )
    parser.add_argument("--seed", type=int, default=None, help="draw other changes")
    parser.add_argument("--most", type=int, default=None, help="draw so many changes")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=ROOT / ".mutants.jsonl", help="where results are kept")
    parser.add_argument("--again", action="store_true", help="run survivors once more, after tests were added")
    parser.add_argument("--list", action="store_true", help="show the changes and run nothing")
    given = parser.parse_args()
    wanted = changes(given.which, ROOT, given.seed, given.match, given.most)
    if given.list:
        for kind, c in wanted:
            print(f"{kind:7} {c.file}:{c.line}\n    - {c.lines()[0]}\n    + {c.lines()[1]}")
        return 0
    done: dict[str, dict[str, Any]] = {}
    if given.out.exists():
        for text in given.out.read_text(encoding="utf-8").splitlines():
            result = json.loads(text)
            done[result["key"]] = result
    if given.again:
        done = {k: r for k, r in done.items() if r["result"] != "survived"}
    waiting = [c for _, c in wanted if c.key not in done]
    if waiting:
        run_all(waiting, given, done)
    good = True
    for kind in ("listed", *DRAWS, *SCATTERED):
        if results := [done[c.key] for k, c in wanted if k == kind and c.key in done]:
            good &= report(kind, results) or kind != "listed"
    return 0 if good else 1


def run_all(waiting: list[Change], given: argparse.Namespace, done: dict[str, dict[str, Any]]) -> None:
    """Judge changes, so many at once, and keep each result as it comes."""
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        pristine, lock = Path(folder) / "pristine", threading.Lock()
        copy(ROOT, pristine)
        needed = tuple(dict.fromkeys(test for c in waiting for test in find_tests(c.file)))
        print(f"{len(waiting)} changes to judge; first the tests of the code as it is", flush=True)
        halves = [needed[i :: given.workers] for i in range(given.workers)]
        with ThreadPoolExecutor(given.workers) as pool:
            for end, said, seconds in pool.map(lambda part: run_tests(pristine, part, 3600.0), filter(None, halves)):
                if end != "passed":
                    raise SystemExit(f"the tests fail without any change:\n{said}")
                print(f"  passed in {seconds:.0f} s", flush=True)

        def one(change: Change) -> None:
            result = judge(change, pristine)
            with lock, given.out.open("a", encoding="utf-8") as out:
                out.write(json.dumps(result, ensure_ascii=False) + "\n")
                done[change.key] = result
                print(
                    f"{result['result']:8} {result['seconds']:6.1f} s  {change.file}:{change.line}  {result['new']}",
                    flush=True,
                )

        with ThreadPoolExecutor(given.workers) as pool:
            list(pool.map(one, waiting))


if __name__ == "__main__":
    sys.exit(main())
