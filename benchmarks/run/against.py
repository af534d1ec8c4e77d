"""Timed blocks run alternately in fresh processes of two interpreters, to compare two versions of the code."""

from __future__ import annotations

import secrets
import sys
from collections.abc import Callable
from pathlib import Path

from benchmarks.blocks.base import Kind
from benchmarks.blocks.block import Block
from benchmarks.blocks.contest import run_python
from benchmarks.records import MANIFEST, RunFolder, slug, update_manifest
from benchmarks.suite import Suite

LEAST_PROCESSES, MOST_PROCESSES = 6, 20
"""Processes of each interpreter for a block; of fewer than six pairs, a median has no 95 % interval."""

PROCESS = """
import dataclasses, sys
from benchmarks.run import run_suite
from benchmarks.suite import load_suite
file, kind, block, out, allowed = sys.argv[1:]
suite = load_suite(file, allow_plugins=bool(allowed))
asked = {kind: tuple(one for one in suite.of(kind) if one.id == block)}
kinds = tuple(one for one in suite.kinds if one.name == kind)
run_suite(dataclasses.replace(suite, kinds=kinds, asked=asked), out)
"""
"""Code of a process, which another version of the package runs, too."""


def process_folders(folder: RunFolder, kind: Kind, block: Block) -> list[Path]:
    """Return the folders of the processes of a block."""
    return [
        folder.path / "processes" / f"{slug(kind.name)}-{slug(block.id)}" / f"{i:02d}" for i in range(MOST_PROCESSES)
    ]


def run_alternately(
    suite: Suite, file: Path, folders: tuple[RunFolder, RunFolder], python: str, settled: Callable[[Kind, Block], bool],
    tell: Callable[[str], None],
) -> None:  # fmt: skip
    """Run each timed block in fresh processes until its times are settled; first comes this interpreter's folder."""
    token = folders[0].manifest().get("alternated") or secrets.token_hex(8)
    for folder in folders:
        update_manifest(folder, alternated=token)
    for kind, block in suite.pairs():
        if not (kind.alone and any(field.clock for field in kind.compared.values())):
            continue
        outs = zip(*(process_folders(folder, kind, block) for folder in folders), strict=True)
        for turn, pair in enumerate(outs):
            if settled(kind, block):
                break
            tell(f"{block.title}: process {turn + 1} of at most {MOST_PROCESSES} of each interpreter")
            sides = list(zip((sys.executable, python), pair, strict=True))
            for program, out in sides[:: -1 if turn % 2 else 1]:
                if not RunFolder(out).has(MANIFEST) or not RunFolder(out).manifest()["complete"]:
                    out.parent.mkdir(parents=True, exist_ok=True)
                    arguments = [str(file), kind.name, block.id, str(out), "yes" if suite.allow_plugins else ""]
                    run_python(program, ["-c", PROCESS, *arguments], f"{program}, {block.title}")
